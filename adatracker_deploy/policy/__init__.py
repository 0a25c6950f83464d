"""Policies: the bundle format, the ONNX runtime, mask drawing, a PID baseline. No robot, no camera."""
