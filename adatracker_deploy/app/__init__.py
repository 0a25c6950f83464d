"""Runs one trial or one viewing; the only package that imports all the others."""
