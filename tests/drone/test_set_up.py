"""An autopilot's parameters are written only after they were shown and agreed to."""

import contextlib
import dataclasses

import pytest
from test_platform_preflight import SAFE
from test_platform_sitl import rehearsal_profile
from watched import Watched, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_drone.adapter.parameter_changes import Change, proposed
from adatracker_drone.adapter.preflight import Parameters, failsafe_checks
from adatracker_drone.adapter.set_up import main, set_up
from adatracker_drone.platform import DronePlatform
from tests.tiers import EXHAUSTIVE

STOCK = {"COM_OF_LOSS_T": 5.0, "COM_OBL_RC_ACT": 0, "COM_RC_OVERRIDE": 1, "GF_ACTION": 1}


def values(changes):
    return {change.name: change.value for change in changes}


def test_what_is_well_is_left_alone():
    assert proposed(SAFE) == ()
    assert proposed(dataclasses.replace(SAFE, COM_OBL_RC_ACT=5, COM_OF_LOSS_T=0.5, GF_ACTION=5)) == ()


def test_what_the_preflight_asks_for_is_proposed_and_then_passes_it():
    now = dataclasses.replace(SAFE, **STOCK)
    wanted = values(proposed(now))
    assert wanted == {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 4, "COM_RC_OVERRIDE": 3, "GF_ACTION": 2}
    mended = dataclasses.replace(now, **wanted)
    assert all(check.ok for check in failsafe_checks(mended))
    assert proposed(mended) == ()


def test_a_parameter_that_this_autopilot_has_not_is_not_written():
    assert proposed(Parameters()) == ()


def test_without_a_terminal_nobody_can_agree(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    assert main([]) == 2
    assert "only after you have agreed" in capsys.readouterr().err


@pytest.fixture
def drone():
    profile, clock = rehearsal_profile(parameters=STOCK), MonotonicClock()
    with contextlib.closing(Watched(profile, clock)) as drone, DronePlatform(profile, clock) as platform:
        platform.connect()
        yield drone, platform


@pytest.mark.slow
def test_nothing_is_written_before_a_yes_and_then_exactly_what_was_shown(drone):
    simulated, platform = drone
    shown, asked = [], []

    def has():
        return {name: simulated.autopilot.parameters[name] for name in STOCK}

    def refuse(question):
        asked.append((question, list(shown)))
        return False

    assert set_up(platform, refuse, shown.append) is False
    ((question, before),) = asked
    assert "4 parameters" in question
    assert [line.split()[0] for line in before] == list(STOCK)
    assert has() == STOCK

    assert set_up(platform, lambda _: has() == STOCK, shown.append) is True
    assert has() == {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 4, "COM_RC_OVERRIDE": 3, "GF_ACTION": 2}
    assert "COM_OBL_RC_ACT   0 -> 4   land when they are lost, instead of: position mode" in shown

    assert set_up(platform, lambda _: pytest.fail("nothing to ask"), shown.append) is True


@EXHAUSTIVE
@pytest.mark.slow
def test_an_armed_drone_is_written_nothing_and_a_value_out_of_range_is_told(drone):
    simulated, platform = drone
    with pytest.raises(PlatformError, match="COM_OBL_RC_ACT"):
        platform.write_parameters([Change("COM_OBL_RC_ACT", 0, 99, int, "")])
    until(lambda: not [check for check in platform.preflight() if check.name == "armable" and not check.ok])
    commander = simulated.autopilot.commander
    commander.armed = True
    until(lambda: platform._flight.vehicle.heard.armed)
    with pytest.raises(PlatformError, match="while the drone is armed"):
        platform.write_parameters(proposed(platform.parameters()))
    assert simulated.autopilot.parameters["COM_OBL_RC_ACT"] == 0
