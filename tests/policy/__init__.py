"""Policies: bundles, their runtime, drawing, the PID baseline."""
