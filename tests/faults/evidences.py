"""Made-up evidence: of runs as each row of the fault matrix expects, and of runs without any fault."""

from __future__ import annotations

import signal
from dataclasses import replace

from adatracker_deploy.core.faults import OURS
from adatracker_deploy.faults.evidence import INTERRUPTED_STATUS, Evidence, Tick
from adatracker_deploy.faults.matrix import INTERRUPTED, KILLED, TAKEN
from adatracker_deploy.faults.phases import IN_FLIGHT, ORDER, TrialPhase
from adatracker_deploy.faults.process_monitor import Seen
from adatracker_deploy.sim.ground_truth import Account, Flying, Told

ONSET_NS = 50_000_000_000
SIGNALS = ("interrupt", "terminate", "hangup")
STATES = {
    "tracker_stop": [("tracker", "stopped")],
    "link_stop": [("link", "stopped")],
    "link_kill": [("link", "gone")],
    "robot_frozen": [("robot", "stopped")],
    "suspend": [("tracker", "stopped"), ("link", "stopped")],
}


def ns(seconds: float) -> int:
    return ONSET_NS + round(seconds * 1e9)


def commands(until_s, vx=0.8, slot_s=0.02, since_s=-1.0):
    """Commands at the link's rate until `until_s` after the onset, then zeros."""
    slots = range(round(since_s / slot_s), round(4.0 / slot_s))
    return tuple(
        Told(ns(slot * slot_s), vx if slot * slot_s <= until_s else 0.0, 0.0, 0.0, 0.0) for slot in slots
    )


def speeds(row, halts_s):
    """The true speed ten times a second: 0.8 m/s until `halts_s`; before it follows a robot stands."""
    moves = row.moves
    return tuple((ns(t / 10), 0.8 if moves and t / 10 < halts_s else 0.0) for t in range(-10, 40))


def phases(row, *, flies, again=False):
    """The phases of a trial up to the row's, a second apart, then its ending; and those of a second trial."""
    before = [phase for phase in ORDER[: ORDER.index(row.phase)] if flies or phase not in IN_FLIGHT]
    told = [(ns(-1.0 - len(before) + at), phase) for at, phase in enumerate(before)]
    told.append((ns(-0.5), row.phase))
    after = [TrialPhase.STOPPING, TrialPhase.DISENGAGING] if row.phase not in ORDER[-3:] else []
    told += [(ns(0.5 + at / 10), phase) for at, phase in enumerate(after)]
    if again:
        told += [(ns(3.0), TrialPhase.CONNECTING), (ns(3.5), TrialPhase.ENGAGING)]
    return tuple((t_ns, str(phase)) for t_ns, phase in told)


def flight(*, flies):
    """A drone that came down in the end."""
    return tuple(Flying(ns(t / 10), 0.0, max(0.0, 2.0 - t / 10)) for t in range(-10, 40)) if flies else ()


def nothing_happened(row, platform):
    """Return evidence of a run whose fault was recorded but never struck: it runs on past its end."""
    flies = platform == "drone"
    account = Account(
        commands=commands(9.0, 0.8 if row.moves else 0.0),
        speeds=speeds(row, 9.0),
        faults=((ONSET_NS, row.fault, True), (ns(2.0), row.fault, False)),
        off=True,
        flight=flight(flies=flies),
        phases=phases(row, flies=flies, again=row.trials > 1),
    )
    seen = Seen(
        states=tuple((ns(-20.0), who, "runs") for who in ("tracker", "link", "robot")),
        busy_ns=tuple((ns(t / 10), round(0.3e8 * (t + 10))) for t in range(-10, 40)),
    )
    ticks = tuple(Tick(ns(t / 10), t, (0.3, 0.01 * (t % 2))) for t in range(-10, 40))
    return Evidence(account=account, seen=seen, cores=2, status=0, outcome="completed", ticks=ticks)


def as_it_should(row, platform):
    """Return evidence of a run whose fault struck, and which ended as the row says."""
    flies, nothing = platform == "drone", nothing_happened(row, platform)
    stopping = row.stops or row.moves
    suffered = () if row.fault in {fault.name for fault in OURS} else ((ns(0.01), row.fault),)
    account = replace(
        nothing.account,
        commands=commands(0.0 if stopping else 9.0, 0.8 if row.moves else 0.0),
        speeds=speeds(row, 0.4 if stopping else 9.0),
        phases=phases(row, flies=flies),
        stood=((ns(0.12), 0.1),) if row.fault == "gc_pause" else (),
        suffered=suffered,
    )
    states = tuple((ns(0.05), who, what) for who, what in STATES.get(row.fault, ()))
    busy = tuple((ns(t / 10), round(2e8 * (t + 10))) for t in range(-10, 40))
    jumps = [
        (1.0 if t % 2 else -1.0, 0.0) if row.fault == "action_jump" else (0.3, 0.0) for t in range(-10, 40)
    ]
    until_s = 9.0 if row.measure in {"burst", "acceleration", "gap", "log"} else 0.15
    ticks = tuple(tick for tick in nothing.ticks if tick.t_ns <= ns(until_s))
    outcome = next(
        one for one in ("safety_stop", "takeover", "interrupted", "completed", "") if one in row.endings
    )
    if row.fault in SIGNALS:
        outcome = next(iter(row.endings & INTERRUPTED))
    status = {"tracker_kill": -signal.SIGKILL}.get(
        row.fault, INTERRUPTED_STATUS if row.fault in SIGNALS else 1
    )
    return replace(
        nothing,
        account=account,
        seen=replace(nothing.seen, states=(*nothing.seen.states, *states), busy_ns=busy),
        status=status,
        outcome="" if row.endings == KILLED else "takeover" if row.endings == TAKEN else outcome,
        reason=row.words.replace("|", " "),
        latched_s=0.1,
        ticks=tuple(replace(tick, action=jumps[at]) for at, tick in enumerate(ticks)),
        log_trouble=row.measure == "log",
    )
