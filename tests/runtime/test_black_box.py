"""The black box keeps the link's set-points and actions, whichever process is killed."""

from __future__ import annotations

import os
import signal
import threading
import time
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.runtime import black_box
from adatracker_deploy.runtime.black_box import BlackBox, read_black_box
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import LinkStatus, Phase
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.wire import pack_setpoint, pack_status
from adatracker_deploy.testing.fake import FakePlatform, fake_profile

STATUS = LinkStatus(Phase.ACTIVE, PlatformState(t_ns=5, mode="DRIVE", engaged=True))


def filled(path, count, setpoint=None):
    box = BlackBox(path)
    for number in range(count):
        box.record(setpoint and pack_setpoint(setpoint), pack_status(replace(STATUS, t_ns=number)))
    box.close()
    return path


def times(path):
    return [moment.status.t_ns for moment in read_black_box(path)]


def test_what_was_told_and_done_comes_back(tmp_path):
    setpoint = Setpoint(Twist(vx=0.5, yaw_rate=-0.1), 7, 0.2, 6)
    before_ns = time.monotonic_ns()
    first, *_ = moments = read_black_box(filled(tmp_path / "box", 3, setpoint))
    assert [moment.status for moment in moments] == [replace(STATUS, t_ns=n) for n in range(3)]
    assert first.setpoint == setpoint
    assert before_ns <= first.monotonic_ns <= time.monotonic_ns()
    assert first.boottime_ns >= first.monotonic_ns
    assert (tmp_path / "box").stat().st_mode & 0o777 == 0o600


def test_the_last_half_minute_is_kept_and_no_more(tmp_path, monkeypatch):
    monkeypatch.setattr(black_box, "_SLOTS", 40)
    path = filled(tmp_path / "box", 100)
    assert times(path) == list(range(60, 100))
    assert path.stat().st_size <= 41 * black_box._SLOT_BYTES


@given(st.data())
def test_a_file_that_was_cut_or_changed_gives_what_is_whole(tmp_path_factory, data):
    path = filled(tmp_path_factory.mktemp("box") / "box", 8)
    whole = bytearray(path.read_bytes())
    share = data.draw(st.floats(0, 1))
    place = len(black_box._MAGIC) + round(share * (len(whole) - 1 - len(black_box._MAGIC)))
    if data.draw(st.booleans()):
        whole = whole[:place]
    else:
        whole[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(whole)
    assert set(times(path)) <= set(range(8))


def test_what_is_no_black_box_is_refused(tmp_path):
    (tmp_path / "box").write_bytes(b"something else")
    with pytest.raises(ValueError, match="is not a black box"):
        read_black_box(tmp_path / "box")


def test_a_disk_that_hangs_delays_nobody(tmp_path, monkeypatch):
    hangs = threading.Event()
    monkeypatch.setattr(black_box.os, "pwrite", lambda *_: hangs.wait(30))
    box = BlackBox(tmp_path / "box")
    began_s = time.monotonic()
    for _ in range(2000):
        box.record(None, pack_status(STATUS))
    assert time.monotonic() - began_s < 5.0
    hangs.set()
    box.close()


def test_it_outlives_a_link_that_is_killed(tmp_path):
    clock, path = MonotonicClock(), tmp_path / "box"
    link = LinkProcess(FakePlatform, fake_profile(), clock)
    link.connect()
    link.record(path)
    link.engage()
    deadline_s = time.monotonic() + 30
    while link.status().sent.vx < 0.5:
        assert time.monotonic() < deadline_s
        link.send(Setpoint(Twist(vx=0.5), clock.now_ns()))
        clock.sleep_until(clock.now_ns() + 5_000_000)
    driven_ns = link.status().t_ns
    while not (path.exists() and times(path)[-1:] >= [driven_ns]):
        assert time.monotonic() < deadline_s
        clock.sleep_until(clock.now_ns() + 5_000_000)
    os.kill(link.pid, signal.SIGKILL)
    link.close()
    moments = read_black_box(path)
    assert {Phase.ENGAGING, Phase.ACTIVE} <= {moment.status.phase for moment in moments}
    assert any(moment.status.sent.vx == 0.5 and moment.setpoint.twist.vx == 0.5 for moment in moments)


def test_a_folder_that_cannot_be_written_costs_the_record_alone(tmp_path):
    clock = MonotonicClock()
    with LinkProcess(FakePlatform, fake_profile(), clock) as link:
        link.connect()
        link.record(tmp_path / "missing" / "box")
        link.engage()
        deadline_s = time.monotonic() + 30
        while link.status().phase is not Phase.ACTIVE:
            assert time.monotonic() < deadline_s
            link.send(Setpoint(ZERO, clock.now_ns()))  # or it stops, and may do so unseen
            clock.sleep_until(clock.now_ns() + 5_000_000)
        assert any("no black box" in event.message for event in link.drain_events())
