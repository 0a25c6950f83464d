"""The receiver interprets a base's frames, and says when the base must not be driven on."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wheeled_rig import base_profile

from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.adapter.receiver import BaseTelemetry, Receiver, trouble
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.protocol.frames import BaseStatus, CanFrame, Reading

ROLES = base_profile().connection.roles
TIMING = ROLES.timing
CODEC = Codec(ROLES)
GOOD = BaseStatus(mode="ours", mode_name="commanded")
NOW_NS = 10_000_000_000


def heard(**changes):
    fresh = BaseTelemetry(status=GOOD, status_t_ns=NOW_NS, motion=Twist(), motion_t_ns=NOW_NS)
    return dataclasses.replace(fresh, **changes)


def judged(heard, *, speed=1.0):
    return trouble(heard, TIMING, NOW_NS, speed)


def ago(seconds):
    return NOW_NS - round(seconds * 1e9)


def test_a_base_that_is_ours_fit_and_fresh_may_be_driven_on():
    assert judged(heard()) is None


@pytest.mark.parametrize(
    ("status", "reason", "taken", "by_hand"),
    [
        (BaseStatus(mode="remote"), "remote control", True, True),
        (BaseStatus(mode="standby", mode_name="standby"), "went to standby", True, True),
        (BaseStatus(mode="unknown", mode_name="mode 7"), "went to mode 7", True, True),
        (dataclasses.replace(GOOD, emergency_stop=True), "emergency stop", False, True),
        (dataclasses.replace(GOOD, fault="motor 1 communication"), "motor 1 communication", False, False),
    ],
)
def test_the_bases_own_report_ends_driving(status, reason, taken, by_hand):
    found = judged(heard(status=status))
    assert reason in found.reason
    assert (found.taken, found.by_hand) == (taken, by_hand)


@pytest.mark.parametrize("speed", [1.0, 5.0])
@pytest.mark.parametrize(
    ("field", "timeout_s", "reason"),
    [
        ("status_t_ns", TIMING.state_timeout_s, "no new state"),
        ("motion_t_ns", TIMING.feedback_timeout_s, "no measured motion"),
    ],
)
def test_words_that_are_too_old_end_driving_in_machine_time(field, timeout_s, reason, speed):
    assert judged(heard(**{field: ago((timeout_s - 0.01) * speed)}), speed=speed) is None
    found = judged(heard(**{field: ago((timeout_s + 0.01) * speed)}), speed=speed)
    assert reason in found.reason
    assert not found.taken


def test_a_base_that_has_said_nothing_is_not_driven():
    assert "no new state" in judged(BaseTelemetry()).reason


@given(st.builds(BaseStatus, mode=st.sampled_from(["standby", "remote", "unknown"])), st.booleans())
def test_no_mode_but_ours_is_ever_driven_on(status, pressed):
    assert judged(heard(status=dataclasses.replace(status, emergency_stop=pressed))) is not None


# Receiving frames


def ear():
    return Receiver(CODEC, ROLES)


def hear(ear, frames, now_ns=NOW_NS):
    for frame in frames:
        ear.receive(frame, now_ns)
    return ear.heard


def status_frames(count):
    return CODEC.status_frames(Reading(status=GOOD), count)


def test_a_state_whose_counter_stands_still_is_no_news():
    one = ear()
    assert hear(one, status_frames(7), 1).status_t_ns == 1
    assert hear(one, status_frames(7), 2).status_t_ns == 1
    assert hear(one, status_frames(8), 3).status_t_ns == 3
    assert hear(one, status_frames(7), 4).status_t_ns == 4


def test_the_pose_starts_where_the_base_was_first_heard_and_follows_its_wheels():
    one = ear()
    for tick, rolled_m in enumerate((3.0, 3.1, 3.2)):
        wheels = Reading(motion=Twist(vx=1.0), wheels_m=(rolled_m, rolled_m))
        hear(one, CODEC.feedback_frames(wheels), NOW_NS + tick * 100_000_000)
    assert one.heard.pose.x == pytest.approx(0.2)
    assert one.heard.motion == Twist(vx=1.0)


def test_a_pause_is_as_long_as_the_machine_takes_it_to_be_at_any_clock_speed():
    one = Receiver(CODEC, ROLES, speed=5.0)
    for now_ns, rolled_m in ((NOW_NS, 0.0), (NOW_NS + 2_000_000_000, 3.0)):  # 0.4 s of the machine's
        hear(one, CODEC.feedback_frames(Reading(motion=Twist(), wheels_m=(rolled_m, rolled_m))), now_ns)
    assert one.heard.pose.x == pytest.approx(3.0)


def test_after_a_lost_bus_nothing_counts_but_the_pose():
    one = ear()
    hear(one, status_frames(1))
    for tick, rolled_m in enumerate((0.0, 0.1)):
        wheels = Reading(motion=Twist(), wheels_m=(rolled_m, rolled_m))
        hear(one, CODEC.feedback_frames(wheels), NOW_NS + tick * 100_000_000)
    pose = one.heard.pose
    one.forget()
    assert one.heard == BaseTelemetry(pose=pose)
    assert pose.x == pytest.approx(0.1)


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=50))
def test_no_frame_makes_it_fail_and_strangers_fill_nothing(frames):
    one = ear()
    for number, data in frames:
        one.receive(CanFrame(number, data), NOW_NS)
    assert len(one.unknown_ids) <= 64


def test_a_malformed_state_changes_nothing_and_is_counted():
    one = ear()
    before = hear(one, status_frames(1))
    assert hear(one, [CanFrame(0x211, bytes(3))], NOW_NS + 1) is before
    assert one.malformed == 1


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ((), "no frame came at all"),
        ((CanFrame(0x151, bytes(8)),), "protocol v1"),
        ((CanFrame(0x211, bytes(3)),), "1 of its frames were malformed"),
        ((CanFrame(0x701, bytes(1)),), "only frames without a role came (0x701)"),
    ],
)
def test_a_silence_is_explained_by_what_was_heard_instead(frames, said):
    one = ear()
    hear(one, frames)
    assert said in one.explain_silence()
