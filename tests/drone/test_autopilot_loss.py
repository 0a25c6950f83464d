"""PX4's fail-safes and who flies: a lost stream of set-points, a pilot, set-points that prove nothing."""

import math

import pytest
from flight import STILL, Flight, velocity
from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.errors import UsageError
from adatracker_drone.protocol.px4 import Mode, Result
from adatracker_drone.sim.autopilot import Autopilot
from adatracker_drone.sim.settings import SitlSettings

# Offboard: loss


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, Mode.POSCTL), (2, Mode.STABILIZED), (4, Mode.LAND), (5, Mode.HOLD), (3, Mode.RTL)],
)
def test_a_lost_stream_is_acted_upon_after_its_time(action, mode):
    flight = Flight().set("COM_OBL_RC_ACT", action).offboard(velocity(forward=1.0))
    flight.run(2.0, stream=velocity(forward=1.0))
    flight.run(0.9)
    assert flight.mode is Mode.OFFBOARD
    flight.run(0.2)
    assert flight.mode is mode
    assert flight.commander.failsafe
    assert "Failsafe activated" in flight.texts()
    flight.run(2.5)
    assert math.hypot(flight.body.velocity.vx, flight.body.velocity.vy) < 0.3


def test_a_fail_safe_that_disarms_lets_it_fall():
    flight = Flight().set("COM_OBL_RC_ACT", 7).offboard(STILL).run(1.5)
    assert not flight.commander.armed


def test_the_default_action_is_position_mode():
    assert Flight().autopilot.parameters["COM_OBL_RC_ACT"] == 0


def test_a_landing_fail_safe_ends_on_the_ground_disarmed():
    flight = Flight().set("COM_OBL_RC_ACT", 4).offboard(STILL)
    flight.run_until(lambda: flight.autopilot.at_rest)


def test_loss_times_are_wall_seconds_in_a_fast_rehearsal():
    flight = Flight(speed=5.0).hover().run(5.5, stream=STILL)
    flight.switch(Mode.OFFBOARD)
    flight.run(0.5, stream=STILL)
    flight.run(4.8)
    assert flight.mode is Mode.OFFBOARD
    flight.run(0.4)
    assert flight.mode is Mode.POSCTL


def test_set_points_that_come_back_resume_offboard():
    flight = Flight().set("COM_OBL_RC_ACT", 5).offboard(velocity(forward=1.0)).run(1.5)
    assert flight.mode is Mode.HOLD
    flight.run(0.2, stream=velocity(forward=1.0))
    assert flight.mode is Mode.OFFBOARD
    assert not flight.commander.failsafe


def test_set_points_that_come_back_do_not_resume_once_somebody_chose_a_mode():
    flight = Flight().offboard(velocity(forward=1.0)).run(1.5)
    flight.switch(Mode.HOLD)
    assert flight.run(3.0, stream=velocity(forward=1.0)).mode is Mode.HOLD


def test_a_pilot_takes_over_while_set_points_still_come():
    flight = Flight().offboard(velocity(forward=1.0))
    assert flight.switch(Mode.POSCTL) is Result.ACCEPTED
    flight.run(3.0, stream=velocity(forward=1.0))
    assert flight.mode is Mode.POSCTL
    assert math.hypot(flight.body.velocity.vx, flight.body.velocity.vy) < 0.2


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_set_point_with_nothing_finite_is_no_proof_of_life(bad):
    flight = Flight().set("COM_OBL_RC_ACT", 4).offboard(velocity(forward=1.0))
    flight.run(1.2, stream=velocity(bad, bad, bad, bad))
    assert flight.mode is Mode.LAND


def test_a_nan_beside_finite_numbers_stops_that_axis():
    flight = Flight().offboard(velocity(forward=1.0)).run(2.0, stream=velocity(forward=1.0))
    flight.run(3.0, stream=velocity(forward=math.nan))
    assert flight.mode is Mode.OFFBOARD
    assert math.hypot(flight.body.velocity.vx, flight.body.velocity.vy) < 0.1


# The same twice


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others():
    def bytes_of(seed):
        flight = Flight(SitlSettings(), seed=seed).run(1.0)
        flight.arm()
        flight.take_off()
        flight.run(3.0)
        link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        return b"".join(message.pack(link) for _, message in flight.said)

    assert bytes_of(1) == bytes_of(1)
    assert bytes_of(1) != bytes_of(2)


def test_an_unknown_or_impossible_parameter_in_the_settings_is_refused():
    with pytest.raises(UsageError, match="COM_OF_LOSST"):
        Autopilot(SitlSettings(parameters={"COM_OF_LOSST": 1.0}), 0)
    with pytest.raises(UsageError, match="COM_OF_LOSS_T"):
        Autopilot(SitlSettings(parameters={"COM_OF_LOSS_T": -1.0}), 0)
