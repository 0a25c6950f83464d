"""The simulated base, reached over its real protocol."""
