"""The wheeled base: velocity commands over a CAN bus, defined by a DBC file and the profile's roles.

`platform` joins three packages. `adapter` drives a real base: `transport` (bus, receiver and transmitter),
`authority` (control authority), `engage`, `preflight`, `odometry`. `protocol` is shared by both ends:
`connection`, `roles`, `dbc`, `codec`, `frames`, `status`, `kinematics`, `bus`. `sim` simulates the base:
`sitl` (the process), `simulator`, `firmware`, `dynamics`, `faults`, `socketcand`.

Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
