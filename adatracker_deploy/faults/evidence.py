"""The evidence of a row, and whether its fault took effect, judged without the injector's own word. Pure."""

from __future__ import annotations

import signal
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

from adatracker_deploy.core.faults import BLIND_FOR_S, OURS
from adatracker_deploy.faults.process_monitor import Seen

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.faults.process_monitor import Role, State
    from adatracker_deploy.sim.ground_truth import Account

SOON_NS = 1_000_000_000
"""Within this time a single event has happened, even on a busy machine."""
KILLED_NS = 250_000_000
"""A link that ends this soon did not end by itself: it would disengage first and wait for the tracker."""
INTERRUPTED_STATUS = 130
"""Exit status of a command that was told to stop, in whatever way."""
STOOD_S = 0.09
"""Least stall to look for: a stall of 0.1 s is noticed by a thread that sleeps 5 ms at a time."""
JUMP = 1.5
"""Least change of an action that counts as a jump: its range is 2; a policy that follows changes it by
0.1."""
STARVED_CORES = 0.9
"""Share of each core, or of four, that CPU hogs take."""
HOGS = 4


@dataclass(frozen=True, slots=True)
class Tick:
    """The fields of a logged tick that show a fault."""

    t_ns: int
    frame: int
    """Sequence number of the frame that it acted on."""
    action: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The evidence of one row; times are the machine's, ns."""

    account: Account
    seen: Seen = field(default_factory=Seen)
    cores: int = 1
    status: int | None = None
    """The command's exit status; -1 when it had to be killed."""
    outcome: str = ""
    """The trial's outcome; empty if it reported none."""
    reason: str = ""
    """The reason given for its end: by the trial, or on the screen if there was no trial."""
    latched_s: float | None = None
    """From the onset until the link's stop, by its own clock; None without a stop."""
    noticed: str = ""
    """The first to report something after the onset: ``link`` or ``tracker``."""
    ticks: tuple[Tick, ...] = ()
    log_trouble: bool = False
    """The run reported that its log is incomplete."""
    log_whole: bool = True
    """The log is complete: it has its end."""
    exit_s: float = 0.0
    """From the onset until the command had ended."""


def without_effect(fault: str, evidence: Evidence, onset_ns: int) -> str:
    """Return what is missing to show that a fault took effect; empty if nothing is.

    The robot itself records the faults that affect it. A fault of our own processes that leaves no other
    trace must end the trial for the expected reason (`matrix.Row.words`).
    """
    if fault not in _OURS and not any(
        name == fault and t_ns >= onset_ns for t_ns, name in evidence.account.suffered
    ):
        return "the robot did not report the fault"
    sign = _SIGNS.get(fault)
    return sign(evidence, onset_ns) if sign is not None else ""


_OURS = frozenset(fault.name for fault in OURS)


def _state(role: Role, state: State, within_ns: int = SOON_NS) -> Callable[[Evidence, int], str]:
    def sign(evidence: Evidence, onset_ns: int) -> str:
        found = evidence.seen.first(role, state, onset_ns, onset_ns + within_ns)
        return "" if found is not None else f"the {role}'s process was not seen to be {state}"

    return sign


def _killed(evidence: Evidence, _: int) -> str:
    return (
        "" if evidence.status == -signal.SIGKILL else f"the tracker ended with exit status {evidence.status}"
    )


def _ends_asked(evidence: Evidence, _: int) -> str:
    asked = evidence.status == INTERRUPTED_STATUS
    return "" if asked else f"exit status {evidence.status} reports no requested stop"


def _asleep(evidence: Evidence, onset_ns: int) -> str:
    return _state("tracker", "stopped")(evidence, onset_ns) or _state("link", "stopped")(evidence, onset_ns)


def _starved(evidence: Evidence, onset_ns: int) -> str:
    busy = evidence.seen.busy_cores(onset_ns + SOON_NS // 2, onset_ns + 2 * SOON_NS)
    enough = STARVED_CORES * min(HOGS, evidence.cores)
    return "" if busy >= enough else f"{busy:.1f} of {evidence.cores} cores were busy"


def _stood_still(evidence: Evidence, onset_ns: int) -> str:
    stood = [s for over_ns, s in evidence.account.stood if onset_ns <= over_ns <= onset_ns + SOON_NS]
    return "" if max(stood, default=0.0) >= STOOD_S else "the interpreter was not seen to stand still"


def _jumped(evidence: Evidence, onset_ns: int) -> str:
    actions = [tick.action for tick in evidence.ticks if tick.t_ns >= onset_ns and tick.action]
    jump = max(
        (abs(b - a) for one, two in pairwise(actions) for a, b in zip(one, two, strict=True)), default=0
    )
    return "" if jump >= JUMP else f"actions jumped by {jump:.1f} at most"


def _no_new_picture(evidence: Evidence, onset_ns: int) -> str:
    until_ns = onset_ns + round(BLIND_FOR_S * 1e9)
    later = {tick.frame for tick in evidence.ticks if onset_ns + SOON_NS // 4 < tick.t_ns < until_ns}
    return "" if len(later) <= 1 else f"{len(later)} new pictures came"


def _no_tick(evidence: Evidence, onset_ns: int) -> str:
    until_ns = onset_ns + 2 * SOON_NS
    later_ns = [tick.t_ns for tick in evidence.ticks if onset_ns < tick.t_ns < until_ns]
    gap_s = max((b - a) / 1e9 for a, b in pairwise([onset_ns, *later_ns, until_ns]))
    return "" if gap_s > SOON_NS / 1e9 else f"ticks came at most {gap_s:.2f} s apart"


def _log_cut(evidence: Evidence, _: int) -> str:
    return "" if evidence.log_trouble else "the log's failure was not reported"


_SIGNS: dict[str, Callable[[Evidence, int], str]] = {
    "tracker_stop": _state("tracker", "stopped"),
    "tracker_kill": _killed,
    "interrupt": _ends_asked,
    "terminate": _ends_asked,
    "hangup": _ends_asked,
    "link_stop": _state("link", "stopped"),
    "link_kill": _state("link", "gone", KILLED_NS),
    "robot_frozen": _state("robot", "stopped"),
    "suspend": _asleep,
    "cpu_hogs": _starved,
    "gc_pause": _stood_still,
    "action_jump": _jumped,
    "camera_freeze": _no_new_picture,
    "camera_gone": _no_new_picture,
    "segmenter_stall": _no_new_picture,
    "policy_hang": _no_tick,
    "disk_full": _log_cut,
}
