"""Tests of the target lock and of what it is made of."""
