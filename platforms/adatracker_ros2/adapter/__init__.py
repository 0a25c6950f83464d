"""Drives a real robot; imports no simulator."""
