"""Compares policies over the paper's grid of bodies, and probes their context. Needs no torch.

`grid` says which episodes there are, `play` plays them on all cores, `scores` sums them up with intervals,
`table`, `latex`, `picture` and `record` show that; `context` is the study of z. The worlds and bodies are
those of `learning`, the rules those of `world.task`.
"""
