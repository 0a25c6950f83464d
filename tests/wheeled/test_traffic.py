"""A trial's CAN traffic: every frame both ways, in its order and time, and in the formats of CAN tools."""

import errno
import os
import struct
import threading
import time

import can
import pytest
from wheeled_rig import Tap, base_profile, drive, until

from adatracker_deploy.cli import main
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.adapter import traffic
from adatracker_wheeled.adapter.traffic import FILE_NAME, Traffic, export_traffic
from tests.driving import send_for
from tests.trial.records import START_NS, a_step, a_trial

READERS = {".asc": can.ASCReader, ".blf": can.BLFReader}


def read(path):
    with READERS.get(path.suffix, can.CanutilsLogReader)(path) as messages:
        return list(messages)


def said(message):
    return message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_rx


def message(number=0x221, data=b"\x01\x02", **changes):
    return can.Message(arbitration_id=number, data=data, is_extended_id=number > 0x7FF, **changes)


def written(folder, messages):
    """A closed log of these messages."""
    log = Traffic(MonotonicClock(), "can0")
    log.record(folder)
    for each in messages:
        log.add(each)
    log.close()
    return folder / FILE_NAME


def test_a_drive_is_logged_both_ways_from_connect_to_close(tmp_path):
    profile, clock = base_profile(), MonotonicClock()
    tap = Tap(profile)
    with drive(profile, clock) as (platform, _):
        platform.record(tmp_path)
        platform.engage()
        begun_ns = clock.now_ns()
        send_for(platform, Twist(vx=0.4), 0.5)
        ended_ns = clock.now_ns()
        until(lambda: len(read_so_far(tmp_path)) > 20)  # while it is being written
        platform.disengage()
    logged, heard = read(tmp_path / FILE_NAME), tap.frames()
    tap.close()
    commands = [each for each in logged if not each.is_rx and each.arbitration_id == 0x111]
    moving = [each for each in commands if struct.unpack(">h", each.data[:2])[0] == 400]
    assert len(moving) >= 20
    assert begun_ns <= moving[0].timestamp * 1e9 + 1e3
    assert moving[-1].timestamp * 1e9 <= ended_ns + 3e8  # a command is repeated until it is too old
    assert [said(each)[:2] for each in logged if not each.is_rx] == [
        said(each)[:2] for each in heard if tap.is_demand(each)
    ]
    states = [each for each in logged if each.is_rx and each.arbitration_id == 0x211]
    assert states[0].timestamp * 1e9 < begun_ns  # from before the folder was known
    assert (tmp_path / FILE_NAME).stat().st_mode & 0o777 == 0o600


def read_so_far(folder):
    path = folder / FILE_NAME
    return path.read_text(encoding="ascii").splitlines() if path.exists() else []


KINDS = [
    message(),
    message(0x111, bytes(8), is_rx=False),
    message(0x1ADAFA17, b"\xff", is_rx=False),
    message(0x7FF, b""),
]


@pytest.mark.parametrize("suffix", [".asc", ".blf"])
def test_what_is_exported_is_what_was_logged_at_wall_clock_time(tmp_path, suffix):
    source = written(tmp_path, KINDS)
    out, ahead_ns = tmp_path / f"trial{suffix}", 1_700_000_000_000_000_000
    export_traffic(tmp_path, out, ahead_ns)
    logged, exported = read(source), read(out)
    assert [said(each) for each in logged] == [said(each) for each in KINDS]
    assert [said(each) for each in exported] == [said(each) for each in KINDS]
    gaps = [each.timestamp - exported[0].timestamp for each in exported]
    assert gaps == pytest.approx([each.timestamp - logged[0].timestamp for each in logged], abs=2e-6)
    if suffix == ".blf":
        assert exported[0].timestamp == pytest.approx(logged[0].timestamp + ahead_ns / 1e9, abs=2e-3)


def test_a_log_that_a_kill_cut_is_exported_to_its_last_whole_line(tmp_path):
    source = written(tmp_path, KINDS)
    whole = source.read_bytes()
    for cut in range(len(whole) - 1, len(whole) - 12, -1):
        source.write_bytes(whole[:cut])
        export_traffic(tmp_path, tmp_path / "trial.blf", 0)
        assert len(read(tmp_path / "trial.blf")) == len(KINDS) - 1


def test_a_disk_that_hangs_delays_nobody_and_what_is_lost_is_said(tmp_path, monkeypatch):
    hangs, sync = threading.Event(), os.fdatasync
    monkeypatch.setattr(traffic, "_BACKLOG", 500)
    monkeypatch.setattr(traffic, "_SYNC_S", -1.0)
    monkeypatch.setattr(traffic.os, "fdatasync", lambda fd: hangs.wait(30) and sync(fd))
    log = Traffic(MonotonicClock(), "can0")
    log.record(tmp_path)
    log.add(message(0x100))
    until(lambda: len(read_so_far(tmp_path)) == 1)
    begun_s = time.monotonic()
    for _ in range(2000):
        log.add(message())
    assert time.monotonic() - begun_s < 1.0
    hangs.set()
    log.close()
    assert log.notices() == ("the CAN log lacks 1500 frames: the disk was too slow",)
    assert len(read(tmp_path / FILE_NAME)) == 501


def test_a_full_disk_ends_the_log_and_says_so(tmp_path, monkeypatch):
    def full(_fd):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(traffic.os, "fdatasync", full)
    written(tmp_path, [message()])
    log = Traffic(MonotonicClock(), "can0")
    log.record(tmp_path / "missing")
    log.close()
    (notice,) = log.notices()
    assert "the CAN log ends early" in notice
    log.add(message())  # which nobody keeps any more


def test_without_a_folder_only_the_newest_frames_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(traffic, "_BACKLOG", 10)
    log = Traffic(MonotonicClock(), "can0")
    for number in range(25):
        log.add(message(0x100 + number))
    log.record(tmp_path)
    log.close()
    assert [each.arbitration_id for each in read(tmp_path / FILE_NAME)] == list(range(0x10F, 0x119))
    assert log.notices() == ()


# The command


def test_the_command_exports_on_the_time_of_the_trials_log(tmp_path, capsys):
    folder = a_trial(tmp_path, [a_step(0)], platform="wheeled", now_ns=START_NS)
    (folder / FILE_NAME).write_text(f"({START_NS / 1e9:f}) can0 211#0001 R\n", encoding="ascii")
    out = tmp_path / "trial.blf"
    began_s = folder.stat().st_ctime
    assert main(["export", str(folder), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    (only,) = read(out)
    assert said(only) == (0x211, b"\x00\x01", False, True)
    assert only.timestamp == pytest.approx(began_s, abs=5.0)


@pytest.mark.parametrize(
    ("platform", "out", "told"),
    [
        ("wheeled", "trial.asc", "no can.log in it"),
        ("wheeled", "trial.mf4", "expected a file that ends in .rrd or .asc or .blf"),
        ("drone", "trial.asc", "expected a file that ends in .rrd"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_a_line(tmp_path, capsys, platform, out, told):
    folder = a_trial(tmp_path, [a_step(0)], platform=platform)
    assert main(["export", str(folder), "--out", str(tmp_path / out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_what_is_no_can_log_is_refused(tmp_path):
    (tmp_path / FILE_NAME).write_text("hello\n", encoding="ascii")
    with pytest.raises(UsageError, match=r"can\.log: is not a candump log"):
        export_traffic(tmp_path, tmp_path / "trial.asc", 0)
