"""The simulated robot behind the wire."""
