"""The drone: MAVSDK offboard velocity control here, JSBSim behind a PX4 dialect at the far end of the wire.

The adapter: `platform`; `manoeuvres` (to OFFBOARD and back), `dialogue` (orders, answers), `helm` (what may
go out); `vehicle` (all of MAVSDK); `udp`, `guard`, `packets` (the link); `protocol`, `orders`, `events` and
`heard` (values, pure). The far end: `sitl`, `far_end`; `autopilot`, `commander`, `navigator`, `streams` and
`estimator` (PX4, pure); `body` (dynamics).

Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
