"""The quadruped's ROS 2 messages against CDR written by hand."""

import math
import struct
from dataclasses import astuple, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.perception.compressed_image import CompressedImage
from adatracker_quadruped.protocol import messages
from adatracker_quadruped.protocol import ros_types as parts
from adatracker_quadruped.protocol.messages import Imu, Malformed, Odometry
from tests.quadruped import cdr

speeds = st.floats(-parts.FASTEST, parts.FASTEST)
twists = st.builds(Twist, speeds, speeds, speeds, speeds)
stamps = st.integers(0, 2**31 * 10**9 - 1)
names = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20)
places = st.floats(-messages.FARTHEST_M, messages.FARTHEST_M)
angles = st.floats(-math.pi + 1e-6, math.pi)
pitches = st.floats(-1.55, 1.55)
poses = st.builds(Pose, places, places, places, angles, pitches, angles)
orders = st.sampled_from("<>")
paddings = st.integers(0, 255)


def layout(name):
    return cdr.LAYOUTS[name]


def stamp(t_ns):
    return divmod(t_ns, 10**9)


def quaternion(pose):
    """Return x, y, z, w of a rotation matrix (Shepperd's method where the trace is the largest)."""
    m = pose.rotation()
    w = math.sqrt(max(0.0, 1 + m[0, 0] + m[1, 1] + m[2, 2])) / 2
    return (m[2, 1] - m[1, 2]) / (4 * w), (m[0, 2] - m[2, 0]) / (4 * w), (m[1, 0] - m[0, 1]) / (4 * w), w


def odometry_values(
    stamp_ns=0, place=(0, 0, 0), attitude=(0, 0, 0, 1), twist=(0,) * 6, names=("odom", "base")
):
    return [*stamp(stamp_ns), *names, *place, *attitude, *[0] * 36, *twist, *[0] * 36]


def imu_values(attitude=(0, 0, 0, 1), covariance=0, rates=(0, 0, 0), force=(0, 0, 9.81)):
    return [1, 2, "imu", *attitude, covariance, *[0] * 8, *rates, *[0] * 9, *force, *[0] * 9]


def battery_values(percentage):
    return [0, 0, "", *[math.nan] * 6, percentage, 0, 0, 0, True, [3.9, 4.0], [], "tray", ""]


@given(twists)
def test_a_twist_is_linear_x_y_z_then_angular_x_y_z(twist):
    payload = messages.encode_twist(twist)
    by_hand = [twist.vx, twist.vy, twist.vz, 0.0, 0.0, twist.yaw_rate]
    assert payload == cdr.encode(layout("Twist"), by_hand)
    assert messages.decode_twist(payload) == twist


def test_the_bytes_of_a_twist_are_these():
    """2 m/s forward and -0.5 rad/s: the encapsulation header, then six doubles, little end first."""
    zeros = "0000000000000000"
    expected = "00010000" + "0000000000000040" + zeros * 4 + "000000000000e0bf"
    assert messages.encode_twist(Twist(vx=2.0, yaw_rate=-0.5)).hex() == expected


@given(twists, stamps, names, paddings)
def test_a_stamped_twist_is_a_header_and_a_twist_whatever_pads_it(twist, stamp_ns, frame_id, padding):
    payload = messages.encode_twist_stamped(twist, stamp_ns, frame_id)
    by_hand = cdr.encode(
        layout("TwistStamped"),
        [*stamp(stamp_ns), frame_id, twist.vx, twist.vy, twist.vz, 0, 0, twist.yaw_rate],
        padding=padding,
    )
    assert cdr.mask_padding(layout("TwistStamped"), by_hand) == cdr.mask_padding(
        layout("TwistStamped"), payload
    )
    for read in (payload, by_hand):
        assert messages.decode_twist_stamped(read) == messages.StampedTwist(twist, stamp_ns, frame_id)


@pytest.mark.parametrize("axis", ["vx", "vy", "vz", "yaw_rate"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, parts.FASTEST * 1.01, 1e308])
def test_what_is_no_velocity_never_becomes_bytes(axis, value):
    twist = Twist(**{axis: value})
    for encode in (messages.encode_twist, lambda bad: messages.encode_twist_stamped(bad, 0, "base_link")):
        with pytest.raises(PlatformError, match="not a velocity"):
            encode(twist)


@given(orders, paddings, stamps, st.tuples(places, places, places), st.tuples(*[speeds] * 6))
def test_an_odometry_is_read_in_either_byte_order_whatever_pads_it(order, padding, stamp_ns, place, six):
    values = odometry_values(stamp_ns, place, (0, 0, math.sqrt(0.5), math.sqrt(0.5)), six, ("map", "trunk"))
    odometry = messages.decode_odometry(cdr.encode(layout("Odometry"), values, order, padding))
    assert (odometry.pose.x, odometry.pose.y, odometry.pose.z) == place
    assert odometry.pose.yaw == pytest.approx(math.pi / 2)
    assert (odometry.pose.roll, odometry.pose.pitch) == pytest.approx((0.0, 0.0))
    assert odometry.velocity == Twist(six[0], six[1], six[2], six[5])
    assert (odometry.stamp_ns, odometry.frame_id, odometry.child_frame_id) == (stamp_ns, "map", "trunk")


@given(poses, twists, stamps, names, names)
def test_an_odometry_comes_back_as_it_was(pose, velocity, stamp_ns, frame_id, child_frame_id):
    sent = Odometry(pose, velocity, stamp_ns, frame_id, child_frame_id)
    payload = messages.encode_odometry(sent)
    got = messages.decode_odometry(payload)
    assert astuple(got.pose) == pytest.approx(astuple(pose), abs=1e-6)
    assert replace(got, pose=pose) == sent
    values = cdr.decode(layout("Odometry"), payload)
    assert values[:7] == [*stamp(stamp_ns), frame_id, child_frame_id, pose.x, pose.y, pose.z]
    assert values[47:53] == [velocity.vx, velocity.vy, velocity.vz, 0, 0, velocity.yaw_rate]


@given(
    st.builds(Pose, roll=st.floats(-1.4, 1.4), pitch=st.floats(-1.2, 1.2), yaw=st.floats(-1.4, 1.4)),
    st.sampled_from([1, -1]),
)
def test_an_attitude_turns_by_the_same_matrix_on_both_sides(pose, sign):
    """A quaternion and its negative are the same rotation; positive pitch looks down (REP 103)."""
    values = odometry_values(attitude=[sign * part for part in quaternion(pose)])
    got = messages.decode_odometry(cdr.encode(layout("Odometry"), values)).pose
    assert got.rotation().ravel() == pytest.approx(pose.rotation().ravel(), abs=1e-9)
    written = cdr.decode(layout("Odometry"), messages.encode_odometry(Odometry(pose, Twist(), 0)))[7:11]
    assert written == pytest.approx(quaternion(pose), abs=1e-9)


@pytest.mark.parametrize(
    "attitude", [(0, 0, 0, 0), (0, 0, 0, 0.98), (1, 1, 1, 1), (0, 0, 0, math.nan), (0, 0, 0, 1e200)]
)
def test_a_quaternion_that_is_no_rotation_is_malformed(attitude):
    for name, values in (("Odometry", odometry_values), ("Imu", imu_values)):
        decode = {"Odometry": messages.decode_odometry, "Imu": messages.decode_imu}[name]
        with pytest.raises(Malformed, match="unit length"):
            decode(cdr.encode(layout(name), values(attitude=attitude)))


def test_a_quaternion_rounded_to_floats_is_a_rotation():
    rounded = [struct.unpack("<f", struct.pack("<f", part))[0] for part in quaternion(Pose(yaw=1.0))]
    payload = cdr.encode(layout("Odometry"), odometry_values(attitude=rounded))
    assert messages.decode_odometry(payload).pose.yaw == pytest.approx(1.0, abs=1e-6)


@given(st.sampled_from([math.nan, math.inf, -math.inf, 1e9, -1e300]), st.integers(0, 8))
def test_a_number_that_nothing_can_be_is_malformed(value, where):
    numbers = [0.0] * 9
    numbers[where] = value
    payload = cdr.encode(layout("Odometry"), odometry_values(place=numbers[:3], twist=numbers[3:]))
    with pytest.raises(Malformed, match="not a number"):
        messages.decode_odometry(payload)
    if where >= 3:
        with pytest.raises(Malformed, match="not a number"):
            messages.decode_twist(cdr.encode(layout("Twist"), numbers[3:]))


def test_covariances_are_not_read():
    values = odometry_values()
    values[11] = values[-1] = math.nan
    assert messages.decode_odometry(cdr.encode(layout("Odometry"), values)).pose == Pose()


@pytest.mark.parametrize(("seconds", "nanoseconds"), [(-1, 0), (0, 10**9), (2**31 - 1, 2**32 - 1)])
def test_a_stamp_that_is_no_time_is_malformed(seconds, nanoseconds):
    values = [seconds, nanoseconds, *odometry_values()[2:]]
    with pytest.raises(Malformed, match="no time"):
        messages.decode_odometry(cdr.encode(layout("Odometry"), values))


@given(orders, paddings, st.tuples(speeds, speeds, speeds))
def test_an_imu_is_read_and_written_as_its_message_says(order, padding, rates):
    values = imu_values(quaternion(Pose(roll=0.1, pitch=0.2, yaw=0.3)), 0, rates)
    imu = messages.decode_imu(cdr.encode(layout("Imu"), values, order, padding))
    assert imu.attitude == pytest.approx((0.1, 0.2, 0.3))
    assert (imu.angular_velocity_rad_s, imu.acceleration_m_s2) == (rates, (0, 0, 9.81))
    assert (imu.stamp_ns, imu.frame_id) == (1_000_000_002, "imu")
    assert cdr.decode(layout("Imu"), messages.encode_imu(imu)) == pytest.approx(values)


def test_an_imu_that_estimates_no_attitude_has_none():
    imu = Imu(None, (0.0, 0.0, 0.1), (0.0, 0.0, 9.81), 5)
    payload = messages.encode_imu(imu)
    assert cdr.decode(layout("Imu"), payload)[7] == -1
    assert messages.decode_imu(payload) == imu
    values = imu_values(attitude=(0, 0, 0, 0), covariance=-1)
    assert messages.decode_imu(cdr.encode(layout("Imu"), values)).attitude is None


@given(st.floats(0, 1, width=32), orders, paddings)
def test_a_battery_tells_its_charge(charge, order, padding):
    payload = cdr.encode(layout("BatteryState"), battery_values(charge), order, padding)
    assert messages.decode_battery(payload) == charge
    assert cdr.decode(layout("BatteryState"), messages.encode_battery(charge))[9] == charge
    assert messages.decode_battery(messages.encode_battery(charge)) == charge


def test_a_battery_that_does_not_know_its_charge_says_so():
    assert messages.decode_battery(cdr.encode(layout("BatteryState"), battery_values(math.nan))) is None
    assert messages.decode_battery(messages.encode_battery(None)) is None


@pytest.mark.parametrize("percentage", [-0.1, 1.5, 87.0, math.inf])
def test_a_charge_in_per_cent_is_not_taken_for_a_fraction(percentage):
    with pytest.raises(Malformed, match="not between 0 and 1"):
        messages.decode_battery(cdr.encode(layout("BatteryState"), battery_values(percentage)))


@given(stamps, names, names, st.binary(min_size=1, max_size=500), st.tuples(orders, paddings))
def test_an_image_is_its_stamp_its_format_and_its_bytes(stamp_ns, frame_id, form, data, wire):
    by_hand = [*stamp(stamp_ns), frame_id, form, data]
    payload = messages.encode_compressed_image(CompressedImage(stamp_ns, form, data, frame_id))
    assert cdr.decode(layout("CompressedImage"), payload) == by_hand
    for read in (payload, cdr.encode(layout("CompressedImage"), by_hand, *wire)):
        image = messages.decode_compressed_image(read)
        assert (image.stamp_ns, image.frame_id, image.format) == (stamp_ns, frame_id, form)
        assert bytes(image.data) == data


def test_an_image_of_nothing_is_malformed():
    with pytest.raises(Malformed, match="without data"):
        messages.decode_compressed_image(cdr.encode(layout("CompressedImage"), [0, 0, "", "jpeg", b""]))
