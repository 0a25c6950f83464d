"""The page of several trials."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from adatracker_deploy.report.charts import Stairs, key, number, sparkline, stairs
from adatracker_deploy.report.markup import Html, tag
from adatracker_deploy.report.page import MISSING, badge, figure, page, section, shortened, table, tiles
from adatracker_deploy.scoring.stats.intervals import Estimate, mean_estimate, share_estimate
from adatracker_deploy.scoring.stats.survival import kaplan_meier

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from adatracker_deploy.report.gather import Report
    from adatracker_deploy.scoring.tally import Summary

LOOKS = 6
"""Kinds of lines that can be told apart; more groups share them."""
_LONGEST_NAME = 80


def set_page(reports: Sequence[Report]) -> str:
    """Return the page of two trials or more."""
    groups = _by_method(reports)
    outcomes = [report.summary["outcome"] for report in reports]
    completed = outcomes.count("completed")
    heading = tag(
        "header",
        tag("p", "Report of a set of trials", class_="kicker"),
        tag("h1", f"{len(reports)} trials, {completed} completed"),
        _counts(outcomes),
        _late(reports),
    )
    return page(
        f"{len(reports)} trials, {completed} completed",
        heading,
        _points(groups) if groups else None,
        _survival(groups) if groups else None,
        _trials(reports),
    )


def _name(report: Report) -> str:
    """Return the name of a trial's folder, after that of a robot that has one of its own."""
    folder, config = report.trial.path.parent.name, report.trial.config
    robot = config.get("robot") if isinstance(config, dict) else None
    return f"{robot}: {folder}" if robot else folder


def _counts(outcomes: Sequence[str]) -> Html:
    counted = {outcome: outcomes.count(outcome) for outcome in sorted(set(outcomes))}
    return tiles((outcome.replace("_", " "), str(count), "") for outcome, count in counted.items())


def _by_method(reports: Sequence[Report]) -> dict[str, list[Summary]]:
    groups: dict[str, list[Summary]] = {}
    for report in reports:
        name = shortened(f"{report.summary['platform']}, {report.summary['policy']}", _LONGEST_NAME)
        if report.summary["counted"]:
            groups.setdefault(name, []).append(report.summary)
    return groups


def _late(reports: Sequence[Report]) -> Html | None:
    """Say which trials are in no mean."""
    late = [str(place) for place, report in enumerate(reports, start=1) if not report.summary["counted"]]
    if not late:
        return None
    words = f"Left out of all means, for their timing was not kept: number {', '.join(late)}."
    return tag("p", words, class_="faint")


def _points(groups: dict[str, list[Summary]]) -> Html:
    """Show every trial as a point above its group's mean and interval."""
    longest = max((row["steps"] for rows in groups.values() for row in rows), default=1) or 1
    return section(
        "Points and 95 % intervals",
        tag("h3", "MR"),
        _dots(groups, lambda row: row["mr"], mean_estimate, 1.0, 3),
        tag("h3", "EL, steps"),
        _dots(groups, lambda row: float(row["el"]), mean_estimate, float(longest), 0),
        tag("h3", "SR"),
        _dots(groups, lambda row: float(row["outcome"] == "completed"), _share, 1.0, 2),
        tag(
            "p",
            "A ring is a trial, the line their mean, the bar its 95 % interval: Student's t for MR and EL, "
            "Wilson's for the share of completed trials (SR); bars end where nothing is possible. A "
            "single trial bounds no mean. EL ends at the horizon, so that its mean is too small where trials "
            "were completed.",
            class_="faint",
        ),
    )


def _share(values: Sequence[float]) -> Estimate:
    return share_estimate(round(sum(values)), len(values))


def _dots(
    groups: dict[str, list[Summary]],
    value: Callable[[Summary], float],
    estimate: Callable[[Sequence[float]], Estimate],
    most: float,
    digits: int,
) -> Html:
    rows: list[Html] = []
    for name, summaries in groups.items():
        values = [value(row) for row in summaries]
        found = estimate(values)
        bounded = math.isfinite(found.low)
        low, high = (min(max(bound, 0.0), most) for bound in (found.low, found.high))
        bar = tag(
            "i", class_="span", style=f"left:{100 * low / most:.2f}%;width:{100 * (high - low) / most:.2f}%"
        )
        mean = tag("i", class_="mean", style=f"left:{100 * found.value / most:.2f}%")
        rings = [tag("i", class_="dot", style=f"left:{100 * one / most:.2f}%") for one in values]
        said = f"{found.value:.{digits}f}"
        said += f" [{low:.{digits}f}, {high:.{digits}f}]" if bounded else ""
        track = tag("div", bar if bounded else None, mean, *rings, class_="track")
        title = tag("span", name, tag("small", f" n = {len(values)}"))
        rows.append(tag("div", title, track, tag("span", said, class_="value"), class_="dots"))
    ends = tag("div", tag("span", "0"), tag("span", number(most)), class_="ends")
    return tag("div", *rows, tag("div", ends, class_="dots"))


def _survival(groups: dict[str, list[Summary]]) -> Html:
    """Show how long trials last; those that reached their horizon would have gone on."""
    last = max((row["el"] for rows in groups.values() for row in rows), default=0) or 1
    curves, keys = [], []
    for place, (name, rows) in enumerate(groups.items()):
        lengths = [row["el"] for row in rows]
        failed = [row["outcome"] != "completed" for row in rows]
        falls = kaplan_meier(lengths, failed)
        look = f"c-{place % LOOKS}"
        curves.append(Stairs(look, [(0, 1.0), *((fall.at, fall.survival) for fall in falls)], max(lengths)))
        reached = failed.count(False)
        keys.append(key(f"{name}: n = {len(rows)}, {reached} reached the horizon", look))
    return section(
        "How long they followed",
        stairs("share of trials still following", curves, last, "steps", keys),
        tag(
            "p",
            "After Kaplan and Meier: every outcome but completed ends a trial; one that reached its "
            "horizon counts up to there and says nothing about later. A line ends with its longest trial.",
            class_="faint",
        ),
    )


def _trials(reports: Sequence[Report]) -> Html:
    head = (
        "#",
        "outcome",
        "R over time",
        "MR",
        "while seen",
        "visibility",
        "EL",
        "AR",
        "p99",
        "missed",
        "trial",
    )
    longest_s = max((report.columns.duration_s for report in reports if report.columns), default=1.0)
    rows = []
    for place, report in enumerate(reports, start=1):
        row, cols = report.summary, report.columns
        line = sparkline(cols.time_s, cols.reward, longest_s) if cols else MISSING
        rows.append(
            (
                str(place),
                badge(row["outcome"]),
                line,
                figure(row["mr"], 3),
                figure(row["mr_visible"], 3),
                f"{row['visibility']:.0%}",
                f"{row['el']} of {row['steps']}",
                figure(row["ar"], 0),
                figure(row["latency_ms"]["p99"], 0, "ms"),
                str(row["missed_deadlines"]),
                tag("code", shortened(_name(report), _LONGEST_NAME)),
            )
        )
    return section("Trials", table(head, rows, class_="trials"), class_="long")
