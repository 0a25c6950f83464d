"""Values to real ROS 2 messages and back; what cannot be is refused."""

import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

from geometry_msgs.msg import Twist as RosTwist
from rclpy.serialization import deserialize_message, serialize_message

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_ros2.protocol import messages, topics
from adatracker_ros2.protocol.messages import Malformed, Odometry

GO = Twist(vx=0.5, vy=-0.1, vz=0.2, yaw_rate=0.3)
STAMP_NS = 1_700_000_000_123_456_789
HERE = Pose(1.0, 2.0, 0.3, 0.1, -0.2, 3.0)


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize(("type_name", "stamp"), [(topics.TWIST, None), (topics.TWIST_STAMPED, STAMP_NS)])
def test_a_velocity_comes_back_as_it_was(type_name, stamp):
    message = over_the_wire(messages.write_command(type_name, GO, STAMP_NS, "base_link"))
    assert messages.read_command(message) == (GO, stamp)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 101.0])
def test_no_velocity_that_cannot_be_becomes_a_message_or_is_read_from_one(value):
    with pytest.raises(PlatformError, match="refused to send"):
        messages.write_command(topics.TWIST, Twist(vx=value), 0, "")
    message = RosTwist()
    message.angular.x = value
    with pytest.raises(Malformed):
        messages.read_command(message)


def test_odometry_comes_back_as_it_was():
    back = messages.read_odometry(over_the_wire(messages.write_odometry(Odometry(HERE, GO, STAMP_NS))))
    assert (back.velocity, back.stamp_ns) == (GO, STAMP_NS)
    assert np.allclose(
        [back.pose.x, back.pose.y, back.pose.z, back.pose.roll, back.pose.pitch, back.pose.yaw],
        [HERE.x, HERE.y, HERE.z, HERE.roll, HERE.pitch, HERE.yaw],
    )


def test_a_velocity_in_the_odometrys_axes_is_turned_into_the_bodys():
    """A robot that faces left of x and drives ahead moves along y of its odometry."""
    told = Odometry(Pose(yaw=math.pi / 2), Twist(vy=0.5), STAMP_NS)
    assert messages.in_body(told).velocity.vx == pytest.approx(0.5)
    assert messages.in_odom(messages.in_body(told)).velocity.vy == pytest.approx(0.5)


def test_odometry_that_cannot_be_is_refused():
    for change in ("x", "w"):
        message = messages.write_odometry(Odometry(HERE, GO, STAMP_NS))
        target = message.pose.pose.position if change == "x" else message.pose.pose.orientation
        setattr(target, change, math.nan)
        with pytest.raises(Malformed):
            messages.read_odometry(message)
    message = messages.write_odometry(Odometry(HERE, GO, STAMP_NS))
    message.header.stamp.sec = -1
    with pytest.raises(Malformed, match="no time"):
        messages.read_odometry(message)


def test_a_charge_is_a_share_and_nan_is_unknown():
    assert messages.read_battery(messages.write_battery(0.75)) == 0.75
    assert messages.read_battery(messages.write_battery(math.nan)) is None
    with pytest.raises(Malformed, match="not between 0 and 1"):
        messages.read_battery(messages.write_battery(80.0))


@pytest.mark.parametrize("encoding", messages.CHANNELS)
def test_a_raw_image_is_read_whatever_the_order_of_its_channels_and_the_padding_of_its_rows(encoding):
    rgb = np.random.default_rng(1).integers(0, 256, (6, 5, 3), np.uint8)
    if encoding == "mono8":
        rgb = np.repeat(rgb[:, :, :1], 3, axis=2)
    pixels = {
        "rgb8": rgb,
        "bgr8": rgb[:, :, ::-1],
        "mono8": rgb[:, :, :1],
        "rgba8": np.dstack([rgb, rgb[:, :, 0]]),
        "bgra8": np.dstack([rgb[:, :, ::-1], rgb[:, :, 0]]),
    }[encoding]
    rows = np.pad(pixels.reshape(6, -1), ((0, 0), (0, 3)))
    message = messages.write_image(rgb, STAMP_NS)
    message.encoding, message.step, message.data = encoding, rows.shape[1], rows.tobytes()
    assert np.array_equal(messages.read_image(over_the_wire(message)), rgb)


@pytest.mark.parametrize(
    "change", [{"encoding": "bayer_rggb8"}, {"height": 7}, {"step": 14}, {"width": 0}, {"width": 1 << 30}]
)
def test_a_raw_image_that_cannot_be_is_refused(change):
    message = messages.write_image(np.zeros((6, 5, 3), np.uint8), STAMP_NS)
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(Malformed):
        messages.read_image(message)
