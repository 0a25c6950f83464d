"""Replays a whole trial and compares the results, with notes on their validity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.golden import GOLDEN_TOLERANCE
from adatracker_deploy.replay.answers import Replayed, answer_again
from adatracker_deploy.replay.compare import (
    Difference,
    Spread,
    apart,
    commands,
    context_apart,
    first_difference,
    logged_commands,
)
from adatracker_deploy.replay.judged import Judgement, judge_again, without_gaps
from adatracker_deploy.runtime.link_process import wall_timeouts
from adatracker_deploy.trial.episodes import tick_rate_hz
from adatracker_deploy.trial.limits import limits_of
from adatracker_deploy.trial.provenance import surroundings

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.trial.reader import Trial

_RATE_TOLERANCE = 0.1
"""Relative rate difference that counts as equal, because a busy robot misses some slots."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyAgain:
    """A policy's answers beside the logged ones."""

    name: str
    same: bool | None
    """Whether it is the logged policy, by its files' digests; None if the log has none."""
    replayed: Replayed
    first: Difference | None
    logged: tuple[Twist, ...]
    """The commands of the logged answers, tick by tick of `replayed.answers`."""
    asked: tuple[Twist, ...]
    """The commands of the replayed answers, for the same robot."""
    apart: dict[str, Spread]
    """Differences between these two, by axis."""
    context_apart: Spread | None
    notes: tuple[str, ...]
    """Caveats for the reader."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateAgain:
    """The gate's judgements of the logged commands under the trial's limits and under others."""

    changed: dict[str, tuple[Any, Any]]
    """Limits that differ, by name: (the trial's, the other)."""
    before: Judgement
    after: Judgement
    apart: dict[str, Spread]
    """Differences between the commands sent, by axis, up to the earlier stop."""
    agreement: dict[str, Spread]
    """Differences between the judgement under the trial's own limits and the logged commands."""
    notes: tuple[str, ...]


def ask_again(trial: Trial, policy: Policy) -> PolicyAgain:
    """Re-run a policy on a trial's logged inputs.

    Raises:
        UsageError: the log has no tick at which a policy ran, or lacks seed or limits.
    """
    limits, seed = limits_of(trial), trial.config.get("seed")
    if not isinstance(seed, int):
        raise UsageError(f"{trial.path}: lacks the seed that its policy was reset with")
    replayed = answer_again(trial.steps, trial.masks(), policy, seed)
    answers = replayed.answers
    if not answers:
        why = f"tick {replayed.gap.step}: {replayed.gap.why}" if replayed.gap else "no tick was acted on"
        raise UsageError(f"{trial.path}: there is nothing to replay ({why})")
    logged = tuple(logged_commands(answers, policy.info.action, limits))
    asked = tuple(commands(answers, policy.info.action, limits))
    numbers = [answer.step.step for answer in answers]
    first, same = first_difference(answers), _is_same(trial, policy)
    return PolicyAgain(
        name=policy.info.name,
        same=same,
        replayed=replayed,
        first=first,
        logged=logged,
        asked=asked,
        apart=apart(numbers, logged, asked),
        context_apart=context_apart(answers),
        notes=tuple(_notes(trial, policy, replayed, same, first)),
    )


def gate_again(trial: Trial, limits: Limits) -> GateAgain:
    """Judge a trial's commands again, under its own limits and under others.

    Raises:
        UsageError: the log has no ticks, or does not say its limits.
    """
    before_limits = limits_of(trial)
    speed = trial.config.get("speed", 1.0)
    if not isinstance(speed, int | float) or not 1 <= speed <= 100:
        raise UsageError(f"{trial.path}: states a speed of {speed!r}, which no run has")
    steps = without_gaps(trial.steps)
    if not steps:
        raise UsageError(f"{trial.path}: contains no tick to judge")
    before = judge_again(steps, wall_timeouts(before_limits, speed))
    after = judge_again(steps, wall_timeouts(limits, speed))
    both = list(zip(before.ticks, after.ticks, strict=False))
    answered = [
        (tick.step, step.sent, tick.sent)
        for step, tick in zip(steps, before.ticks, strict=False)
        if step.sent is not None
    ]
    notes = []
    if len(steps) < len(trial.steps):
        notes.append(f"the log lacks tick {steps[-1].step + 1}: judged up to there")
    if trial.steps[0].step != 0:
        notes.append(
            f"the log begins with tick {trial.steps[0].step}: judged as if it had stood still before"
        )
    return GateAgain(
        changed={
            name: (getattr(before_limits, name), getattr(limits, name))
            for name in Limits.__dataclass_fields__
            if getattr(before_limits, name) != getattr(limits, name)
        },
        before=before,
        after=after,
        apart=apart([a.step for a, _ in both], [a.sent for a, _ in both], [b.sent for _, b in both]),
        agreement=apart(
            [tick for tick, _, _ in answered],
            [logged for _, logged, _ in answered],
            [judged for _, _, judged in answered],
        ),
        notes=tuple(notes),
    )


def _is_same(trial: Trial, policy: Policy) -> bool | None:
    """Compare digests; a policy without files is the one of its name."""
    logged = trial.config.get("policy_sha256")
    if not isinstance(logged, dict):
        return None
    return trial.policy == policy.info.name and logged == dict(policy.info.sha256)


def _notes(
    trial: Trial, policy: Policy, replayed: Replayed, same: bool | None, first: Difference | None
) -> list[str]:
    notes = []
    if same is None:
        notes.append("the log names no digest of its bundle: this one may differ")
    elif not same:
        notes.append(_other(trial, policy))
        notes.append("an open loop: it sees the results of the logged policy's actions, not of its own")
        rate_hz = tick_rate_hz(trial.steps)
        if rate_hz and abs(rate_hz - policy.info.rate_hz) > _RATE_TOLERANCE * policy.info.rate_hz:
            notes.append(
                f"it is made for {policy.info.rate_hz:g} Hz and was asked at the log's {rate_hz:.1f} Hz"
            )
    if replayed.gap is not None:
        notes.append(
            f"tick {replayed.gap.step}: {replayed.gap.why}; from there on the policy's memory is "
            "unknown, and nothing can be compared"
        )
    if not trial.complete:
        notes.append("the log was cut short: replayed up to its last whole record")
    if first is not None and same is not False:
        notes += _elsewhere(trial)
        ran_on = trial.config.get("policy_runs_on", policy.info.runs_on)
        if ran_on != policy.info.runs_on:
            notes.append(f"its networks ran on {ran_on} in the trial, and on {policy.info.runs_on} here")
        notes.append(
            "other processors and versions round differently: of golden vectors, differences of up to "
            f"{GOLDEN_TOLERANCE:g} are allowed"
        )
    return notes


def _other(trial: Trial, policy: Policy) -> str:
    """Say how the given policy is another than the logged one."""
    if trial.policy != policy.info.name:
        return f"another policy: the log is of {trial.policy}, this is {policy.info.name}"
    logged, given = trial.config["policy_sha256"], dict(policy.info.sha256)
    files = sorted(name for name in {*logged, *given} if logged.get(name) != given.get(name))
    told = ", ".join(
        f"{name} {_short(logged.get(name))} in the log, {_short(given.get(name))} here" for name in files
    )
    return f"another bundle of that name, by SHA-256: {told}"


def _short(digest: object) -> str:
    return f"{str(digest)[:12]}..." if digest else "missing"


def _elsewhere(trial: Trial) -> list[str]:
    """Say what was another when the trial ran, of what its numbers may depend on."""
    return [
        f"{name} was {trial.about[name]} then, is {now} now"
        for name, now in surroundings().items()
        if name in trial.about and trial.about[name] != now
    ]
