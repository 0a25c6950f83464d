"""The simulated quadruped, reached over its real protocol."""
