"""The quadruped: ROS 2 messages over Zenoh, commands out, odometry and camera in.

`platform` joins three rooms. `adapter` walks a real robot: `transport` (what is open), `monitor` (what is
heard), `command_publisher`, `lease` (who walks it), `preflight`, `camera`. `protocol` is what both ends
share: `connection`, `keys`, `messages`, `ros_types`, `cdr`, `sport`, `session`. `sim` is the robot: `sitl`
(the process), `simulator`, `command_decoder`, `sensors`, `dynamics`, `gait`.

Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
