"""Policies and trials on the Hub: their files, and their cards with the Hub's header."""
