"""Runs one trial from connect to close; the parts start in order and always stop in order.

This is the only module that brings together the simulator, the link, the camera, perception, the policy, the
loop and the log.
"""

from __future__ import annotations

import contextlib
import gc
import math
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from adatracker_deploy.app.trial_camera import open_camera, virtual_person
from adatracker_deploy.app.trial_hand import TrialHand
from adatracker_deploy.app.trial_page import CLICK_PATIENCE_S, Clicks, page_start
from adatracker_deploy.core import pause
from adatracker_deploy.core.camera import FilmOverError, scene_of
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Seen
from adatracker_deploy.core.record import RESULTS
from adatracker_deploy.core.task import FIRST_SIGHT_S
from adatracker_deploy.perception.live import LiveCamera
from adatracker_deploy.perception.pipeline import Perception, refuse_hung
from adatracker_deploy.perception.target.choice import BY_CLICK
from adatracker_deploy.policy.by_hand import ByHand
from adatracker_deploy.policy.remote import RemotePolicy
from adatracker_deploy.runtime.black_box import FILE_NAME
from adatracker_deploy.runtime.dry_run import DryRun
from adatracker_deploy.runtime.engagement import Engagement
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.loop import Ending, Loop, stopped_by, unless_stopped
from adatracker_deploy.runtime.operator_stop import StopRequest
from adatracker_deploy.runtime.scheduling import obtained
from adatracker_deploy.runtime.sleep_inhibitor import inhibited
from adatracker_deploy.scoring.tally import Tally
from adatracker_deploy.trial.live_port import app_url, websocket_url
from adatracker_deploy.trial.log import TrialLog

if TYPE_CHECKING:
    from adatracker_deploy.app.trial_plan import TrialPlan
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.faults.injection import Injection
    from adatracker_deploy.platform import Check, Sitl
    from adatracker_deploy.runtime.start_line import StartLine

LOOK_HZ = 200.0
"""Polling rate of a camera that sends by itself, in machine time: a frame waits 5 ms at most."""


class Progress(Protocol):
    """Receives the trial's progress."""

    def phase(self, text: str) -> None:
        """A phase begins."""

    def logging(self, folder: Path) -> None:
        """The trial's log is in this folder."""

    def step(self, record: StepRecord) -> None:
        """A tick is complete."""


def run_trial(
    plan: TrialPlan, progress: Progress, started_s: float, stop: StopRequest | None = None
) -> dict[str, Any]:
    """Run one trial and return its summary, which is also written to the trial's folder.

    Args:
        plan: what to run.
        progress: receives the progress.
        started_s: `time.monotonic` at the start; only used in what is printed.
        stop: remembers stop requests while the trial ends.

    Raises:
        UsageError: a port is taken, a folder cannot be written, an extra is missing; nothing has moved.
        PlatformError: the robot or the policy's server does not answer or is not ready; nothing has moved.
    """
    with contextlib.ExitStack() as stack:
        summary = _Trial(plan, progress, started_s, stop or StopRequest(), stack).run()
    if summary["outcome"] in RESULTS:  # of a trial that was stopped or failed, every trace is kept
        (Path(summary["trial"]) / FILE_NAME).unlink(missing_ok=True)
    return summary


class _Trial:
    def __init__(
        self,
        plan: TrialPlan,
        progress: Progress,
        started_s: float,
        stop: StopRequest,
        stack: contextlib.ExitStack,
    ) -> None:
        self.plan = plan
        self.progress = progress
        self.started_s = started_s
        self.stop = stop
        self.stack = stack
        self.clock = _clock(plan, stack)
        self.tally = Tally()
        self.errors: list[str] = []
        self.injection: Injection | None = None
        """Injects the requested faults; None without any."""

    def run(self) -> dict[str, Any]:
        plan = self.plan
        profile = plan.profile
        _check_parts(plan)
        self.hand = TrialHand(plan.teleop, self.clock, isinstance(plan.policy, ByHand), self.stack)
        if plan.sitl:
            self.progress.phase(f"starting the simulated {plan.platform.name}")
            simulator = self.stack.enter_context(plan.simulator or plan.platform.sitl(profile))
            profile = simulator.start(self.clock, plan.scenario)
            if plan.faults:
                plan = self._injected(simulator)
        robot = DryRun if plan.dry_run else plan.platform
        self.awake = self.stack.enter_context(plan.scheduling.awake())
        moves = not (plan.sitl or plan.dry_run)
        no_sleep = self.stack.enter_context(inhibited("a robot is driven")) if moves else ""
        self.link = self.stack.enter_context(LinkProcess(robot, profile, self.clock, plan.scheduling))
        self._in_phase("connecting")
        self.engagement = Engagement(self.link, self.clock, self._reached)
        camera = self._open_camera(profile)
        unreal = virtual_person(self.plan) if self.drawn and moves else ""
        if unreal:
            self.progress.phase(f"warning: {unreal}")
        self.progress.phase("connecting")
        self._refuse_unready(self.link.connect())
        self.log = TrialLog.create(
            plan.log_dir,
            platform=plan.platform.name,
            kind="dry" if plan.dry_run else "sitl" if plan.sitl else "real",
            policy=plan.policy.info.name,
            steps=plan.steps,
            config=plan.config(profile, self.live.lens if self.live is not None else None),
            now_ns=self.clock.now_ns(),
            live_port=plan.live_port,
            frames=plan.frames,
            page=page_start(plan, profile.limits),
        )
        self.clicks = Clicks(self.log)
        self._show_addresses()
        self.progress.logging(self.log.folder)
        self.link.record(self.log.folder / FILE_NAME)
        if self.log.trouble:
            raise PlatformError(f"the trial cannot be logged: {self.log.trouble}")
        if self.injection is not None:
            self.injection.attend(self.log)
        if unreal:
            self._warn(unreal)
        if moves:
            self._tell(f"sleep of this machine: {f'locked ({no_sleep})' if no_sleep else 'not locked'}")
        for name in profile.limits.switched_off:
            self._warn(f"the gate runs without {name}: profile {profile.name} has it in limits: switched_off")
        try:
            ending = self._engage_and_follow(camera, profile)
        except KeyboardInterrupt:
            ending = Ending("interrupted", "stopped by the operator")
        except FilmOverError as error:
            ending = Ending("completed" if plan.dry_run else "system_fault", str(error))
        except PlatformError as error:
            ending = Ending("system_fault", str(error))
        with self.stop.finishing():
            return self._finish(ending)

    def _show_addresses(self) -> None:
        plan = self.plan
        if plan.page is not None:
            self.progress.phase(f"page: {plan.page.url}")
        if plan.live_port is not None:
            self.progress.phase(f"live view: {websocket_url(plan.live_port)}, or {app_url(plan.live_port)}")

    def _injected(self, simulator: Sitl) -> TrialPlan:
        """Return the plan with its parts wrapped for fault injection."""
        from adatracker_deploy.faults.injection import Injection  # a real robot has no such process

        plan = self.plan
        injection = Injection(plan.faults, simulator, self.clock, plan.log_dir)
        self.injection = injection
        self.stack.callback(injection.close)
        self.plan = replace(
            plan, segmenter=injection.segmenter(plan.segmenter), policy=injection.policy(plan.policy)
        )
        return self.plan

    def _open_camera(self, profile: Profile) -> Camera:
        """Open the camera and check that its frames can be used, before anything moves."""
        uri = self.plan.camera or profile.camera.uri
        self.drawn = scene_of(uri) is not None
        camera = open_camera(
            self.plan, profile, uri, self.clock, self._reported_pose, self.progress.phase, self.stack
        )
        self.live = camera if isinstance(camera, LiveCamera) else None
        return camera if self.injection is None else self.injection.camera(camera)

    def _reported_pose(self) -> Pose | None:
        status = self.link.status()
        return status.state.pose if status else None

    def _refuse_unready(self, checks: tuple[Check, ...]) -> None:
        for check in checks:
            if not check.ok and not check.blocking:
                self.progress.phase(f"warning: {check.name}: {check.message}")
        failed = [f"{check.name}: {check.message}" for check in checks if check.blocking and not check.ok]
        if failed:
            raise PlatformError(f"not ready: {'; '.join(failed)}")

    def _engage_and_follow(self, camera: Camera, profile: Profile) -> Ending:
        plan = self.plan
        if plan.start_line is not None:
            self._await_start(plan.start_line)
        self.progress.phase("engaging")
        self._in_phase("engaging")
        self.stop.insist()
        self.engagement.begin(self.stop.insist)
        plan.segmenter.reset()
        perception = self.stack.enter_context(
            Perception(camera, plan.segmenter, self.clock, LOOK_HZ * self.clock.speed)
        )
        by_click = plan.target == BY_CLICK and not plan.segmenter.needs_truth
        patience_s = CLICK_PATIENCE_S if by_click else FIRST_SIGHT_S
        wanted = "waiting for a click on the person" if by_click else "looking for the person"
        self._tell(f"{wanted}, for {patience_s:g} s at most")
        self._in_phase("looking")
        if ending := self._await_first_sight(perception, patience_s):
            return ending
        self.perception = perception
        plan.policy.reset(plan.scenario.seed)
        camera.go()
        self.hand.refuse_gone()
        self.progress.phase(f"following for {plan.steps} steps at {plan.policy.info.rate_hz:g} Hz")
        loop = Loop(
            observe=partial(self._observe, perception),
            policy=plan.policy,
            link=self.link,
            limits=profile.limits,
            clock=self.clock,
            write=self._write,
            operator=self.hand.operator,
        )
        gc.collect()
        gc.freeze()  # a full collection of a warm process takes longer than a tick may be late
        try:
            with plan.scheduling.while_looping():
                if plan.scheduling:
                    self._tell(f"loop: {obtained()}; link: {obtained(self.link.pid)}")
                if plan.scheduling.realtime:
                    self._tell(f"cores {'are kept awake' if self.awake else 'may sleep'}")
                self.engagement.stand_by()  # the previous steps may have taken a while
                return loop.run(plan.steps)
        finally:
            gc.unfreeze()

    def _await_start(self, start_line: StartLine) -> None:
        """Wait, connected and not engaged, until all robots of the fleet are."""
        self.progress.phase("ready")
        start_line.reach()
        for _ in self.engagement.statuses(math.inf):
            self.stop.insist()
            if start_line.open():
                return

    def _await_first_sight(self, perception: Perception, patience_s: float) -> Ending | None:
        """Wait, standing still, until the target is seen; return why the link stopped the robot meanwhile."""
        deadline_s = time.monotonic() + patience_s
        for status in self.engagement.statuses(math.inf):
            self.stop.insist()
            if ending := stopped_by(status):
                return ending
            self.engagement.stand_by()
            try:
                seen = unless_stopped(perception.newest, self.link, status)
            except FilmOverError as error:  # not the end of a trial: none had begun
                raise PlatformError(f"no person was seen before the end: {error}") from error
            if isinstance(seen, Ending):
                return seen
            if seen is not None and self.plan.page is not None:
                self.log.look(seen.frame, seen.observation, self.clock.now_ns())
                self._take_clicks(perception, seen)
            if seen is not None and seen.observation.box is not None:
                break
            if time.monotonic() > deadline_s:
                raise PlatformError(f"no person was seen within {patience_s:g} s")
        return None

    def _observe(self, perception: Perception, patience_s: float) -> Seen | None:
        self.stop.insist()
        return perception.newest(patience_s)

    def _take_clicks(self, perception: Perception, seen: Seen) -> None:
        """Hand the operator's clicks to perception, and tell what became of the last."""
        self.clicks.pass_on(perception)
        news, warns = self.clicks.news(seen.observation)
        if news:
            (self._warn if warns else self._tell)(news)

    def _write(self, record: StepRecord, seen: Seen) -> None:
        self._in_phase("following")
        news, warns = self.hand.news(record)
        if news:
            (self._warn if warns else self._tell)(news)
        if self.plan.page is not None:
            self._take_clicks(self.perception, seen)
        self.tally.add(record)
        self.log.step(record, seen.frame, seen.observation)
        self._log_events()
        self.progress.step(record)

    def _reached(self, what: str) -> None:
        self.progress.phase(f"{what} {time.monotonic() - self.started_s:.1f} s after the start")

    def _tell(self, message: str) -> None:
        self.progress.phase(message)
        self.log.event("info", message, self.clock.now_ns())

    def _warn(self, message: str) -> None:
        self.progress.phase(f"warning: {message}")
        self.log.event("warning", message, self.clock.now_ns())

    def _log_events(self) -> None:
        for event in self.link.drain_events():
            self.log.event(event.level, event.message, event.t_ns)
            if event.level != "info":
                self.progress.phase(f"{event.level}: {event.message}")
            if event.level == "error":
                self.errors.append(event.message)

    def _finish(self, ending: Ending) -> dict[str, Any]:
        """Bring the robot to rest, close the log and sum up."""
        self.progress.phase(f"{ending.outcome}{': ' if ending.reason else ''}{ending.reason}; stopping")
        self.log.event("info", f"{ending.outcome} {ending.reason}".strip(), self.clock.now_ns())
        self._in_phase("stopping")
        stop_s = None
        try:
            stop_s = self.engagement.stand_still(ending.outcome)
            if self.injection is not None:
                self.injection.outlast()  # held, with everything in place: what is mended resumes nothing
            self.progress.phase("disengaging")
            self._in_phase("disengaging")
            self.engagement.end(ending.outcome)
        except PlatformError as error:
            self.progress.phase(f"warning: {error}")
            self.log.event("error", str(error), self.clock.now_ns())
        if self.injection is not None:
            self.injection.settle()
        self._log_events()
        if self.errors and ending.outcome == "completed":
            ending = Ending("system_fault", self.errors[-1])  # a drone that did not land is no success
        summary = self.tally.summary(
            platform=self.plan.platform.name,
            policy=self.plan.policy.info.name,
            outcome=ending.outcome,
            reason=ending.reason,
            steps=self.plan.steps,
            stop_s=stop_s,
            trial=self.log.folder,
        )
        if trouble := self.hand.keep(self.log.folder):
            self.progress.phase(f"warning: {trouble}")
        self.log.close(summary)
        if self.log.trouble:
            self.progress.phase(f"warning: the log is incomplete: {self.log.trouble}")
        self._in_phase("between")
        return summary

    def _in_phase(self, name: str) -> None:
        """Tell the fault injection that a phase begins."""
        if self.injection is not None:
            self.injection.enter(name, self.link)


def _check_parts(plan: TrialPlan) -> None:
    """Check what an earlier trial with the same parts may have left behind."""
    refuse_hung(plan.segmenter)
    if isinstance(plan.policy, RemotePolicy):
        plan.policy.check()


def _clock(plan: TrialPlan, stack: contextlib.ExitStack) -> MonotonicClock:
    """Return the run's clock; one that can be paused when a suspend is to be simulated."""
    if not any(strike.fault.name == "suspend" for strike in plan.faults):
        return MonotonicClock(speed=plan.speed)
    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="adatracker-pause-"))
    path = f"{folder}/pause"
    pause.create(path)
    return MonotonicClock(speed=plan.speed, pause=path)
