"""A trial as a rosbag2 bag: `write_bag`, and the ROS 2 messages that a tick becomes.

The bag is MCAP with definitions of its messages (rosbag2 docs: "rosbag2_storage_mcap"), written by rosbags,
which needs no ROS 2. All topics are under ``/adatracker``: a bag that is played where a robot listens must
not command it.
"""
