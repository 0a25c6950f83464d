"""The drone: offboard velocity control by MAVSDK, and a JSBSim simulator that speaks PX4's MAVLink.

`platform` joins three packages. `adapter` flies a real drone: `engage` (to OFFBOARD and back),
`command_client` (commands, answers), `authority` (control authority), `transport` (all of MAVSDK), `udp`,
`sender_filter`. `protocol` is shared by both ends and pure: `connection`, `packets`, `setpoints`, `frames`,
`events`, `signing`. `sim` simulates PX4 and its airframe: `sitl` (the process), `simulator`, `autopilot`,
`commander`, `dynamics`.

Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
