"""The drone's bytes and frames, without a drone."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_drone.protocol.frames import NedPose
from adatracker_drone.protocol.setpoints import (
    FASTEST_M_S,
    AltitudeHold,
    body_velocity,
    check_url,
    dialled,
    numeric_address,
    set_point_json,
)

speeds = st.floats(-FASTEST_M_S, FASTEST_M_S)
angles = st.floats(-math.pi, math.pi)


def test_a_set_point_is_a_level_body_velocity_in_px4s_frame():
    fields = json.loads(set_point_json(Twist(vx=1.0, vy=2.0, vz=3.0, yaw_rate=0.5), now_ns=1_500_000_000))
    assert (fields["vx"], fields["vy"], fields["vz"], fields["yaw_rate"]) == (1.0, -2.0, -3.0, -0.5)
    assert fields["coordinate_frame"] == 8
    assert fields["time_boot_ms"] == 1500


def test_a_set_points_mask_lets_only_velocity_and_yaw_rate_through():
    mask = json.loads(set_point_json(Twist(), 0))["type_mask"]
    ignored = {bit for bit in range(12) if mask >> bit & 1}
    assert ignored == {0, 1, 2, 6, 7, 8, 10}  # x y z, ax ay az, yaw


@given(speeds, speeds, speeds, speeds, st.integers(0, 2**63))
def test_every_finite_velocity_at_any_time_makes_valid_fields(vx, vy, vz, yaw_rate, now_ns):
    fields = json.loads(set_point_json(Twist(vx, vy, vz, yaw_rate), now_ns))
    assert 0 <= fields["time_boot_ms"] < 2**32
    assert all(math.isfinite(value) for value in fields.values())


@given(
    st.sampled_from(["vx", "vy", "vz", "yaw_rate"]),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e39, FASTEST_M_S * 1.01]),
)
def test_a_value_that_is_no_velocity_is_never_encoded(axis, value):
    with pytest.raises(PlatformError, match="not a velocity"):
        set_point_json(Twist(**{axis: value}), 0)


@pytest.mark.parametrize("text", ["", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:99999", "localhost:1", "::1:5"])
def test_a_peer_that_is_no_address_is_refused(text):
    with pytest.raises(UsageError, match=r"connection\.peer"):
        numeric_address(text)
    assert numeric_address("192.168.1.10:14580") == ("192.168.1.10", 14580)


@given(speeds, speeds, speeds, angles)
def test_a_measured_velocity_is_the_same_arrow_in_both_frames(north, east, down, yaw):
    velocity = body_velocity((north, east, down), yaw, yaw_rate_frd_rad_s=0.3)
    arrow = NedPose(heading=yaw).to_enu().rotation() @ [velocity.vx, velocity.vy, velocity.vz]
    assert arrow == pytest.approx([east, north, -down], abs=1e-6)
    assert velocity.yaw_rate == -0.3


def test_altitude_hold_climbs_back_to_where_it_was():
    hold = AltitudeHold.at(2.5, band_m=(1.0, 6.0), t_ns=0)
    assert hold.step(0.0, 2.3, 20_000_000)[1] == pytest.approx(0.2)
    assert hold.step(0.0, 2.6, 20_000_000)[1] == pytest.approx(-0.1)


def test_altitude_hold_follows_a_commanded_climb_without_lag():
    hold, altitude, t_ns = AltitudeHold.at(2.5, band_m=(1.0, 6.0), t_ns=0), 2.5, 0
    for _ in range(100):
        t_ns += 20_000_000
        hold, climb = hold.step(0.5, altitude, t_ns)
        altitude += climb * 0.02
    assert altitude == pytest.approx(3.5, abs=0.02)


def test_altitude_hold_beats_the_bias_that_makes_velocity_control_drift():
    hold, altitude, t_ns = AltitudeHold.at(2.6, band_m=(1.0, 6.0), t_ns=0), 2.6, 0
    for _ in range(20 * 50):
        t_ns += 20_000_000
        hold, climb = hold.step(0.0, altitude, t_ns)
        altitude += (climb + 0.26) * 0.02  # 2.6 m to 4.7 m in 8 s, as measured without a hold
    assert abs(altitude - 2.6) < 0.3


@given(
    st.floats(-50, 50),
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-50, 50), st.integers(0, 10**11)), max_size=30),
)
def test_no_history_of_commands_moves_the_reference_out_of_its_band(start_m, history):
    hold, t_ns = AltitudeHold.at(start_m, band_m=(1.0, 6.0), t_ns=0), 0
    for climb_m_s, altitude_m, elapsed_ns in history:
        t_ns += elapsed_ns
        hold, up = hold.step(climb_m_s, altitude_m, t_ns)
        assert 1.0 <= hold.reference_m <= 6.0
        assert abs(up) <= abs(climb_m_s) + 0.5 + 1e-6


def test_a_long_silence_does_not_make_the_reference_jump():
    hold = AltitudeHold.at(2.5, band_m=(1.0, 6.0), t_ns=0)
    after, _ = hold.step(1.0, 2.5, 10**12)
    assert after.reference_m <= 2.7


@pytest.mark.parametrize(
    ("url", "binds", "dials"),
    [
        ("udpin://127.0.0.1:14540", ("127.0.0.1", 14540), None),
        ("udpin://0.0.0.0:14550", ("0.0.0.0", 14550), None),
        ("udpout://192.168.1.20:14550", None, ("192.168.1.20", 14550)),
        ("tcpout://10.0.0.2:5760", None, None),
        ("serial:///dev/ttyACM0:57600", None, None),
    ],
)
def test_a_url_that_mavsdk_takes_is_accepted_and_says_what_it_binds_or_dials(url, binds, dials):
    assert check_url(url) == binds
    assert dialled(url) == dials


@pytest.mark.parametrize(
    "url",
    [
        "udpin://localhost:14540",
        "127.0.0.1:14540",
        "udpin://127.0.0.1",
        "udpin://127.0.0.1:0",
        "udpin://127.0.0.1:99999",
        "udp://:14540",
        "udpin://127.0.0.1:14540/extra",
        "serial://dev/ttyACM0:57600",
        "serial:///dev/ttyACM0",
        "http://[broken",
        "",
    ],
)
def test_a_url_that_mavsdk_would_not_understand_is_refused_with_examples(url):
    with pytest.raises(UsageError, match=r"udpin://127.0.0.1:14540"):
        check_url(url)


@given(st.text(max_size=40))
def test_no_text_at_all_makes_the_url_check_fail_in_another_way(text):
    try:
        check_url(text)
    except UsageError as error:
        assert "connection.url" in str(error)  # noqa: PT017 -- most texts raise, a valid one need not
