"""For any input the gate's output is finite, inside the envelope and smooth, and a stop is for good."""

from __future__ import annotations

import math
from dataclasses import astuple

from gate_rig import LIMITS, START_NS
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.runtime.gate import GateState, Reason, Setpoint, Stage, judge
from adatracker_deploy.runtime.gate.envelope import Envelope
from adatracker_deploy.runtime.gate.judge import LONGEST_STEP_S
from adatracker_deploy.runtime.gate.track import JUMP_M, fastest_m_s

anything = st.floats(allow_nan=True, allow_infinity=True)
plausible = st.floats(-2.0, 2.0)
ROUNDING = 1e-8


def twists(number):
    return st.builds(Twist, number, number, number, number)


def robots(number, ages_ns):
    return st.builds(
        lambda age_ns, **said: lambda now_ns: PlatformState(t_ns=now_ns - age_ns, **said),
        ages_ns,
        mode=st.just("DRIVE"),
        engaged=st.sampled_from([True] * 9 + [False]),
        pose=st.none() | st.builds(Pose, number, number, st.just(2.0) | number, yaw=number),
        velocity=st.none() | twists(number),
        battery=st.none() | st.just(0.9) | number,
        stopped=st.sampled_from([""] * 9 + ["why"]),
        taken_over=st.booleans(),
    )


def steps(number, *, pauses_s, ages_s):
    """Generate the inputs of one step: a pause, a command and its age, the target's share, the robot."""
    shares = st.none() | st.just(0.1) | number
    ages_ns = st.integers(-(10**9), 2 * 10**9)
    return st.tuples(pauses_s, st.none() | twists(number), ages_s, shares, robots(number, ages_ns))


WILD = st.lists(steps(anything, pauses_s=st.floats(-0.5, 0.5), ages_s=st.floats(-0.5, 2.0)), max_size=20)
TAME = st.lists(
    st.tuples(st.floats(0.0, 0.12), twists(plausible), st.sampled_from([0.0] * 19 + [0.3])),
    min_size=5,
    max_size=40,
)


def replay(script):
    """Yield, for each step, the state before, the verdict and the state after."""
    state, now_ns = GateState(armed_ns=START_NS), START_NS
    for pause_s, twist, age_s, share, robot in script:
        now_ns += round(pause_s * 1e9)
        setpoint = None if twist is None else Setpoint(twist, now_ns - round(age_s * 1e9), share)
        before = state
        state, verdict = judge(LIMITS, state, setpoint, robot(now_ns), now_ns)
        yield before, verdict, state


@given(WILD)
def test_the_output_is_always_finite_and_inside_the_envelope(script):
    for _, verdict, state in replay(script):
        assert verdict.twist.is_finite()
        assert Envelope.of(LIMITS).clip(verdict.twist) == verdict.twist
        assert state.last == verdict.twist
        assert all(map(math.isfinite, astuple(state.rate)))


@given(WILD)
def test_nothing_moves_after_a_stop_until_the_next_engagement(script):
    latched = None
    for _, verdict, state in replay(script):
        if latched:
            assert (verdict.twist, verdict.reasons) == (ZERO, latched)
        assert (verdict.stage >= Stage.HOLD) is (state.stop is not None)
        latched = verdict.reasons if state.stop else None


@given(WILD)
def test_what_was_changed_has_a_reason(script):
    for (_, asked, *_), (_, verdict, _) in zip(script, replay(script), strict=True):
        if asked is not None and verdict.twist != asked and asked.is_finite() and not _too_old(verdict):
            assert verdict.reasons
        if verdict.stage is not Stage.OBEY:
            assert verdict.twist == ZERO
            assert len(verdict.reasons) == 1


def _too_old(verdict):
    """A set-point from before arming does not count: nothing was asked."""
    return verdict.twist == ZERO and verdict.stage is Stage.OBEY


@given(TAME, st.booleans())
def test_acceleration_and_jerk_are_never_exceeded_but_by_what_stops(script, sudden):
    """Measured from the outputs alone, whatever the pauses between them."""
    well = PlatformState(t_ns=START_NS, engaged=True)
    state, now_ns = GateState(armed_ns=START_NS), START_NS
    rates = None
    for pause_s, twist, age_s in script:
        now_ns += round(pause_s * 1e9)
        before = state
        share = 0.5 if sudden and age_s else None
        robot = PlatformState(t_ns=now_ns, engaged=well.engaged)
        state, verdict = judge(
            LIMITS, state, Setpoint(twist, now_ns - round(age_s * 1e9), share), robot, now_ns
        )
        dt_s = min((now_ns - max(before.last_ns, START_NS)) / 1e9, LONGEST_STEP_S)
        near = Reason.TOO_CLOSE in verdict.reasons or state.target_m < math.inf
        if verdict.stage is not Stage.OBEY or near:
            rates = None
            continue
        change = [b - a for a, b in zip(astuple(before.last), astuple(verdict.twist), strict=True)]
        assert math.hypot(change[0], change[1]) <= LIMITS.accel_m_s2 * dt_s + ROUNDING
        assert abs(change[2]) <= LIMITS.accel_m_s2 * dt_s + ROUNDING
        assert abs(change[3]) <= LIMITS.yaw_accel_rad_s2 * dt_s + ROUNDING
        if dt_s < 0.005:
            rates = None
            continue
        now = [part / dt_s for part in change]
        if rates is not None:
            jerk = [b - a for a, b in zip(rates, now, strict=True)]
            slack = ROUNDING / 0.005
            assert math.hypot(jerk[0], jerk[1]) <= LIMITS.jerk_m_s3 * dt_s + slack
            assert abs(jerk[2]) <= LIMITS.jerk_m_s3 * dt_s + slack
            assert abs(jerk[3]) <= LIMITS.yaw_jerk_rad_s3 * dt_s + slack
        rates = now


@given(st.lists(st.sampled_from([9.0, -9.0]), min_size=20, max_size=60))
def test_a_command_that_jumps_from_end_to_end_is_as_smooth_as_any(signs):
    """The worst that a policy can do, at the link's 50 Hz: from most forward to most backward and back."""
    state, now_ns, rate = GateState(armed_ns=START_NS), START_NS, 0.0
    for sign in signs:
        now_ns += 20_000_000
        before = state.last.vx
        robot = PlatformState(t_ns=now_ns, engaged=True)
        state, _ = judge(LIMITS, state, Setpoint(Twist(sign, yaw_rate=sign), now_ns), robot, now_ns)
        after = (state.last.vx - before) / 0.02
        assert abs(after) <= LIMITS.accel_m_s2 + ROUNDING
        assert abs(after - rate) <= LIMITS.jerk_m_s3 * 0.02 + 1e-6
        rate = after


@given(st.lists(st.tuples(st.floats(-0.4, 0.4), st.none() | st.floats(-0.4, 0.4)), max_size=30))
def test_nothing_moves_by_what_was_seen_too_long_ago_or_not_yet(ages_s):
    state, now_ns = GateState(armed_ns=START_NS), START_NS
    for pause_s, seen_s in ages_s:
        now_ns += round(abs(pause_s) / 4 * 1e9)
        seen_ns = None if seen_s is None else now_ns - round(seen_s * 1e9)
        robot = PlatformState(t_ns=now_ns, engaged=True)
        state, verdict = judge(LIMITS, state, Setpoint(Twist(1.0), now_ns, None, seen_ns), robot, now_ns)
        if seen_ns is not None and not 0 <= now_ns - seen_ns <= LIMITS.sight_timeout_s * 1e9:
            assert (verdict.twist, verdict.reasons) == (ZERO, (Reason.BLIND,))
        else:
            assert verdict.stage is Stage.OBEY


near = st.floats(-3.0, 3.0)
WALKS = st.lists(
    st.tuples(
        st.floats(0.0, 0.4),
        st.none() | st.builds(Pose, near, near, st.just(2.0)) | st.just(Pose(z=2.0)),
        st.none() | st.just(0.9),
        st.integers(-(10**8), 10**8),
    ),
    max_size=30,
)


@given(WALKS)
def test_a_robot_that_is_driven_tells_what_it_told_before_and_moves_as_robots_do(script):
    """Between any two positions there is no more than motion and an estimator's corrections explain."""
    state, now_ns = GateState(armed_ns=START_NS), START_NS
    places: list[tuple[int, Pose]] = []
    battery_told, newest_ns = False, 0
    for pause_s, pose, battery, heard_ns in script:
        now_ns += round(pause_s * 1e9)
        robot = PlatformState(t_ns=now_ns + heard_ns, engaged=True, pose=pose, battery=battery)
        state, _ = judge(LIMITS, state, Setpoint(ZERO, now_ns), robot, now_ns)
        if state.stop is not None:
            return
        assert pose is not None or not places
        assert battery is not None or not battery_told
        assert robot.t_ns >= newest_ns
        battery_told, newest_ns = battery is not None, robot.t_ns
        if pose is None:
            continue
        for then_ns, before in places:
            moved_m = math.dist((pose.x, pose.y, pose.z), (before.x, before.y, before.z))
            most_m = fastest_m_s(LIMITS) * ((now_ns - then_ns) / 1e9 + 0.4 * len(places)) + 2 * JUMP_M
            assert moved_m <= most_m + ROUNDING
        places.append((now_ns, pose))
