"""Faults on demand: what can break in a rehearsal, in which phase, and whether the robot stopped in time.

`catalogue` names them, `phases` names the phases of a trial, `schedule` reads ``NAME@WHEN``; all are pure.
`injection` strikes each at its real place: `parts` stand around camera, segmenter and policy, `strikes` go to
processes, and the rest is ordered from the simulator. `witness` is what the simulated robot itself wrote
down: what it was told, how it moved; `take_off` reads a drone's phases there, `interpreter` notes there when
the tracker's interpreter stood still.

`matrix` says what each fault is allowed while the robot follows, `phase_rows` in every other phase; `judge`
compares that with the `evidence`, by which the fault must have taken effect (all pure). `rehearse` and
`refusals` run a row for real, against a `running_simulator` that a second run meets again; `watch` sees its
processes from outside, `stalls` the machine; `gather` puts the evidence together, `table` shows the results.

A run without ``--fault`` holds the catalogue's names and nothing that could strike.
"""
