"""The real-time side: clock, loop, gate and the supervised link. No robot library, no policy, no camera."""
