"""The wheeled base: velocity commands over a CAN bus, by a DBC file and a profile that names the roles.

`platform` joins three rooms. `adapter` drives a real base: `transport` (bus, receiver and transmitter),
`authority` (what may go out), `engage`, `preflight`, `odometry`. `protocol` is what both ends share:
`connection`, `roles`, `dbc`, `codec`, `frames`, `status`, `kinematics`, `bus`. `sim` is the base: `sitl` (the
process), `simulator`, `firmware`, `dynamics`, `faults`, `socketcand`.

Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
