"""The drone: MAVSDK offboard velocity control here, JSBSim behind a PX4 dialect at the far end of the wire.

`protocol` (messages and frames, pure) · `platform` (the adapter) · `body` (dynamics, pure) · `autopilot` and
`sitl` (the far end). Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
