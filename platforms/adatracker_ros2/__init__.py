"""Any ROS 2 robot: velocities out, odometry and images in, by a node of rclpy.

`platform` joins three packages. `adapter` drives a real robot: `transport` (this host's node), `monitor`
(odometry, battery), `ownership` (who else commands it), `command_publisher`, `preflight`, `driver` (the
driver's own parameters and lifecycle state), `camera`. `protocol` is shared by both ends: `connection`,
`topics`, `messages`, `qos`, `participant`. `sim` simulates the robot: `sitl` (the process), `simulator`,
`robot_node`, `dynamics`.

Written as a third party would: it uses only the toolkit's public interfaces. rclpy is imported when a
robot is reached, not when its profile is read.
"""
