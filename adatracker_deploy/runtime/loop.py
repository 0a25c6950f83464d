"""The loop: observe, act, command, write down; at absolute deadlines, until the trial ends."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, TargetState
from adatracker_deploy.core.record import BY_HAND, BY_POLICY, Latency, Outcome, StepRecord
from adatracker_deploy.core.task import MAX_LOST_STEPS, target_visible
from adatracker_deploy.policy.base import STALE_OBSERVATION_S, NoAnswer, Policy, to_twist
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import LinkStatus, Phase
from adatracker_deploy.runtime.pacer import Pacer, Tick
from adatracker_deploy.runtime.phase import WAIT, earlier_s
from adatracker_deploy.runtime.pulse import LINK_LOST
from adatracker_deploy.runtime.teleop.takeover import HAND_ACTION, Wish
from adatracker_deploy.runtime.trace import Handed, Trace
from adatracker_deploy.runtime.unseen import Unseen

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Action, Answer, Seen
    from adatracker_deploy.runtime.trace import Handed

MISSED_IN_A_ROW = 3
"""So many slots missed in a row end the trial, at any rate of the policy; counted in machine time.

At 20 Hz no command has then come for 0.2 s, by when the gate sends zero: the robot has begun to stop
for want of commands, and what has begun to stop does not go on by itself."""
BLIND_S = 2.0
"""Without an observation and an answer fresh enough to act on for this long the trial ends. Machine time."""

BY_NOBODY = Wish(False)
"""No hand drives."""


class Commands(Protocol):
    """The loop's side of a link."""

    def send(self, setpoint: Setpoint) -> None:
        """Publish a set-point."""

    def status(self) -> LinkStatus | None:
        """Return what the link did last."""

    def alive(self) -> bool:
        """Tell whether the link still runs."""


class Operator(Protocol):
    """The loop's side of an operator's hand."""

    def at(self, t_ns: int) -> Wish:
        """Return whether the hand drives at a tick, and what it asks for; times never run backwards."""


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of a trial."""

    outcome: Outcome
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """One trial's loop over parts that are already running."""

    observe: Callable[[float], Seen | None]
    """Returns the newest observation; may wait for one that is due, so many seconds of the machine's."""
    policy: Policy
    link: Commands
    limits: Limits
    clock: Clock
    write: Callable[[StepRecord, Seen], None]
    """Takes every tick's record, once the link has answered; must not block."""
    operator: Operator | None = None
    """Can take over from the policy, which is asked all the same: what it remembers follows what is seen."""

    def run(self, steps: int) -> Ending:
        """Run at the policy's rate until the trial ends.

        Where the operator has chosen another target that has not been seen yet, the policy is not asked, and
        zero is commanded.

        The first tick's box is the reference that scoring measures against, so a whole trial has
        `steps` + 1 ticks, numbered from 0. A tick is written when the link has said what became of its
        command, which is usually at the next tick; however the trial ends, every tick is written.
        """
        trace = Trace()
        try:
            return self._follow(steps, trace)
        finally:
            self._write(trace.settled(self.link.status(), patience=0))

    def _follow(self, steps: int, trace: Trace) -> Ending:  # noqa: PLR0911 -- each way to end is one
        pacer, period_s = Pacer(self.clock, self.policy.info.rate_hz), 1.0 / self.policy.info.rate_hz
        unseen, fresh_ns = Unseen(), self.clock.now_ns()
        acted_on_ns = fresh_ns  # when the picture was taken that was last acted on
        for step in range(steps + 1):
            tick = pacer.wait(self._patience)
            status = self.link.status()
            if not self.link.alive() or status is None:
                return Ending("system_fault", LINK_LOST)
            if ending := self._stopped(tick, status):
                return ending
            slot_ns, seen = tick.t_ns, self._look(period_s * WAIT / self.clock.speed, status)
            if isinstance(seen, Ending):
                return seen
            tick = replace(tick, t_ns=self.clock.now_ns())
            if ending := self._blind(tick, seen, fresh_ns):
                return ending
            pacer.shift(earlier_s(seen, slot_ns, period_s))
            stale = self._age_s(tick, seen.frame.t_ns) > STALE_OBSERVATION_S
            chooses = not stale and seen.observation.target is TargetState.CHOOSING
            action, infer_ms = (None, 0.0) if stale or chooses else self._act(tick, seen, status)
            if action:
                acted_on_ns = action.answer.t_ns if action.answer else seen.frame.t_ns
            box = seen.observation.box if action else None
            hand = self.operator.at(tick.t_ns) if self.operator else BY_NOBODY
            if hand.drives:  # by the operator's own eyes: no frame is too old for that
                command = to_twist(np.array(hand.values), HAND_ACTION, self.limits) if hand.values else ZERO
                seen_ns = None
            else:
                command = to_twist(action.values, self.policy.info.action, self.limits) if action else ZERO
                # A late policy is as blind as a camera.
                seen_ns = seen.frame.t_ns if stale or chooses else acted_on_ns
            setpoint = Setpoint(
                command,
                tick.t_ns,
                target_share=box.covered if box else None,
                seen_ns=seen_ns,
                held_until_ns=hand.held_until_ns,
                others_share=None if stale else seen.observation.others_share,
            )
            handed_ns = self.clock.now_ns()
            self.link.send(setpoint)
            record = _record(
                step=step,
                tick=tick,
                seen=seen,
                setpoint=setpoint,
                status=status,
                action=action,
                stale=action is None and not chooses,
                hand=hand,
                latency=_latency(tick, seen, infer_ms, handed_ns, action.answer if action else None),
                missed_deadlines=pacer.missed,
            )
            trace.hand_over(record, seen, handed_ns)
            self._write(trace.settled(status))
            if action or chooses:
                fresh_ns = tick.t_ns
                unseen.add(seen)
            elif ending := self._unanswered(tick, fresh_ns):
                return ending
            if hand.drives:
                unseen = Unseen()  # whoever drives there may well have lost sight of the target
            if ending := _result(unseen, seen):
                return ending
        return Ending("completed")

    def _write(self, ticks: list[Handed]) -> None:
        for tick in ticks:
            self.write(tick.record, tick.seen)

    def _look(self, patience_s: float, status: LinkStatus) -> Seen | Ending:
        """Return what is seen, or why the trial is over."""
        seen = unless_stopped(lambda: self.observe(patience_s), self.link, status)
        return seen or Ending("system_fault", "the camera has given no frame")

    def _stopped(self, tick: Tick, status: LinkStatus) -> Ending | None:
        """Say why the trial is over whatever is seen; None while it is not.

        Before the camera is asked: a process that stood still finds it silent, too, which is not the cause.
        """
        if ending := stopped_by(status):
            return ending
        if tick.skipped >= self._patience:
            return Ending("safety_stop", f"deadlines_missed: {tick.skipped} slots in a row")
        return None

    def _blind(self, tick: Tick, seen: Seen, fresh_ns: int) -> Ending | None:
        """Say why what is seen is too old to go on; the last frame that was acted on was at `fresh_ns`."""
        age_s = self._age_s(tick, seen.frame.t_ns)
        if age_s > BLIND_S:
            return Ending("safety_stop", f"no new camera frame for {age_s:.1f} s")
        late_s = (tick.t_ns - fresh_ns) / 1e9 / self.clock.speed
        if late_s > BLIND_S and age_s > STALE_OBSERVATION_S:
            return Ending(
                "safety_stop",
                f"perception is late: for {late_s:.1f} s no frame was fresh enough to act on, the newest is "
                f"{age_s:.2f} s old",
            )
        return None

    def _unanswered(self, tick: Tick, fresh_ns: int) -> Ending | None:
        """Say that the policy has been late for too long; what is seen was judged before."""
        late_s = (tick.t_ns - fresh_ns) / 1e9 / self.clock.speed
        if late_s <= BLIND_S:
            return None
        return Ending("safety_stop", f"the policy is late: for {late_s:.1f} s there was no answer to act on")

    @property
    def _patience(self) -> float:
        """As many slots as the machine may miss in a row."""
        return MISSED_IN_A_ROW * self.clock.speed

    def _act(self, tick: Tick, seen: Seen, status: LinkStatus) -> tuple[Action | None, float]:
        """Ask the policy; return its action, None without a fresh answer, and the ms it took."""
        began_ns, action = self.clock.now_ns(), None
        with contextlib.suppress(NoAnswer):
            whole = replace(seen.observation, image=seen.frame.rgb, state=status.state)
            action = self.policy.act(whole)
        took_ms = (self.clock.now_ns() - began_ns) / 1e6
        if action and action.answer and self._age_s(tick, action.answer.t_ns) > STALE_OBSERVATION_S:
            action = None
        return action, took_ms

    def _age_s(self, tick: Tick, taken_ns: int) -> float:
        """Age of a picture in machine time: a stall is a stall however fast the rehearsal."""
        return (tick.t_ns - taken_ns) / 1e9 / self.clock.speed


def stopped_by(status: LinkStatus) -> Ending | None:
    """Say why the link has stopped a robot that was engaged; None while it drives."""
    if status.phase is Phase.ACTIVE:
        return None
    return Ending("takeover" if status.takeover else "safety_stop", status.stopped)


def unless_stopped(
    look: Callable[[], Seen | None], link: Commands, status: LinkStatus
) -> Seen | Ending | None:
    """Return what is seen, or why the link has stopped the robot if the camera fails.

    A process that stood still while it waited finds its camera silent, which is not the cause.

    Args:
        look: returns the newest observation.
        link: asked again after a failure.
        status: of the link, from before.

    Raises:
        PlatformError: the camera fails while the robot drives.
    """
    try:
        return look()
    except PlatformError:
        if ending := stopped_by(link.status() or status):
            return ending
        raise


def _result(unseen: Unseen, seen: Seen) -> Ending | None:
    """Say how the trial has ended by the task's own rules; None while it goes on."""
    if unseen.steps >= MAX_LOST_STEPS:
        return Ending("lost", str(unseen))
    if seen.frame.truth is not None and seen.frame.truth.contact is not None:
        return Ending("collision", f"the robot touched {seen.frame.truth.contact}")
    return None


def _latency(tick: Tick, seen: Seen, infer_ms: float, handed_ns: int, answered: Answer | None) -> Latency:
    """Say where this tick's time went, up to the set-point in the link's hands."""
    capture_ms = perceive_ms = None
    if seen.taken_ns is not None and seen.ready_ns is not None:
        capture_ms = (seen.taken_ns - seen.frame.t_ns) / 1e6
        perceive_ms = (seen.ready_ns - seen.taken_ns) / 1e6
    return Latency(
        observation_age_ms=(tick.t_ns - seen.frame.t_ns) / 1e6,
        infer_ms=infer_ms,
        sensor_to_command_ms=(handed_ns - seen.frame.t_ns) / 1e6,
        lateness_ms=tick.lateness_s * 1e3,
        capture_ms=capture_ms,
        perceive_ms=perceive_ms,
        answer_age_ms=(tick.t_ns - answered.t_ns) / 1e6 if answered else None,
        queue_ms=answered.queue_ms if answered else None,
        round_trip_ms=answered.round_trip_ms if answered else None,
        server_ms=answered.server_ms if answered else None,
    )


def _record(
    *,
    step: int,
    tick: Tick,
    seen: Seen,
    setpoint: Setpoint,
    status: LinkStatus,
    action: Action | None,
    stale: bool,
    hand: Wish,
    latency: Latency,
    missed_deadlines: int,
) -> StepRecord:
    """Put one tick down as it is before the link has acted."""
    observation, truth, state = seen.observation, seen.frame.truth, status.state
    sight = seen.sight
    return StepRecord(
        step=step,
        t_ns=tick.t_ns,
        frame_seq=observation.seq,
        stale=stale,
        box=observation.box if action else None,
        others_share=setpoint.others_share,
        confidence=observation.confidence if action else 0.0,
        action=tuple(map(float, action.values)) if action else (),
        context=tuple(map(float, action.context)) if action and action.context is not None else (),
        searching=action is not None and action.searching and not hand.drives,
        command=setpoint.twist,
        driver=BY_HAND if hand.drives else BY_POLICY,
        hand=hand.values,
        mode=state.mode,
        pose=state.pose,
        velocity=state.velocity,
        battery=state.battery,
        state_age_s=state.age_s(tick.t_ns),
        latency=latency,
        missed_deadlines=missed_deadlines,
        sight=sight.verdict.value if sight else None,
        mask_iou=sight.mask_iou if sight else None,
        true_box=sight.true_box if sight else None,
        target=observation.target.value if observation.target else None,
        picks=observation.pick.taken if observation.pick else None,
        distance_m=truth.distance_m if truth else None,
        bearing_rad=truth.bearing_rad if truth else None,
        target_visible=target_visible(truth.distance_m, truth.bearing_rad, observation.box is not None)
        if truth
        else None,
    )
