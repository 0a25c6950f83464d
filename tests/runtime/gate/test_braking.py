"""No robot goes further, after it is told to stop, than its profile's headway and acceleration say."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from gate_rig import LIMITS
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.learning.embodiment import Hovering
from adatracker_deploy.registry import load_platform, load_profile, profile_names
from adatracker_deploy.runtime.gate import GateState, Setpoint, judge
from adatracker_deploy.runtime.gate.braking import fastest_m_s, stopping_s
from adatracker_deploy.sim.bodies import GroundBody

SLOT_S, CRUISE = 0.02, 300


def stop(profile, wanted):
    """Return the speed at which a robot is told to stop, and how far it goes on."""
    limits = replace(profile.limits, altitude_m=None, switched_off=("battery", "position_jumped"))
    body = load_platform(profile.platform).body(profile)
    body = body if isinstance(body, GroundBody) else Hovering(body, 2.0)
    body.reset(Pose(), 1)
    state, path = GateState(armed_ns=0), []
    for slot in range(CRUISE + 200):
        now_ns = round((1 + slot) * SLOT_S * 1e9)
        setpoint = Setpoint(wanted if slot < CRUISE else Twist(), now_ns)
        told = PlatformState(t_ns=now_ns, engaged=True, pose=body.pose, velocity=body.velocity)
        state, verdict = judge(limits, state, setpoint, told, now_ns)
        path.append((body.pose.x, body.pose.y))
        body.step(verdict.twist, SLOT_S)
    at = path[CRUISE]
    speed_m_s = math.dist(path[CRUISE - 25], at) / 25 / SLOT_S
    return speed_m_s, max(math.dist(at, xy) for xy in path[CRUISE:])


@pytest.mark.parametrize("share", [0.25, 1.0, -1.0])
@pytest.mark.parametrize("name", profile_names())
def test_no_body_of_a_rehearsal_needs_more(name, share):
    profile = load_profile(name)
    limits = profile.limits
    speed_m_s, way_m = stop(
        profile, Twist(share * (limits.forward_m_s if share > 0 else limits.backward_m_s))
    )
    assert speed_m_s > 0.1
    assert 0.3 * speed_m_s * limits.headway_s < way_m < speed_m_s * stopping_s(limits, speed_m_s) + 0.02


@given(
    headway_s=st.floats(0.01, 5),
    accel_m_s2=st.floats(0.1, 50),
    speed_m_s=st.floats(0.001, 30),
    age_s=st.floats(0, 1),
)
def test_the_fastest_is_the_speed_whose_stop_fills_the_room(headway_s, accel_m_s2, speed_m_s, age_s):
    limits = replace(LIMITS, headway_s=headway_s, accel_m_s2=accel_m_s2)
    room_m = speed_m_s * (age_s + stopping_s(limits, speed_m_s))
    assert fastest_m_s(limits, room_m, age_s) == pytest.approx(speed_m_s, rel=1e-6)


@pytest.mark.parametrize(
    ("room_m", "fastest"), [(-0.1, 0.0), (0.0, 0.0), (math.nan, 0.0), (math.inf, math.inf)]
)
def test_without_room_it_stands_and_without_anybody_it_goes(room_m, fastest):
    assert fastest_m_s(LIMITS, room_m, 0.1) == fastest
