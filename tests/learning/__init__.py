"""Learning: networks, checkpoints, export."""
