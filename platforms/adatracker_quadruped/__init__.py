"""The quadruped: ROS 2 messages over Zenoh, commands out, odometry and camera in.

Bytes and names, pure: `protocol`, `parts`, `messages`, `sport`, `keys` · the host: `connection`, `session`,
`wire` (what is open: `watch` hears, `commander` sends), `survey` and `preflight`, `platform` (the adapter),
`camera` · the far end: `settings`, `gait` and `body` (dynamics, pure), `intake` (commands as a robot takes
them, pure), `senses`, `far_end`, `sitl`. It uses only public interfaces, as a third party would.
"""
