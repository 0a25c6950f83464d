"""Worlds of Unreal's engine, against a server that speaks UnrealCV's protocol and shows our own world."""
