"""Injects a schedule of faults into the rehearsal that runs in this process, each at its real place.

Ours are struck here: parts that go wrong, signals to the tracker, the link and the log's writer, and what
takes the processor's time. The others are ordered from the far end, whose place they are.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING

from adatracker_deploy.faults.catalogue import OURS
from adatracker_deploy.faults.parts import FaultyPolicy, FaultySegmenter, FrozenCamera, Switch
from adatracker_deploy.faults.schedule import timeline
from adatracker_deploy.faults.witness import FILE_NAME, Witness

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.faults.catalogue import Fault
    from adatracker_deploy.faults.schedule import Strike
    from adatracker_deploy.perception.camera import Camera
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.platform import Sitl
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.runtime.clock import Clock
    from adatracker_deploy.runtime.link_process import LinkProcess
    from adatracker_deploy.trial.log import TrialLog

AFTERMATH_S = 1.0
"""How long the robot is watched after a fault is over: what was mended must resume nothing."""
HOGS = 4
PAUSE_S = 0.1
"""A full collection of 600,000 objects takes 0.08 s."""
_IN_PARTS = (
    *("camera_freeze", "segmenter_stall", "segmenter_error"),
    *("policy_nan", "policy_inf", "policy_hang", "action_jump"),
)


class Injection:
    """One trial's faults; without any it does nothing at all.

    Args:
        strikes: what shall happen when.
        far_end: the simulated robot's, started.
        clock: the run's, at the machine's own pace.
    """

    def __init__(self, strikes: tuple[Strike, ...], far_end: Sitl, clock: Clock) -> None:
        self._moments = timeline(strikes)
        self._far_end = far_end
        self._clock = clock
        self._switch = Switch(lambda name: self._note(name, begins=True))
        self._theirs = {fault.name for fault in far_end.faults}
        self._witness = Witness()
        self._log: TrialLog | None = None
        self._link: LinkProcess | None = None
        self._ending = threading.Event()
        self._began_s: float | None = None
        self._struck_s: dict[str, float] = {}
        """When each fault last took effect, machine time."""
        self._thread = threading.Thread(target=self._run, name="faults", daemon=True)

    def camera(self, whole: Camera) -> Camera:
        """Return the camera, such that it can freeze; one that the far end carries freezes there."""
        return FrozenCamera(whole, self._switch) if self._moments else whole

    def segmenter(self, whole: Segmenter) -> Segmenter:
        """Return the segmenter, such that it can go wrong."""
        return FaultySegmenter(whole, self._switch) if self._moments else whole

    def policy(self, whole: Policy) -> Policy:
        """Return the policy, such that it can go wrong."""
        return FaultyPolicy(whole, self._switch) if self._moments else whole

    def attend(self, log: TrialLog, link: LinkProcess) -> None:
        """Take note of whom to tell and whom to strike; the robot's witness begins to write."""
        if not self._moments:
            return
        self._log, self._link = log, link
        path = log.folder / FILE_NAME
        self._witness = Witness(path)
        self._far_end.order(f"witness {path.resolve()}")

    def follow(self) -> None:
        """Start to count, at the first followed tick; every later call does nothing."""
        if self._moments and self._began_s is None:
            self._began_s = time.monotonic()
            self._thread.start()

    def outlast(self) -> None:
        """Begin no more faults, and return `AFTERMATH_S` after the last of those that last is over."""
        if self._began_s is None or self._ending.is_set():
            return
        lasts = self._thread.is_alive() and any(moment.fault.lasts_s for moment in self._moments)
        self._ending.set()
        self._thread.join()
        if lasts:
            time.sleep(AFTERMATH_S)

    def close(self) -> None:
        """Leave nothing that is wrong, as far as it is ours; may be called twice."""
        self.outlast()
        self._witness.close()

    def _run(self) -> None:
        assert self._began_s is not None
        on: set[str] = set()
        for moment in self._moments:
            name, due_s = moment.fault.name, self._began_s + moment.at_s
            if moment.begins:
                if not self._ending.wait(max(0.0, due_s - time.monotonic())):
                    on.add(name)
                    self._begin(moment.fault)
                else:
                    self._say(f"fault: {name} was not injected: the trial had ended")
            elif name in on:
                over_s = self._struck_s.get(name, 0.0) + moment.fault.lasts_s  # however late it took effect
                time.sleep(max(0.0, max(due_s, over_s) - time.monotonic()))
                self._end(moment.fault)

    def _begin(self, fault: Fault) -> None:
        name = fault.name
        if name in self._theirs:
            self._note(name, begins=True)
            self._far_end.order(f"begin {name}")
        elif name in _IN_PARTS:
            self._switch.begin(name)  # which notes it when it takes effect
        else:
            self._note(name, begins=True)
            with contextlib.suppress(ProcessLookupError):  # it has ended by itself
                _STRIKES[name](self, fault)

    def _end(self, fault: Fault) -> None:
        name = fault.name
        if name in self._theirs:
            self._far_end.order(f"end {name}")
        self._switch.end(name)
        if name == "link_stop" and self._link is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._link.pid, signal.SIGCONT)
        self._note(name, begins=False)

    def _note(self, name: str, *, begins: bool) -> None:
        """Write it down, before anything happens of which nobody could tell any more."""
        self._witness.fault(name, begins=begins)
        if begins:
            self._struck_s[name] = time.monotonic()
        self._say(f"fault: {name} {'begins' if begins else 'is over'}")

    def _say(self, text: str) -> None:
        if self._log is not None:
            self._log.event("warning", text, self._clock.now_ns())

    def _stop_tracker(self, fault: Fault) -> None:
        me = os.getpid()
        subprocess.Popen(["/bin/sh", "-c", f"sleep {fault.lasts_s:g}; kill -CONT {me}"])
        os.kill(me, signal.SIGSTOP)

    def _strike_link(self, number: signal.Signals) -> None:
        if self._link is not None and self._link.pid:
            os.kill(self._link.pid, number)

    def _hog(self, fault: Fault) -> None:
        burn = f"import time\nend = time.monotonic() + {fault.lasts_s:g}\nwhile time.monotonic() < end: pass"
        for _ in range(HOGS):
            subprocess.Popen([sys.executable, "-c", burn])

    def _pause(self) -> None:
        """Keep the interpreter's lock, as a full collection does, but for a known time on any machine."""
        ctypes.PyDLL(None).usleep(round(PAUSE_S * 1e6))

    def _fill_disk(self) -> None:
        if self._log is None:
            return
        part = self._log.folder / "trial.mcap.part"
        full_bytes = part.stat().st_size
        resource.prlimit(self._log.writer_pid, resource.RLIMIT_FSIZE, (full_bytes, full_bytes))


_STRIKES: dict[str, Callable[[Injection, Fault], None]] = {
    "tracker_stop": Injection._stop_tracker,
    "tracker_kill": lambda _, __: os.kill(os.getpid(), signal.SIGKILL),
    "link_stop": lambda self, _: self._strike_link(signal.SIGSTOP),
    "link_kill": lambda self, _: self._strike_link(signal.SIGKILL),
    "interrupt": lambda _, __: os.kill(os.getpid(), signal.SIGINT),
    "terminate": lambda _, __: os.kill(os.getpid(), signal.SIGTERM),
    "cpu_hogs": Injection._hog,
    "gc_pause": lambda self, _: self._pause(),
    "disk_full": lambda self, _: self._fill_disk(),
}
assert {*_STRIKES, *_IN_PARTS} == {fault.name for fault in OURS}
