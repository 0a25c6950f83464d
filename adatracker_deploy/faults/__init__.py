"""Faults on demand: what can break in a rehearsal, when, and whether the robot stopped in time.

`catalogue` names them, `schedule` reads ``NAME@SECONDS``; both are pure. `injection` strikes each at its real
place: `parts` stand around camera, segmenter and policy, signals go to processes, and the rest is ordered
from the far end. `witness` is what the simulated robot itself wrote down: what it was told, how it moved.

`matrix` says what each fault is allowed, `judge` compares it with the evidence (both pure); `rehearse` and
`refusals` run a row for real, `stalls` watches the machine meanwhile, `table` shows the results.

A run without ``--fault`` holds the catalogue's names and nothing that could strike.
"""
