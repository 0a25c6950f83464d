"""Runs on a robot, or on a computer of its network: the node that walks a bare Unitree Go2."""
