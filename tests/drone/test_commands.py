"""FaultCommands as bytes, events as words, modes as names."""

import json

import pytest
from pymavlink.dialects.v20 import common as mavlink

from adatracker_drone.adapter.commands import ARM, DISARM, HOLD, LAND, OFFBOARD, TAKE_OFF, TELL_MODE, rates
from adatracker_drone.adapter.vehicle_state import mode_name
from adatracker_drone.protocol.events import REASONS, number_of, reason_of
from adatracker_drone.protocol.packets import CURRENT_MODE
from adatracker_drone.protocol.px4 import Mode


def fields(order):
    return json.loads(order.to_json(3, 1))


@pytest.mark.parametrize(("order", "mode"), [(OFFBOARD, Mode.OFFBOARD), (HOLD, Mode.HOLD)])
def test_a_mode_is_asked_for_by_px4s_custom_mode(order, mode):
    told = fields(order)
    assert told["command"] == mavlink.MAV_CMD_DO_SET_MODE
    assert told["param1"] == mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert (told["param2"], told["param3"]) == mode.value
    assert (told["target_system"], told["target_component"]) == (3, 1)


@pytest.mark.parametrize("order", [TAKE_OFF, LAND])
def test_a_take_off_and_a_landing_name_no_place(order):
    told = fields(order)
    assert [told[f"param{number}"] for number in range(1, 8)] == [None] * 7  # NaN: PX4 takes where it is


def test_arming_and_disarming_are_never_forced():
    for order, arms in ((ARM, 1), (DISARM, 0)):
        told = fields(order)
        assert (told["command"], told["param1"], told["param2"]) == (400, arms, 0)


def test_the_rates_are_intervals_in_microseconds_and_heartbeats_is_left_alone():
    asked = [(told["command"], told["param1"], told["param2"]) for told in map(fields, rates(20.0))]
    assert asked == [(511, CURRENT_MODE, 50_000), (511, 245, 50_000)]
    assert (fields(TELL_MODE)["command"], fields(TELL_MODE)["param1"]) == (512, 0)


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.RTL])
def test_a_mode_has_its_own_name(mode):
    assert mode_name(mode.custom_mode) == mode.name


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (Mode.RTL.custom_mode, "RETURN_TO_LAUNCH"),
        (4 << 16 | 11 << 24, "EXTERNAL1"),
        (3 << 16 | 1 << 24, "POSCTL"),
        (99 << 16, "UNKNOWN"),
        (4 << 16 | 99 << 24, "UNKNOWN"),
        (0, "UNKNOWN"),
        (2**32 - 1, "UNKNOWN"),
    ],
)
def test_any_number_has_a_name_that_fits_its_place(number, name):
    assert mode_name(number) == name
    assert len(name) <= 23


def test_an_event_is_told_in_px4s_words_and_an_unknown_one_by_its_number():
    assert number_of("foobar") == 0x019CF968  # its FNV-1a is 0xBF9CF968
    assert "offboard signal" in reason_of(number_of("check_modes_offboard_signal"))
    assert reason_of(0x01ABCDEF) == "PX4 event 0x1abcdef"


def test_no_two_events_that_are_known_have_one_number():
    assert len({number_of(name) for name in REASONS}) == len(REASONS)
