"""A camera that hangs, freezes or changes its size is told from one that works, by frames and time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from streams import picture

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.perception.frame_monitor import FROZEN_AFTER_S, SILENT_AFTER_S, FrameMonitor

TRUTH = Truth(np.zeros((48, 64), np.uint8), Pose(), Pose(), (1.0, 0.0), 1.0, 0.0)


def frame(t_s, seed=0, **changes):
    return replace(Frame(picture(seed), round(t_s * 1e9), 1), **changes)


def show(watch, *frames):
    for each in frames:
        watch.accept(each, each.t_ns)


def test_a_camera_that_has_given_nothing_yet_is_not_judged():
    FrameMonitor("eye").refuse_dead(10**12)


@given(st.floats(0.1, 20))
def test_silence_is_measured_in_machine_time_at_any_speed_of_the_clock(speed):
    watch = FrameMonitor("eye", speed)
    watch.accept(frame(5.0), 5 * 10**9)
    watch.refuse_dead(round((5.0 + 0.99 * SILENT_AFTER_S * speed) * 1e9))
    with pytest.raises(PlatformError, match=r"camera eye: no picture has come for 2\.0 s"):
        watch.refuse_dead(round((5.0 + 1.01 * SILENT_AFTER_S * speed) * 1e9))


def test_the_very_same_picture_for_almost_two_seconds_is_a_frozen_camera():
    watch = FrameMonitor("eye")
    show(watch, *(frame(t_s) for t_s in (1.0, 1.5, 2.0, 2.5, 2.7)))
    watch.refuse_dead(round(2.9e9))
    show(watch, frame(1.1 + FROZEN_AFTER_S))
    with pytest.raises(PlatformError, match=r"the very same picture for 1\.9 s: it hangs or is covered"):
        watch.refuse_dead(round(2.9e9))


def test_a_picture_that_repeats_the_last_one_shows_nothing_new():
    watch = FrameMonitor("eye")
    pictures = [frame(t_s / 10, seed) for t_s, seed in enumerate((1, 1, 2, 2, 1, 1))]
    assert [watch.accept(each, each.t_ns) for each in pictures] == [True, False, True, False, True, False]
    assert all(FrameMonitor("eye").accept(frame(1.0, truth=truth), 10**9) for truth in (TRUTH, None))
    assert watch.accept(frame(2.0, 1, truth=TRUTH), 2 * 10**9)


def test_one_changed_pixel_shows_that_the_camera_lives():
    watch = FrameMonitor("eye")
    changed = picture()
    changed[3, 4, 1] ^= 1
    show(watch, frame(1.0), frame(2.7), frame(2.8, rgb=changed), frame(4.5, rgb=changed))
    watch.refuse_dead(round(4.6e9))


def test_a_rehearsal_may_stand_still():
    watch = FrameMonitor("eye")
    show(watch, *(frame(t_s, truth=TRUTH) for t_s in range(1, 20)))
    watch.refuse_dead(19 * 10**9)


def test_a_picture_of_another_size_ends_the_camera():
    watch = FrameMonitor("eye")
    watch.accept(frame(1.0), 10**9)
    with pytest.raises(PlatformError, match="size changed from 64x48 to 80x60 px"):
        watch.accept(frame(1.1, rgb=picture(size=(60, 80))), 11 * 10**8)


@given(st.floats(0.1, 20))
def test_a_picture_that_is_long_past_ends_the_camera_however_newly_it_came(speed):
    watch = FrameMonitor("eye", speed)
    watch.accept(frame(5.0 - 1.9 * speed), 5 * 10**9)
    watch.refuse_dead(5 * 10**9)
    watch.accept(frame(6.0 - 2.1 * speed, 1), 6 * 10**9)
    with pytest.raises(PlatformError, match=r"camera eye: by its time stamps its pictures come 2\.1 s late"):
        watch.refuse_dead(6 * 10**9)
