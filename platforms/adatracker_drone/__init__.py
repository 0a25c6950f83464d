"""The drone: MAVSDK offboard velocity control, and JSBSim behind a PX4 dialect as its simulator.

`platform` joins three rooms. `adapter` flies a real drone: `engage` (to OFFBOARD and back), `command_client`
(commands, answers), `authority` (what may go out), `transport` (all of MAVSDK), `udp`, `sender_filter`.
`protocol` is what both ends share, pure: `connection`, `packets`, `setpoints`, `frames`, `events`, `signing`.
`sim` is PX4 and its airframe: `sitl` (the process), `simulator`, `autopilot`, `commander`, `dynamics`.

Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
