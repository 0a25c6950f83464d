"""Each fault strikes its target, and is in the log and the ground truth; one due too late is reported."""

from __future__ import annotations

import threading
import time

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.faults import LINK_DROP, known_faults
from adatracker_deploy.faults import injection as module
from adatracker_deploy.faults.injection import Injection
from adatracker_deploy.faults.phases import TrialPhase
from adatracker_deploy.faults.schedule import parse_schedule
from adatracker_deploy.sim.ground_truth import FILE_NAME, GroundTruthRecorder, read_witness

pytestmark = pytest.mark.slow


class Simulator:
    """A simulated robot that keeps the orders it receives."""

    faults = (LINK_DROP,)
    witness = None

    def __init__(self):
        self.orders = []

    def order(self, line):
        self.orders.append(line)


class Log:
    """A trial's log that keeps its events."""

    def __init__(self, folder):
        self.folder, self.messages, self.writer_pid = folder, [], 0
        self.news = threading.Condition()

    def event(self, level, message, _):
        assert level == "warning"
        with self.news:
            self.messages.append(message)
            self.news.notify_all()

    def wait_for(self, message):
        with self.news:
            assert self.news.wait_for(lambda: message in self.messages, 10), self.messages


@pytest.fixture
def log(tmp_path):
    folder = tmp_path / "trial"
    folder.mkdir()
    return Log(folder)


@pytest.fixture
def inject(tmp_path):
    """Give a function that starts an injection of the given faults; it is closed in the end."""
    started = []

    def inject(*texts, flies=False):
        simulator = Simulator()
        strikes = parse_schedule(texts, known_faults(simulator.faults), flies=flies)
        started.append(Injection(strikes, simulator, MonotonicClock(), tmp_path))
        return started[-1], simulator

    yield inject
    for injection in started:
        injection.close()
        injection.close()
    assert not list(tmp_path.glob(".*"))  # its own file is gone, or the trial's


def account_of(log):
    return read_witness((log.folder / FILE_NAME).read_text())


def test_each_fault_is_ordered_or_struck_and_written_down_and_one_after_the_end_is_not(inject, log):
    injection, simulator = inject("link_drop@0,policy_nan@3600")
    injection.attend(log)
    for _ in range(3):  # every tick
        injection.enter("following")
    log.wait_for("fault: link_drop begins")
    injection.enter("stopping")
    injection.outlast()
    injection.settle()
    assert simulator.orders[1:] == ["begin link_drop", "end link_drop"]
    assert simulator.orders[0].startswith("witness /")
    assert log.messages == [
        "fault: link_drop begins",
        "fault: policy_nan was not injected: the trial had ended",
        "fault: link_drop is over",
    ]
    account = account_of(log)
    (began_ns, *begins), (over_ns, *ends) = account.faults
    assert (begins, ends) == (["link_drop", True], ["link_drop", False])
    assert over_ns - began_ns >= LINK_DROP.lasts_s * 1e9
    assert [phase for _, phase in account.phases] == ["following", "stopping"]
    assert account.phase_at(began_ns) == "following"
    assert account.process("tracker")


def test_a_fault_strikes_before_there_is_a_log_and_is_told_when_there_is_one(inject, log):
    injection, simulator = inject("link_drop@connecting")
    injection.enter("connecting")
    end_s = time.monotonic() + 10
    while "begin link_drop" not in simulator.orders:
        assert time.monotonic() < end_s
    injection.attend(log)
    log.wait_for("fault: link_drop begins")
    assert account_of(log).onset_ns("link_drop")


def test_what_comes_in_the_ending_begins_though_the_trial_is_over_and_is_not_waited_for(inject, log):
    injection, _ = inject("link_drop@stopping,link_drop@disengaging+3000")
    injection.attend(log)
    injection.enter("stopping")
    log.wait_for("fault: link_drop begins")
    began_s = time.monotonic()
    injection.outlast()  # the robot is disengaged meanwhile
    assert time.monotonic() - began_s < LINK_DROP.lasts_s / 2
    injection.enter("disengaging")
    injection.settle()
    assert log.messages[-1] == "fault: link_drop is over"
    assert "fault: link_drop was not injected: the trial had ended" in log.messages


def test_between_two_trials_what_is_due_at_once_still_strikes(inject, log, monkeypatch):
    struck = []
    monkeypatch.setitem(module.STRIKES, "interrupt", lambda *_: struck.append("interrupt"))
    injection, _ = inject("interrupt@between")
    injection.attend(log)
    injection.settle()
    injection.enter("between")
    injection.close()
    assert struck == ["interrupt"]


def test_a_drone_is_armed_and_climbs_when_its_own_witness_says_so(inject, log):
    injection, simulator = inject("link_drop@climbing", flies=True)
    injection.attend(log)
    robot = GroundTruthRecorder(log.folder / FILE_NAME)
    robot.flight(0.0, 5.0)  # the flight before
    injection.enter("engaging")
    robot.mode("TAKEOFF", armed=True)
    robot.flight(0.8, 0.4)
    assert "begin link_drop" not in simulator.orders
    robot.flight(0.8, 0.6)
    log.wait_for("fault: link_drop begins")
    assert [phase for _, phase in account_of(log).phases] == ["engaging", "armed", "climbing"]
    robot.close()


@pytest.mark.parametrize("name", sorted(module.STRIKES))
def test_every_strike_is_reached_by_its_name(inject, log, monkeypatch, name):
    struck = []
    monkeypatch.setitem(module.STRIKES, name, lambda _, fault: struck.append(fault.name))
    monkeypatch.setattr(module, "AFTERMATH_S", 0.0)
    injection, _ = inject(f"{name}@looking")
    injection.attend(log)
    injection.enter(TrialPhase.LOOKING)
    log.wait_for(f"fault: {name} begins")
    injection.settle()
    assert struck == [name]
