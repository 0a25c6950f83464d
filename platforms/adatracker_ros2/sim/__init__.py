"""The simulated robot: a node of its own, in its own process."""
