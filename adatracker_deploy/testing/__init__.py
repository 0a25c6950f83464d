"""What an outside robot's tests can inherit: the conformance suite and fakes."""
