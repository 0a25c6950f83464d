"""An action is a share of the robot's limits; what is no number stays none, for the gate to refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.policy.base import FORWARD_YAW, ActionAxis, to_twist

LIMITS = Limits(forward_m_s=2.0, backward_m_s=1.0, yaw_rate_rad_s=0.5, accel_m_s2=2.0, yaw_accel_rad_s2=4.0)


def twist(*values, spec=FORWARD_YAW):
    return to_twist(np.array(values, np.float32), spec, LIMITS)


def test_each_number_is_a_share_with_the_sign_of_its_axis():
    assert twist(0.5, -1.0) == Twist(1.0, yaw_rate=-0.5)
    assert twist(0.5, spec=(ActionAxis(axis="yaw", sign=-1),)) == Twist(yaw_rate=-0.25)
    assert twist(7.0, -9.0) == Twist(2.0, yaw_rate=-0.5)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_no_wish_for_full_speed(value):
    assert not twist(value, 0.0).is_finite()
    assert not twist(0.0, value).is_finite()


def test_a_velocity_is_itself_whatever_the_limits_and_no_more_than_them():
    spec = (ActionAxis(axis="forward", unit="si"), ActionAxis(axis="yaw", sign=-1, unit="si"))
    assert twist(0.75, 0.25, spec=spec) == Twist(0.75, yaw_rate=-0.25)
    assert twist(3.0, -9.0, spec=spec) == Twist(2.0, yaw_rate=0.5)
    assert not twist(math.nan, 0.0, spec=spec).is_finite()
