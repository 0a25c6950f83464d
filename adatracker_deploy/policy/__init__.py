"""Policies: the bundle format, the ONNX runtime, the mask's drawing, a PID baseline. No robot, no camera."""
