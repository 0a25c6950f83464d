"""A world that Unreal's engine simulates, over UnrealCV's protocol: UnrealZoo's maps (docs/unreal.md).

`address` says which, `settings` reads UnrealZoo's own file of a map, `wire` speaks the protocol, `units`
changes frames, `engine` is one connection with a level made ready, and `world` an episode in it.
"""
