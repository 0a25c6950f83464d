"""The quadruped: ROS 2 messages over Zenoh, commands out, odometry and camera in.

`protocol` (messages and keys, pure) · `platform` (the adapter) · `body` (dynamics, pure) · `sitl` (the far
end). Written as a third party would write it: it uses only the toolkit's public interfaces.
"""
