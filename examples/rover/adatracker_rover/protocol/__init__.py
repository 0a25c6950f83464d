"""Shared by both ends of the wire: bytes, units and names."""
