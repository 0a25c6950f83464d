"""Fault injection in rehearsals: what can break, in which phase, and whether the robot stopped in time.

`core.faults` names the faults, `phases` the phases of a trial, and `schedule` parses ``NAME@WHEN``; all are
pure. `injection` injects each fault where it would really occur: `parts` wrap camera, segmenter and policy,
`strikes` act on processes, and the simulator does the rest on command. `sim.ground_truth` is the simulated
robot's own record of its commands and motion; `take_off` reads a drone's phases there.

`matrix` gives each fault's limits while the robot follows, `phase_rows` in every other phase; `sample` draws
the rows of an everyday run; `judge` compares limits with the `evidence`, which must also show that the fault
took effect (all pure). `rehearse` and `refusals` run a row for real, against a `running_simulator` that a
second run reuses; `watch` monitors its processes from outside, `stalls` the machine; `gather` collects the
evidence, `table` shows the results.

A run without ``--fault`` imports only the names of the faults and nothing that could inject one.
"""
