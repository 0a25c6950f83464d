"""A gamepad's buttons and sticks mean what the Linux Gamepad Specification says, on a real device where there
can be one."""

from __future__ import annotations

import os
import threading
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.teleop import gamepad as ours
from adatracker_deploy.runtime.teleop.gamepad import DEAD_ZONE, Decoder, Travel, gamepad, lacking, stick_share

evdev = pytest.importorskip("evdev")
E = evdev.ecodes
XBOX = Travel(-32768, 32767, 128)
PLAYSTATION = Travel(0, 255)


def event(kind, code, value):
    return evdev.InputEvent(0, 0, kind, code, value)


def a_decoder(**positions):
    travels = {E.ABS_X: XBOX, E.ABS_Y: XBOX, E.ABS_RX: XBOX, E.ABS_RY: XBOX}
    return Decoder(travels, lambda: {getattr(E, name): value for name, value in positions.items()})


def test_our_codes_are_the_kernels():
    names = ("BTN_GAMEPAD", "BTN_EAST", "BTN_TL", "BTN_START", "ABS_X", "ABS_Y", "ABS_RX", "ABS_RY")
    assert [getattr(ours, name) for name in names] == [getattr(E, name) for name in names]
    assert (ours._SYN, ours._KEY, ours._ABS) == (E.EV_SYN, E.EV_KEY, E.EV_ABS)
    assert (ours._SYN_REPORT, ours._SYN_DROPPED) == (E.SYN_REPORT, E.SYN_DROPPED)


@given(st.integers(-40000, 40000), st.sampled_from([XBOX, PLAYSTATION, Travel(0, 1023, 60), Travel(-1, 1)]))
def test_a_sticks_share_is_in_range_odd_and_zero_around_its_centre(value, travel):
    share = stick_share(value, travel)
    assert -1.0 <= share <= 1.0
    assert stick_share(travel.least + travel.most - value, travel) == pytest.approx(-share, abs=1e-12)
    half = (travel.most - travel.least) / 2
    if abs(value - travel.least - half) < DEAD_ZONE * half * 0.999:
        assert share == 0


def test_the_ends_of_a_sticks_travel_are_whole_and_a_broken_range_is_nothing():
    assert [stick_share(end, PLAYSTATION) for end in (0, 255)] == [-1.0, 1.0]
    assert stick_share(5, Travel(3, 3)) == 0.0


def test_up_and_left_are_forward_and_counter_clockwise():
    pushed = [event(E.EV_ABS, code, -32768) for code in (E.ABS_Y, E.ABS_X, E.ABS_RX, E.ABS_RY)]
    assert a_decoder().decode(pushed) == [(axis, 1.0) for axis in ("forward", "lateral", "yaw", "vertical")]


def test_buttons_the_others_of_which_do_nothing():
    pressed = [event(E.EV_KEY, code, 1) for code in (E.BTN_TL, E.BTN_START, E.BTN_EAST, E.BTN_SOUTH)]
    released = [event(E.EV_KEY, code, 0) for code in (E.BTN_TL, E.BTN_START, E.BTN_EAST)]
    assert a_decoder().decode(pressed) == [("dead_man", 1.0), ("give_back", 1.0), ("stop", 1.0)]
    assert a_decoder().decode(released) == [("dead_man", 0.0)]
    assert a_decoder().decode([event(E.EV_KEY, E.BTN_TL, 2)]) == []  # autorepeat is no press


def test_after_lost_events_the_button_counts_as_released_and_the_sticks_are_asked():
    decoder = a_decoder(ABS_Y=32767)
    lost = [event(E.EV_SYN, E.SYN_DROPPED, 0), event(E.EV_KEY, E.BTN_TL, 1), event(E.EV_ABS, E.ABS_Y, -32768)]
    assert decoder.decode(lost) == [("dead_man", 0.0)]
    assert decoder.decode([event(E.EV_SYN, E.SYN_REPORT, 0)]) == [("forward", -1.0)]
    assert decoder.decode([event(E.EV_KEY, E.BTN_TL, 1)]) == [("dead_man", 1.0)]


def test_what_is_no_gamepad_says_what_it_lacks():
    mouse = SimpleNamespace(capabilities=lambda absinfo: {E.EV_KEY: [E.BTN_LEFT], E.EV_REL: [0, 1]})
    assert lacking(mouse) == ["BTN_GAMEPAD", "BTN_TL", "BTN_START", "ABS_Y", "ABS_RX"]


@pytest.mark.parametrize("path", ["/dev/input/event999999", "/dev/null"])
def test_what_cannot_be_read_as_one_is_refused(path):
    with pytest.raises(UsageError, match=path), gamepad(path, print):
        pass


@pytest.mark.skipif(not os.access("/dev/uinput", os.W_OK), reason="no /dev/uinput that may be written")
def test_a_real_input_device_drives_and_is_gone_when_it_is_unplugged():
    info = evdev.AbsInfo(0, -32768, 32767, 0, 128, 0)
    can = {
        E.EV_KEY: [E.BTN_SOUTH, E.BTN_EAST, E.BTN_TL, E.BTN_START],
        E.EV_ABS: [(code, info) for code in (E.ABS_X, E.ABS_Y, E.ABS_RX, E.ABS_RY)],
    }
    came, changed = [], threading.Condition()

    def put(*events):
        with changed:
            came.extend(events)
            changed.notify_all()

    def wait_for(event):
        with changed:
            assert changed.wait_for(lambda: event in came, 10), came

    device = evdev.UInput(can, name="adatracker test gamepad")
    with gamepad(device.device.path, put):
        device.write(E.EV_ABS, E.ABS_Y, -32768)
        device.write(E.EV_KEY, E.BTN_TL, 1)
        device.syn()
        wait_for(("dead_man", 1.0))
        assert ("forward", 1.0) in came
        device.close()
        wait_for(("gone", 1.0))
