"""The doctor's verdict on each finding at its limits: fit, could be better, or refused."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.messages import Action
from adatracker_deploy.doctor import machine, timing
from adatracker_deploy.doctor.timing import Lateness
from adatracker_deploy.policy.base import FORWARD_YAW, PolicyInfo

OK, DOUBTED, REFUSED = (True, True), (False, False), (False, True)
HERE = Path("logs")


def verdict(check):
    return check.ok, check.ok or check.blocking


@pytest.mark.parametrize(
    ("check", "expected", "words"),
    [
        (machine.cores_check(2, 0.3), OK, "2, load 0.3"),
        (machine.cores_check(1, 0.0), DOUBTED, "want 2"),
        (machine.cores_check(4, 2.1), DOUBTED, "stop what else runs here"),
        (machine.governor_check(set()), OK, "not adjustable"),
        (machine.governor_check({"performance"}), OK, "performance"),
        (machine.governor_check({"performance", "powersave"}), DOUBTED, "cpupower frequency-set"),
        (machine.realtime_check(False, False), DOUBTED, "rtprio 50"),
        (machine.realtime_check(True, True), OK, "allowed: --realtime, keeps cores awake"),
        (
            machine.realtime_check(True, False),
            OK,
            "allowed: --realtime, cores may sleep; to keep them awake: KERNEL",
        ),
        (machine.clock_check("tsc", 1e-9), OK, "tsc"),
        (machine.clock_check(None, 1e-9), OK, "unknown source"),
        (machine.clock_check("hpet", 1e-9), DOUBTED, "clocksource=tsc"),
        (machine.clock_check("tsc", 1e-2), DOUBTED, "resolution 10000000 ns"),
        (machine.space_check(4_000_000_000, HERE), OK, "4.0 GB free at logs, 1.1 h"),
        (machine.space_check(3_000_000_000, HERE), DOUBTED, "remove old trials"),
        (machine.space_check(200_000_000, HERE), REFUSED, "0.2 GB"),
        (
            timing.lateness_check(Lateness((0.001,) * 100, 0, 0), 20),
            OK,
            "p99 1.0, at most 1.0 ms, no slot missed",
        ),
        (timing.lateness_check(Lateness((0.003,) * 100, 0, 0), 20), DOUBTED, "--realtime"),
        (timing.lateness_check(Lateness((0.001,) * 999 + (0.011,), 0, 0), 20), DOUBTED, "at most 11.0"),
        (timing.lateness_check(Lateness((0.001,) * 100, 2, 2), 20), DOUBTED, "2 slots missed"),
        (timing.lateness_check(Lateness((0.001,) * 100, 3, 3), 20), REFUSED, "3 slots missed"),
        (timing.lateness_check(Lateness((0.001,) * 100, 0, 0, 0.3), 20), OK, "no slot missed"),
        (timing.lateness_check(Lateness((0.001,) * 100, 2, 2, 0.04), 20), DOUBTED, "missed: stop what"),
        (
            timing.lateness_check(Lateness((0.001,) * 100, 2, 2, 0.3), 20),
            DOUBTED,
            "took 0.30 s of its cores: no",
        ),
        (
            timing.policy_check((0.002,) * 50, 10, "cuda"),
            OK,
            "on cuda a tick takes p50 2.00, p99 2.00 ms of 100",
        ),
        (timing.policy_check((0.03,) * 50, 10, "cuda"), DOUBTED, "a smaller network"),
        (timing.policy_check((0.06,) * 50, 10, "cuda"), REFUSED, "a faster machine"),
        (
            timing.perception_check((0.04,) * 50, "model on cpu"),
            OK,
            "p95 40 ms, more with people in it (model on cpu)",
        ),
        (timing.perception_check((0.15,) * 50, "model on cpu"), DOUBTED, "stop the robot"),
        (timing.perception_check((0.35,) * 50, "model on cpu"), REFUSED, "a faster model"),
        (machine.onnxruntime_check({"onnxruntime": "1.32.0"}, ("cpu",)), OK, "onnxruntime 1.32.0, has cpu"),
        (machine.onnxruntime_check({}, ("cpu",)), OK, "of no known package, has cpu"),  # built by hand
        (
            machine.onnxruntime_check({"onnxruntime": "1.32.0", "onnxruntime-gpu": "1.31.0"}, ("cpu",)),
            REFUSED,
            "pip uninstall --yes onnxruntime onnxruntime-gpu && pip install onnxruntime-gpu",
        ),
        (timing.disk_check((0.01,) * 10), OK, "p50 10, at most 10 ms"),
        (timing.disk_check((0.01,) * 9 + (0.2,)), DOUBTED, "--log-dir"),
        (timing.disk_check((1.2,) * 10), REFUSED, "--log-dir"),
        (timing.camera_check(30, (480, 640), 20), OK, "640x480 at 30.0 Hz"),
        (timing.camera_check(14, (480, 640), 20), DOUBTED, "the policy runs at 20 Hz"),
        (timing.camera_check(3, (480, 640), 20), REFUSED, "3.0 Hz"),
    ],
)
def test_each_finding_is_judged_by_its_limit(check, expected, words):
    assert verdict(check) == expected
    assert words in check.message


def test_what_can_be_mended_by_commands_says_which():
    assert machine.governor_check({"powersave"}).fix == "sudo cpupower frequency-set -g performance"
    assert machine.governor_check({"performance"}).fix == ""
    refused, asleep, awake = (
        machine.realtime_check(allowed, awake)
        for allowed, awake in ((False, False), (True, False), (True, True))
    )
    assert "@realtime - rtprio 50" in refused.fix
    assert "cpu_dma_latency" in refused.fix
    assert "cpu_dma_latency" in asleep.fix
    assert "rtprio" not in asleep.fix
    assert awake.fix == ""


@pytest.mark.parametrize("fix", [machine._FIX_PRIORITY, machine._FIX_AWAKE])
def test_the_commands_are_a_shells(fix):
    subprocess.run(["bash", "-n", "-c", fix], check=True)


class Slow:
    """Implements `Policy`: every answer takes this long by the clock it is given."""

    info = PolicyInfo(name="slow", rate_hz=20.0, action=FORWARD_YAW)

    def __init__(self, clock, seconds):
        self.clock, self.seconds = clock, iter(seconds)

    def reset(self, seed=0):
        pass

    def act(self, observation):
        self.clock.advance(next(self.seconds))
        return Action(np.zeros(2, np.float32))


def test_a_policy_that_takes_too_long_makes_the_loop_late_and_miss_slots():
    clock = FakeClock()
    late = timing.measured_lateness(Slow(clock, [0, 0, 0.06, 0.23, 0, 0]), clock, 0.25)
    # The second tick ends 60 ms after its slot: the third is 10 ms late and ends 240 ms after its own.
    np.testing.assert_allclose(late.seconds, (0, 0, 0.010, 0, 0), atol=1e-9)
    assert (late.missed, late.in_a_row) == (4, 4)


def test_what_the_host_took_is_the_eighth_of_the_processors_times(monkeypatch, tmp_path):
    stat = tmp_path / "stat"
    monkeypatch.setattr(machine, "_STAT", stat)
    assert machine.stolen_s() == 0.0  # a system without it
    stat.write_text("cpu  264924 0 11912 176839 927 0 434 3961 0 0\ncpu0 1 2 3 4 5 6 7 8 9 10\n")
    assert machine.stolen_s() == 3961 / os.sysconf("SC_CLK_TCK")


def test_what_the_host_took_is_that_of_the_measurement(monkeypatch):
    clock = FakeClock()
    taken = iter((7.0, 7.25))
    monkeypatch.setattr(timing, "stolen_s", lambda: next(taken))
    assert timing.measured_lateness(Slow(clock, [0] * 6), clock, 0.25).stolen_s == 0.25


def test_the_disk_is_written_where_it_is_said_and_left_as_it_was(tmp_path):
    took = timing.measured_disk(tmp_path)
    assert all(seconds > 0 for seconds in took)
    assert not list(tmp_path.iterdir())


def test_this_machine_has_an_answer_to_everything(tmp_path):
    assert [check.name for check in machine.machine_checks(tmp_path)] == [
        "cores",
        "frequency",
        "real-time priority",
        "clock",
        "disk space",
        "onnxruntime",
    ]
