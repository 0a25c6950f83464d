"""Checks of a machine and a robot before a trial; each failure says how to fix it."""
