"""Injects a schedule of faults into the rehearsal in this process, each where it would really occur.

Faults of our processes are injected here (`parts`, `strikes`); the others are commanded to the simulator. A
thread waits for each fault's phase and time, so that injection does not depend on what the trial does then.
"""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.faults import OURS
from adatracker_deploy.faults.parts import FaultyPolicy, FaultySegmenter, FrozenCamera, Switch
from adatracker_deploy.faults.phases import ENDING, IN_FLIGHT, TrialPhase
from adatracker_deploy.faults.schedule import next_due
from adatracker_deploy.faults.strikes import MENDS, STRIKES, Victims
from adatracker_deploy.faults.take_off import TakeOff
from adatracker_deploy.sim.ground_truth import FILE_NAME, GroundTruthRecorder, read_witness

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import MonotonicClock
    from adatracker_deploy.core.faults import Fault
    from adatracker_deploy.faults.schedule import ScheduledFault
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.platform import Sitl
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.runtime.link_process import LinkProcess
    from adatracker_deploy.trial.log import TrialLog

NAP_S = 0.01
WORTH_TELLING_S = 0.05


class InterpreterWatch:
    """Monitors until closed.

    Args:
        stood: called, in its own thread, with the length, s, of a stall that has just ended.
    """

    def __init__(self, stood: Callable[[float], None]) -> None:
        self._stood = stood
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="interpreter", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop monitoring."""
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        woke_s = time.monotonic()
        while not self._ended.wait(NAP_S):
            now_s = time.monotonic()
            if now_s - woke_s - NAP_S > WORTH_TELLING_S:
                self._stood(now_s - woke_s - NAP_S)
            woke_s = now_s


AFTERMATH_S = 1.0
"""Time for which the robot is monitored after a fault: the fault's end must not restart any motion."""
_FIRST_WORDS = 1000
IN_PARTS = (
    *("camera_freeze", "segmenter_stall", "segmenter_error"),
    *("policy_nan", "policy_inf", "policy_hang", "action_jump"),
)
assert {*STRIKES, *IN_PARTS} == {fault.name for fault in OURS}


class Injection:
    """One trial's faults, and the ground-truth record of their effect.

    Args:
        strikes: what to inject, and when.
        simulator: the simulated robot's, already started.
        clock: the run's, in real time.
        log_dir: where ground truth is written until the trial has a folder; an existing folder is kept.
    """

    def __init__(
        self, strikes: tuple[ScheduledFault, ...], simulator: Sitl, clock: MonotonicClock, log_dir: Path
    ) -> None:
        self._to_come = list(strikes)
        self._simulator, self._clock = simulator, clock
        self._theirs = {fault.name for fault in simulator.faults}
        self._switch = Switch(lambda name: self._note(name, begins=True))
        self._log: TrialLog | None = None
        self._link: LinkProcess | None = None
        self._untold: list[str] = []
        """Messages from before there was a log."""
        self._news = threading.Condition()
        self._entered: dict[TrialPhase, float] = {}
        """Start of each phase, machine time, s."""
        self._ongoing: dict[str, tuple[float, ScheduledFault]] = {}
        """Active faults, and the earliest end of each; infinite while it is being injected."""
        self._struck_s: dict[str, float] = {}
        """Last onset of each fault, machine time, s."""
        self._ended = False
        self._own_file = None if simulator.witness else log_dir / f".{os.getpid()}-{time.monotonic_ns()}"
        self._file = simulator.witness or self._new_file(log_dir)
        self._witness = GroundTruthRecorder(self._file)
        self._witness.process("tracker")
        self._interpreter = InterpreterWatch(self._witness.stood)
        climbs = any(strike.phase in IN_FLIGHT for strike in strikes)
        self._take_off = TakeOff(self._file, self.enter) if climbs else None
        self._thread = threading.Thread(target=self._run, name="faults", daemon=True)
        self._thread.start()

    def camera(self, whole: Camera) -> Camera:
        """Return the camera wrapped so that it can freeze; a simulator's own camera freezes in the
        simulator."""
        return FrozenCamera(whole, self._switch)

    def segmenter(self, whole: Segmenter) -> Segmenter:
        """Return the segmenter wrapped for fault injection."""
        return FaultySegmenter(whole, self._switch)

    def policy(self, whole: Policy) -> Policy:
        """Return the policy wrapped for fault injection."""
        return FaultyPolicy(whole, self._switch)

    def attend(self, log: TrialLog) -> None:
        """Note where to report; from now on ground truth is in the trial's folder."""
        self._log = log
        with contextlib.suppress(OSError):  # a file system without hard links
            (log.folder / FILE_NAME).hardlink_to(self._file)
        for text in self._untold:
            self._say(text)

    def enter(self, name: str, link: LinkProcess | None = None) -> None:
        """Note that the trial has entered a phase; repeated calls do nothing."""
        phase = TrialPhase(name)
        with self._news:
            if phase in self._entered:
                return
            if link is not None and self._link is None:
                self._witness.process("link", link.pid)  # even before it has its name
            self._link = link or self._link
            self._witness.phase(phase)
            self._entered[phase] = time.monotonic()
            self._news.notify_all()
        if phase is TrialPhase.ENGAGING and self._take_off is not None:
            self._take_off.watch()

    def outlast(self) -> None:
        """Wait until `AFTERMATH_S` after the end of the last lasting fault that began before the trial's end.

        Faults scheduled before the trial's end are no longer injected.
        """
        with self._news:
            late = [strike for strike in self._to_come if strike.phase not in ENDING]
            self._give_up(late)
            lasted = self._news.wait_for(self._no_fault_lasts, 0)
            self._news.wait_for(self._no_fault_lasts)
        if not lasted:
            time.sleep(AFTERMATH_S)

    def settle(self) -> None:
        """Wait until all active faults are over; only faults between two trials may still begin."""
        with self._news:
            self._give_up([strike for strike in self._to_come if strike.phase is not TrialPhase.BETWEEN])
            self._news.wait_for(lambda: not self._ongoing)

    def close(self) -> None:
        """End all faults of our own processes; may be called twice."""
        self.settle()
        with self._news:
            if TrialPhase.BETWEEN not in self._entered:
                self._give_up(list(self._to_come))
            self._ended = True
            self._news.notify_all()
        self._thread.join()
        self._interpreter.close()
        if self._take_off is not None:
            self._take_off.close()
        self._witness.close()
        if self._own_file is not None:
            self._own_file.unlink(missing_ok=True)

    def _new_file(self, log_dir: Path) -> Path:
        """Create a ground-truth file, and have the simulator write there too."""
        assert self._own_file is not None
        log_dir.mkdir(parents=True, exist_ok=True)
        GroundTruthRecorder(self._own_file).close()
        self._simulator.order(f"witness {self._own_file.resolve()}")
        return self._own_file

    def _no_fault_lasts(self) -> bool:
        return all(strike.phase in ENDING for _, strike in self._ongoing.values())

    def _give_up(self, strikes: list[ScheduledFault]) -> None:
        for strike in strikes:
            self._to_come.remove(strike)
            self._say(f"fault: {strike.fault.name} was not injected: the trial had ended")
        self._news.notify_all()

    def _run(self) -> None:
        while (moment := self._next()) is not None:
            strike, begins = moment
            began_s, name = time.monotonic(), strike.fault.name
            if begins:
                self._begin(strike.fault)
            else:
                self._end(strike.fault)
            with self._news:
                if begins and strike.fault.lasts_s:
                    self._ongoing[name] = began_s + strike.fault.lasts_s, strike
                else:
                    del self._ongoing[name]
                self._news.notify_all()

    def _next(self) -> tuple[ScheduledFault, bool] | None:
        """Wait for the next change; return the fault and whether it begins, or None when there are no
        more."""
        with self._news:
            while True:
                now_s = time.monotonic()
                begins = next_due(self._to_come, self._entered)
                over_s, over = min(
                    ((self._over_s(name), strike) for name, (_, strike) in self._ongoing.items()),
                    key=lambda pair: pair[0],
                    default=(math.inf, None),
                )
                if over is not None and over_s <= now_s:
                    return over, False
                if begins is not None and begins[0] <= now_s:
                    self._to_come.remove(begins[1])
                    self._ongoing[begins[1].fault.name] = math.inf, begins[1]
                    return begins[1], True
                if self._ended and over is None and begins is None:
                    return None
                due_s = min(over_s, begins[0] if begins is not None else math.inf)
                self._news.wait(due_s - now_s if due_s < math.inf else None)

    def _over_s(self, name: str) -> float:
        """Return when a fault is over; a fault in `parts` lasts from when it took effect, however late."""
        at_least_s, strike = self._ongoing[name]
        return max(at_least_s, self._struck_s.get(name, 0.0) + strike.fault.lasts_s)

    def _begin(self, fault: Fault) -> None:
        name = fault.name
        if name in self._theirs:
            self._note(name, begins=True)
            self._simulator.order(f"begin {name}")
        elif name in IN_PARTS:
            self._switch.begin(name)  # which records it when it takes effect
        else:
            victims = self._victims()
            self._note(name, begins=True)
            with contextlib.suppress(ProcessLookupError):  # it has ended by itself
                STRIKES[name](victims, fault)

    def _end(self, fault: Fault) -> None:
        name = fault.name
        if name in self._theirs:
            self._simulator.order(f"end {name}")
        self._switch.end(name)
        if name in MENDS:
            with contextlib.suppress(ProcessLookupError):
                MENDS[name](self._victims())
        self._note(name, begins=False)

    def _victims(self) -> Victims:
        log, link = self._log, self._link
        return Victims(
            link=link.pid if link is not None else 0,
            robot=self._robot(),
            log_writer=log.writer_pid if log is not None else 0,
            log_part=log.folder / "trial.mcap.part" if log is not None else None,
            pause=self._clock.pause,
        )

    def _robot(self) -> int:
        """Return the robot's process id, the first entry of its ground-truth record; 0 if missing."""
        with self._file.open() as file:
            return read_witness(file.read(_FIRST_WORDS)).process("robot") or 0

    def _note(self, name: str, *, begins: bool) -> None:
        """Record it before anything happens that could prevent the record."""
        self._witness.fault(name, begins=begins)
        if begins:
            self._struck_s[name] = time.monotonic()
        self._say(f"fault: {name} {'begins' if begins else 'is over'}")

    def _say(self, text: str) -> None:
        if self._log is None:
            self._untold.append(text)
        else:
            self._log.event("warning", text, self._clock.now_ns())
