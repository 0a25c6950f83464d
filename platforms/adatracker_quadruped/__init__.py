"""The quadruped: ROS 2 messages over Zenoh, commands out, odometry and camera in.

`platform` joins three packages. `adapter` drives a real robot: `transport` (the connection), `monitor`
(telemetry), `command_publisher`, `lease` (which host controls it), `preflight`, `camera`. `protocol` is
shared by both ends: `connection`, `keys`, `messages`, `ros_types`, `cdr`, `sport`, `unitree`,
`command_decoder`, `session`. `sim` simulates the robot: `sitl` (the process), `simulator`, `sensors`,
`dynamics`, `gait`. `robot` runs on a real one: the node that a bare Go2 lacks.

Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
