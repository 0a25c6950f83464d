"""Drives the real robot; imports nothing of the simulator."""
