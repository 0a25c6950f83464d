"""The quadruped's messages and a real ROS 2 node, where ROS 2 is installed.

pip install ros-rclpy ros-rmw-fastrtps-cpp ros-geometry-msgs ros-sensor-msgs ros-nav-msgs
"""

import os
import socket

import pytest
import zenoh

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.perception.compressed_image import CompressedImage
from adatracker_quadruped.protocol import cdr as protocol
from adatracker_quadruped.protocol import messages
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import Imu, Odometry
from adatracker_quadruped.protocol.session import open_session, zenoh_config
from tests.quadruped import cdr

rclpy = pytest.importorskip(
    "rclpy", reason="ROS 2 is not installed: see this file's first lines for its wheels"
)
from geometry_msgs.msg import Twist as RosTwist  # noqa: E402 - after the skip
from geometry_msgs.msg import TwistStamped  # noqa: E402
from nav_msgs.msg import Odometry as RosOdometry  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import BatteryState  # noqa: E402
from sensor_msgs.msg import CompressedImage as RosCompressedImage  # noqa: E402
from sensor_msgs.msg import Imu as RosImu  # noqa: E402

WALK = Twist(vx=0.5, vy=-0.1, vz=0.2, yaw_rate=0.3)
STAMP_NS = 1_700_000_000_123_456_789
HERE = Pose(1.0, 2.0, 0.3, 0.1, -0.2, 3.0)
MESSAGES = {
    protocol.TWIST: (RosTwist, messages.encode_twist(WALK)),
    protocol.TWIST_STAMPED: (TwistStamped, messages.encode_twist_stamped(WALK, STAMP_NS, "base_link")),
    protocol.ODOMETRY: (RosOdometry, messages.encode_odometry(Odometry(HERE, WALK, STAMP_NS))),
    protocol.IMU: (
        RosImu,
        messages.encode_imu(Imu((0.1, 0.2, 0.3), (1.0, 2.0, 3.0), (0.0, 0.0, 9.81), STAMP_NS)),
    ),
    protocol.BATTERY_STATE: (BatteryState, messages.encode_battery(0.75, STAMP_NS)),
    protocol.COMPRESSED_IMAGE: (
        RosCompressedImage,
        messages.encode_compressed_image(CompressedImage(STAMP_NS, "jpeg", bytes(range(251)))),
    ),
}


@pytest.fixture(scope="module")
def node():
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    node = rclpy.create_node("quadruped", namespace="adatracker_test")
    yield node
    node.destroy_node()
    rclpy.shutdown()


@pytest.mark.parametrize("name", MESSAGES)
def test_ros_reads_what_is_written_here_and_writes_the_same_bytes(name):
    ros_type, payload = MESSAGES[name]
    layout = cdr.LAYOUTS[name.rsplit("/", maxsplit=1)[-1]]
    written_by_ros = serialize_message(deserialize_message(payload, ros_type))
    assert cdr.mask_padding(layout, written_by_ros) == cdr.mask_padding(layout, payload)


def test_ros_means_the_same_by_the_numbers():
    odometry = deserialize_message(MESSAGES[protocol.ODOMETRY][1], RosOdometry)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert (odometry.pose.pose.position.x, odometry.twist.twist.linear.y) == (1.0, -0.1)
    assert odometry.twist.twist.angular.z == 0.3
    assert odometry.header.stamp.sec * 10**9 + odometry.header.stamp.nanosec == STAMP_NS
    battery = deserialize_message(MESSAGES[protocol.BATTERY_STATE][1], BatteryState)
    assert (battery.percentage, battery.present) == (0.75, True)


@pytest.mark.parametrize("name", MESSAGES)
def test_ros_hashes_the_types_alike(node, name):
    topic = name.rsplit("/", maxsplit=1)[-1].lower()
    publisher = node.create_publisher(MESSAGES[name][0], topic, 1)
    info = node.get_publishers_info_by_topic(publisher.topic_name)
    assert str(info[0].topic_type_hash) == protocol.STORE.hash_rihs01(name)
    node.destroy_publisher(publisher)


def test_a_ros_node_behind_a_bridge_gets_every_twist_and_its_odometry_arrives(node):
    """The bridge here does what zenoh-bridge-ros2dds does: it passes payloads on as they are."""
    connection = Connection(endpoint=f"tcp/127.0.0.1:{unused_port(socket.SOCK_STREAM)}")
    keys, got, back = Keys(connection), [], []
    ros_commands = node.create_publisher(RosTwist, "cmd_vel", 100)
    node.create_subscription(RosTwist, "cmd_vel", got.append, 100)
    ros_odometry = node.create_publisher(RosOdometry, "odom", 100)
    with zenoh.open(zenoh_config(connection, mode="router")) as far, open_session(connection) as host:
        bridged = far.declare_subscriber(keys.command, zenoh.handlers.FifoChannel(200))
        node.create_subscription(RosOdometry, "odom", lambda raw: far.put(keys.odometry, raw), 100, raw=True)
        odometry = host.declare_subscriber(keys.odometry, zenoh.handlers.FifoChannel(200))
        publisher = host.declare_publisher(keys.command, congestion_control=zenoh.CongestionControl.BLOCK)
        spin(node, lambda: publisher.matching_status.matching and ros_commands.get_subscription_count() > 0)
        spin(node, lambda: ros_odometry.get_subscription_count() > 0)
        for step in range(100):
            publisher.put(messages.encode_twist(Twist(vx=step / 100, yaw_rate=-step / 100)))
            ros_odometry.publish(deserialize_message(MESSAGES[protocol.ODOMETRY][1], RosOdometry))

        def all_there():
            while (sample := bridged.try_recv()) is not None:
                ros_commands.publish(sample.payload.to_bytes())
            while (sample := odometry.try_recv()) is not None:
                back.append(messages.decode_odometry(sample.payload.to_bytes()))
            return len(got) == len(back) == 100

        spin(node, all_there)
    assert [(twist.linear.x, twist.angular.z) for twist in got] == [(n / 100, -n / 100) for n in range(100)]
    assert {(odometry.velocity, odometry.stamp_ns) for odometry in back} == {(WALK, STAMP_NS)}


def spin(node, condition, rounds=2000):
    for _ in range(rounds):
        if condition():
            return
        rclpy.spin_once(node, timeout_sec=0.005)
    pytest.fail("waited in vain")
