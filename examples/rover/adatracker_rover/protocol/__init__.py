"""What both ends of the wire share: bytes, units and names."""
