"""Operator prompts between trials.

Enter alone never starts a trial: an operator who pressed it twice to stop the last one has not requested the
next.
"""

from __future__ import annotations

import contextlib
import sys
import termios
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.marks import Mark, Verdict, typed

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    Read = Callable[[str], str | None]

KEYS: dict[str, Verdict] = {"g": "good", "t": "takeover", "w": "wrong_person", "c": "collision"}
GO = "go"


@dataclass(frozen=True, slots=True)
class Answer:
    """The operator's answer after a trial."""

    mark: Mark | None
    go_on: bool
    """The next trial may begin."""


def mark(
    summary: dict[str, Any], console: Console, more: Callable[[str], bool] | None
) -> tuple[dict[str, Any], bool]:
    """Ask how a trial ended; return its summary as the operator marked it, and whether another may begin.

    An interrupt here ends the set. What cannot be written costs a line, not the trial's result.

    Args:
        summary: the trial's.
        console: where the questions stand.
        more: whether there may be another trial after an outcome; None where this was the last.
    """
    from adatracker_deploy.scoring.summary import summarise_log
    from adatracker_deploy.trial.marks import add_mark, now_utc
    from adatracker_deploy.trial.reader import read_scored, trial_file

    ended = f"{summary['outcome']}, EL {summary['el']} of {summary['steps']}: {summary['trial']}"
    console.print(ended, markup=False, highlight=False, soft_wrap=True)
    try:
        answer = ask(
            at_terminal(console),
            at=now_utc(),
            outcome=summary["outcome"],
            lasted_s=summary["seconds"],
            more=more or (lambda _: False),
        )
    except KeyboardInterrupt:
        console.print("\nnot marked; the set ends")
        return summary, False
    if answer.mark is not None:
        try:
            log = trial_file(Path(summary["trial"]))
            add_mark(log, answer.mark)
            summary = summarise_log(read_scored(log))
        except UsageError as error:
            console.print(f"warning: the mark is lost: {error}", markup=False, soft_wrap=True)
    return summary, answer.go_on


def ask(read: Read, *, at: str, outcome: str, lasted_s: float, more: Callable[[str], bool]) -> Answer:
    """Ask how a trial ended and whether to go on; the end of input says nothing and ends the set.

    Args:
        read: shows a question and returns the line that answers it; None at the end of input.
        at: the wall-clock time, as a mark has it.
        outcome: as it was recorded.
        lasted_s: how long the trial was, s of the run's clock.
        more: whether there may be another trial after an outcome.
    """
    verdict = _verdict(read, outcome)
    since_s = _since(read, lasted_s) if verdict not in (None, "good") else None
    note = typed(read("note (Enter: none): ") or "")
    mark = Mark(at=at, outcome=verdict, since_s=since_s, note=note) if verdict or note else None
    held = outcome if verdict in (None, "good") else str(verdict)
    return Answer(mark, more(held) and _go_on(read))


def _verdict(read: Read, outcome: str) -> Verdict | None:
    names = ", ".join(f"{key} {name.replace('_', ' ')}" for key, name in KEYS.items())
    while answer := _plain(read(f"how did it end? {names} (Enter: {outcome}, as recorded): ")):
        if answer in KEYS:
            return KEYS[answer]
    return None


def _since(read: Read, lasted_s: float) -> float | None:
    while answer := _plain(read(f"since which second, 0 to {lasted_s:.1f}? (Enter: its end): ")):
        with contextlib.suppress(ValueError):
            if 0 <= float(answer) <= lasted_s:
                return float(answer)
    return None


def _go_on(read: Read) -> bool:
    while answer := _plain(read(f"the next trial? type {GO} when everybody is ready (Enter: end the set): ")):
        if answer == GO:
            return True
    return False


def _plain(answer: str | None) -> str:
    return (answer or "").strip().lower()


def at_terminal(console: Console) -> Read:
    """Return what asks the operator at standard input; what was typed before a question is forgotten.

    If that is not a terminal, its lines are taken as they come.
    """

    def read(question: str) -> str | None:
        with contextlib.suppress(termios.error, OSError, ValueError):
            termios.tcflush(sys.stdin, termios.TCIFLUSH)
        console.print(question, end="", markup=False, highlight=False, soft_wrap=True)
        try:
            return input()
        except (EOFError, OSError):  # its terminal is gone
            console.print()
            return None

    return read
