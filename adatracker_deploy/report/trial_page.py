"""The page of one trial."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.sight import Verdict
from adatracker_deploy.report.charts import clock
from adatracker_deploy.report.markup import Html, tag
from adatracker_deploy.report.origin import LONGEST_TEXT, completeness, events_section, marks_section, origin
from adatracker_deploy.report.over_time import over_time
from adatracker_deploy.report.page import badge, figure, page, picture, section, shortened, table, tiles
from adatracker_deploy.trial.aftermath import aftermath_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.report.gather import Moment, Report
    from adatracker_deploy.trial.reader import Trial


LEAST_SHARE = 0.005
"""Share of the ticks below which a reason for not seeing is not shown."""


def trial_page(report: Report, moments: Sequence[Moment]) -> str:
    """Return the page of a trial.

    Args:
        report: the trial.
        moments: its pictures.
    """
    trial = report.trial
    if report.columns is None:
        shown = [section("Over time", tag("p", "There is not a single step in this log."))]
    else:
        shown = over_time(report, report.columns)
    last = [marks_section(trial), events_section(report.events), completeness(trial), origin(trial)]
    parts = [_heading(report), _figures(report), _moments(moments), *shown, _aftermath(trial), *last]
    return page(f"{trial.platform} {trial.policy}: {report.summary['outcome']}", *parts)


def _heading(report: Report) -> Html:
    trial, summary = report.trial, report.summary
    kind = {"sitl": "rehearsal in simulation", "dry": "dry run", "real": "real robot"}.get(
        trial.kind, trial.kind
    )
    reason = (
        tag("p", shortened(summary["reason"], LONGEST_TEXT), class_="reason") if summary["reason"] else None
    )
    if trial.marks and summary["outcome"] != summary["recorded_outcome"]:
        said = f"By the operator's mark; recorded as {summary['recorded_outcome']}. {summary['reason']}"
        reason = tag("p", shortened(said, LONGEST_TEXT), class_="reason")
    cut = None
    if not trial.complete:
        cut = tag("p", "This log was cut short; what follows is what it holds up to its last whole record.")
    return tag(
        "header",
        tag("p", "Trial report", class_="kicker"),
        tag("h1", f"{trial.platform}, {trial.policy} ", badge(summary["outcome"])),
        reason,
        tag("p", f"{kind}, {_started(trial)}, ", tag("code", str(trial.path.parent)), class_="faint"),
        cut,
    )


def _aftermath(trial: Trial) -> Html | None:
    """Show what the link did after a log that ended before its trial."""
    if trial.summary is not None:
        return None
    found = aftermath_of(trial.path.parent, trial.steps[-1].t_ns if trial.steps else None)
    if found is None:
        return None
    rows = [
        (
            f"{change.after_s:+.2f} s",
            change.phase,
            shortened(change.reason, LONGEST_TEXT),
            figure(change.sent.vx, 2, "m/s"),
            figure(change.speed_m_s, 2, "m/s"),
        )
        for change in found.changes
    ]
    head = ("after the log", "link", "why", "sent forward", "measured speed")
    return section("After the log's end: the link's black box", tag("p", found.summary), table(head, rows))


def _started(trial: Trial) -> str:
    return trial.about.get("started", "at an unknown time").replace("T", " ")[:19] + " UTC"


def _figures(report: Report) -> Html:
    summary = report.summary
    latency = summary["latency_ms"]
    values = [
        ("MR", figure(summary["mr"], 3), "lost steps count 0"),
        ("MR while seen", figure(summary["mr_visible"], 3), ""),
        ("visibility", f"{summary['visibility']:.0%}", "of the steps"),
        ("EL", f"{summary['el']}", f"of {summary['steps']} steps"),
        ("duration", figure(summary["seconds"], 1, "s"), f"at {figure(summary['rate_hz'], 2, 'Hz')}"),
        (
            "sensor to command",
            figure(latency["p50"], 0, "ms"),
            f"p99 {figure(latency['p99'], 0)}, most {figure(latency['max'], 0)}",
        ),
        (
            "missed deadlines",
            f"{summary['missed_deadlines']}",
            "" if summary["timing_kept"] else "timing not kept: counts in no mean",
        ),
    ]
    if summary["stale"]:
        values.append(("stale", f"{summary['stale']:.0%}", "of the ticks: frames too old to act on"))
    if summary["ar"] is not None:
        values.insert(4, ("AR", figure(summary["ar"], 1), "by the truth"))
    if summary["sight"]:
        values += _eyes(summary["sight"])
    taken = summary["takeovers"]
    if taken["count"]:
        per = [figure(taken["between_s"], 1, "s")]
        per += [figure(taken["between_m"], 1, "m")] if taken["between_m"] is not None else []
        values.append(
            ("takeovers", f"{taken['count']}", f"one per {' and '.join(per)} of the policy's driving")
        )
    if summary["stop_s"] is not None:
        values.append(("stop", figure(summary["stop_s"], 2, "s"), "until it stood"))
    return tiles(values)


def _eyes(sight: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Return what the eyes were worth, by the truth that a virtual world knows."""
    why = ", ".join(
        f"{verdict.words} {sight[verdict.value]:.0%}"
        for verdict in Verdict
        if verdict is not Verdict.SEEN and sight[verdict.value] >= LEAST_SHARE
    )
    again = sight["found_again_s"]
    values = [
        ("seen by the eyes", "-" if sight["seen"] is None else f"{sight['seen']:.1%}", why),
        ("mask IoU", figure(sight["mask_iou"], 2), f"box IoU {figure(sight['box_iou'], 2)}"),
        ("MR by the truth", figure(sight["mr_true"], 3), "by the true boxes"),
    ]
    if again["times"]:
        values.append(
            ("found again", figure(again["p50"], 1, "s"), f"{figure(again['max'], 1, 's')} at most")
        )
    return values


def _moments(moments: Sequence[Moment]) -> Html | None:
    if not any(moment.jpeg for moment in moments):
        return section("Pictures", tag("p", "No frames were logged.", class_="faint")) if moments else None
    shown = []
    for moment in moments:
        words = f"{moment.name}, {clock(round(moment.time_s, 1))}"
        image = picture(moment.jpeg, words) if moment.jpeg else tag("div", "not in the log", class_="absent")
        shown.append(tag("figure", image, tag("figcaption", words)))
    never = [name for name in ("first loss", "seen again") if name not in {moment.name for moment in moments}]
    note = {2: "The target was never lost.", 1: "It was not seen again.", 0: ""}[len(never)]
    return section(
        "Pictures", tag("div", *shown, class_="film"), tag("p", note, class_="faint") if note else None
    )
