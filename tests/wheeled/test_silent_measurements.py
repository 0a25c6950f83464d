"""A charge or a place that is not told any more is not told on: the gate then stops the base."""

import dataclasses

import pytest
from wheeled_rig import base_profile, drive, until

from adatracker_deploy.runtime.gate import GateState, Reason, Setpoint, judge


@pytest.fixture
def silent_battery():
    """A base whose battery message comes ten times a second, until `hush` is called."""
    profile = base_profile()
    timing = dataclasses.replace(profile.connection.roles.timing, battery_period_s=0.1)
    roles = dataclasses.replace(profile.connection.roles, timing=timing)
    profile = dataclasses.replace(profile, connection=dataclasses.replace(profile.connection, roles=roles))
    with drive(profile) as (platform, simulator):
        until(lambda: platform.state().battery is not None)

        def hush():
            simulator.simulator.base._battery.due = lambda *_, **__: ()

        yield platform, hush


def test_a_battery_that_falls_silent_is_not_told_on_and_stops_the_base(silent_battery):
    platform, hush = silent_battery
    limits, gate = platform.profile.limits, GateState(armed_ns=platform.clock.now_ns())

    def reasons():
        nonlocal gate
        now_ns = platform.clock.now_ns()
        state = dataclasses.replace(platform.state(), engaged=True, stopped="")
        gate, verdict = judge(limits, gate, Setpoint(platform.state().velocity, now_ns), state, now_ns)
        return verdict.reasons

    assert Reason.BATTERY_LOST not in reasons()
    hush()
    until(lambda: platform.state().battery is None)
    assert Reason.BATTERY_LOST in reasons()
