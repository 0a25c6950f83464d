"""The protocol shared by adapter and simulator: bytes, units and names."""
