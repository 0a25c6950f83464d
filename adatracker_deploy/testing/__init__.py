"""Base classes for an outside robot's tests: the conformance suite and fakes."""
