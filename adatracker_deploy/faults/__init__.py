"""Faults on demand: what can break in a rehearsal, when, and whether the robot stopped in time.

`catalogue` names them, `schedule` reads ``NAME@SECONDS``; both are pure. `injection` strikes each at its real
place: `parts` stand around camera, segmenter and policy, signals go to processes, and the rest is ordered
from the far end. `witness` is what the simulated robot itself wrote down: what it was told, how it moved.
`matrix` says what each fault is allowed, `judge` compares it with the evidence (both pure), `rehearse` runs a
row and `table` shows them. Nothing in here is imported by a trial without ``--sitl --fault``, but for the
catalogue's names.
"""
