"""A stop ends whatever a link is doing: engaging too, after a suspend, and on a machine without memory."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import replace

import pytest
from test_link import GO, Rig

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.runtime.gate import Reason
from adatracker_deploy.runtime.link import Link, Phase
from adatracker_deploy.testing.fake import FakeConnection, FakePlatform


class SlowToEngage(FakePlatform):
    """Takes long to engage, and gives up as soon as a stop comes; writes down what it was told."""

    def __init__(self, profile, clock) -> None:
        super().__init__(profile, clock)
        self.told: list[str] = []
        self.asked, self.begins, self.goes_on = (threading.Event() for _ in range(3))

    def engage(self):
        self.asked.set()
        self.goes_on.wait(5)  # the moment between a link's decision to engage and the adapter's own
        self.told.append("engage")
        with self._lock:
            self._consent = True
        self.begins.set()
        while self._consent:
            os.sched_yield()
        raise PlatformError("engaging was stopped")

    def disengage(self):
        self.told.append("disengage")
        super().disengage()


def threaded(platform_class):
    """Return a link whose manoeuvres run in threads, as they do on a robot."""
    rig = Rig(platform_class)
    rig.link = Link(rig.platform, rig.profile.limits, rig.clock, lambda: rig.setpoint)
    return rig


def eventually(condition):
    deadline_s = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline_s
        os.sched_yield()


@pytest.mark.parametrize("stop", ["hold", "disengage"])
def test_a_stop_while_engaging_gives_the_robot_up(stop):
    rig = threaded(SlowToEngage)
    rig.platform.goes_on.set()
    rig.link.engage()
    assert rig.platform.begins.wait(5)
    getattr(rig.link, stop)("enough")
    assert rig.link.status.phase is Phase.DISENGAGING
    eventually(lambda: rig.link.status.phase is Phase.DONE)
    assert rig.link.status.stopped == "enough"
    assert rig.platform.told[-1] == "disengage"
    assert not rig.platform.state().engaged


@pytest.mark.parametrize("stop", ["hold", "disengage"])
def test_a_stop_that_is_quicker_than_the_engage_it_ends_still_ends_it(stop):
    rig = threaded(SlowToEngage)
    rig.link.engage()
    getattr(rig.link, stop)("enough")
    eventually(lambda: "disengage" in rig.platform.told)  # to an adapter that has not begun to engage
    rig.platform.goes_on.set()
    eventually(lambda: rig.link.status.phase is Phase.DONE)
    assert "engage" not in rig.platform.told or rig.platform.told[-1] == "disengage"
    assert not rig.platform._consent


@pytest.mark.parametrize("stop", ["hold", "disengage"])
def test_a_stop_before_the_adapter_begins_to_engage_is_repeated_until_it_has_ended(stop):
    rig = threaded(SlowToEngage)
    rig.link.engage()
    assert rig.platform.asked.wait(5)
    getattr(rig.link, stop)("enough")
    eventually(lambda: "disengage" in rig.platform.told)
    rig.platform.goes_on.set()
    eventually(lambda: "engage" in rig.platform.told)  # which undoes that stop
    eventually(lambda: rig.platform.told[-1] == "disengage" and rig.link.status.phase is Phase.DONE)
    assert not rig.platform._consent


def test_a_tracker_that_falls_silent_while_the_robot_engages_ends_that():
    rig = threaded(SlowToEngage)
    rig.platform.goes_on.set()
    rig.link.engage()
    assert rig.platform.begins.wait(5)
    silence_s = rig.profile.limits.disengage_after_s
    assert rig.step(2 * silence_s, ZERO).phase is Phase.ENGAGING
    assert rig.step(silence_s + 0.1).phase is Phase.DISENGAGING
    assert rig.link.status.reasons == (Reason.COMMAND_LOST,)


@pytest.mark.parametrize("engaging", [False, True])
def test_a_machine_that_was_suspended_sends_nothing_more(engaging):
    rig = threaded(SlowToEngage) if engaging else Rig().driving()
    if engaging:
        rig.platform.goes_on.set()
        rig.link.engage()
    count = len(rig.platform.sent)
    rig.clock.suspend(2.0)
    status = rig.step(0.2, GO)
    assert status.phase in (Phase.HOLDING, Phase.DISENGAGING, Phase.DONE)
    assert (status.reasons, status.stopped) == (
        (Reason.SUSPENDED,),
        "suspended: the machine was suspended for 2.0 s",
    )
    assert all(twist == ZERO for twist in rig.platform.sent[count:])


def test_a_suspend_before_the_engagement_stops_nothing():
    rig = Rig()
    rig.clock.suspend(60.0)
    assert rig.step(0.1).phase is Phase.IDLE
    assert rig.driving().link.status.phase is Phase.ACTIVE


def test_a_robot_is_stopped_without_a_new_thread(monkeypatch):
    rig = threaded(FakePlatform)
    rig.platform.profile = replace(rig.profile, connection=FakeConnection(engage_s=0.0))
    rig.link.engage()
    eventually(lambda: rig.link.status.phase is Phase.ACTIVE)

    def no_memory(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", no_memory)
    assert rig.step(0.1, GO).phase is Phase.ACTIVE
    rig.link.hold("enough")
    eventually(lambda: rig.platform.state().stopped == "enough")
    rig.link.disengage("enough")
    eventually(lambda: rig.link.status.phase is Phase.DONE)


def test_a_robot_that_falls_silent_while_it_engages_is_given_up():
    class Silent(SlowToEngage):
        def state(self):
            return replace(super().state(), t_ns=1)

    rig = threaded(Silent)
    rig.platform.goes_on.set()
    rig.link.engage()
    assert rig.platform.begins.wait(5)
    timeout_s = rig.profile.limits.state_timeout_s
    assert rig.step(timeout_s - 0.1, ZERO).phase is Phase.ENGAGING
    assert rig.step(0.2, ZERO).phase is Phase.DISENGAGING
    assert rig.link.status.reasons == (Reason.STATE_LOST,)
