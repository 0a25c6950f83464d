"""The simulated drone, reached over its real protocol."""
