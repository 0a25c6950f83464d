"""The real-time part: pacer, loop, gate and the supervised link. No robot library, policy or camera."""
