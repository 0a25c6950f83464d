"""Further sections of a trial's page: events, gaps in the log, and provenance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import yaml

from adatracker_deploy.report.markup import Html, tag
from adatracker_deploy.report.page import MISSING, section, shortened, table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from adatracker_deploy.report.gather import Event
    from adatracker_deploy.trial.reader import Trial

LONGEST_TEXT = 500
SHOWN_EVENTS = 200
SHOWN_GAPS = 20
LONGEST_CONFIG = 50_000
_PLAIN = ("robot", "scene", "seed", "target_speed_m_s", "camera", "segmenter", "frames", "speed")


def events_section(events: Sequence[Event]) -> Html:
    """List what was written down, the first lines of many."""
    if not events:
        return section("Events", tag("p", "None.", class_="faint"))
    rows = [
        (
            MISSING if event.time_s is None else f"{event.time_s:+.2f} s",
            tag("span", event.level, class_=f"level {event.level}"),
            shortened(event.message, LONGEST_TEXT),
        )
        for event in events[:SHOWN_EVENTS]
    ]
    more = len(events) - SHOWN_EVENTS
    note = tag("p", f"{more} more are in the log.", class_="faint") if more > 0 else None
    return section(
        "Events", table(("from the first tick", "level", "what"), rows, class_="events"), note, class_="long"
    )


def marks_section(trial: Trial) -> Html | None:
    """List what the operator said of the trial; nothing where that is nothing."""
    if not trial.marks:
        return None
    rows = [
        (
            mark.at[:19].replace("T", " "),
            (mark.outcome or "a note").replace("_", " "),
            "its end" if mark.since_s is None else f"{mark.since_s:.1f} s",
            shortened(mark.note, LONGEST_TEXT),
        )
        for mark in trial.marks
    ]
    return section(
        "The operator's marks",
        table(("said at, UTC", "what", "as of", "in words"), rows),
        tag("p", "The last outcome holds; good is the one that was recorded.", class_="faint"),
        class_="long",
    )


def completeness(trial: Trial) -> Html:
    """Say what the log lacks: control goes first, so that a busy writer drops rather than delays."""
    gaps = list(_missing([step.step for step in trial.steps]))
    lacking = sum(end - start + 1 for start, end in gaps)
    wanted = {step.frame_seq for step in trial.steps}
    frames = len(wanted - trial.frame_seqs)
    steps = f"{lacking} of {lacking + len(trial.steps)} steps"
    if trial.frames_kept == "none":
        lines = [f"{steps} are missing. Frames were left out, as was asked for (--no-frames)."]
    else:
        lines = [f"{steps} and {frames} of {len(wanted)} frames are missing."]
    if gaps:
        named = ", ".join(f"{a}" if a == b else f"{a} to {b}" for a, b in gaps[:SHOWN_GAPS])
        more = f" and {len(gaps) - SHOWN_GAPS} more gaps" if len(gaps) > SHOWN_GAPS else ""
        lines.append(f"Steps that are missing: {named}{more}.")
    lines.append("The file has its end." if trial.complete else "The file was cut short: it has no end.")
    return section("Completeness of the log", *(tag("p", line) for line in lines))


def _missing(numbers: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Give the first and the last of each run of numbers that are not there, from 0 on."""
    due = 0
    for here in numbers:
        if here > due:
            yield due, here - 1
        due = here + 1


def origin(trial: Trial) -> Html:
    """Tell what ran, on what, and with which files."""
    config = dict(trial.config) if isinstance(trial.config, dict) else {}
    hashes = config.get("policy_sha256")
    profile = config.get("profile")
    rows = [("platform", trial.platform), ("policy", trial.policy)]
    if isinstance(profile, dict) and "name" in profile:
        rows.append(("profile", str(profile["name"])))
    rows += [(name, str(config[name])) for name in _PLAIN if config.get(name) not in (None, "")]
    if isinstance(hashes, dict):
        rows += [(f"sha256 of {name}", str(value)) for name, value in sorted(hashes.items())]
    rows += [(name, str(value)) for name, value in trial.about.items() if name not in ("platform", "policy")]
    cells = [
        (shortened(name, LONGEST_TEXT), tag("code", shortened(value, LONGEST_TEXT))) for name, value in rows
    ]
    whole = yaml.safe_dump(config, sort_keys=False, allow_unicode=True)
    details = tag(
        "details", tag("summary", "whole configuration"), tag("pre", shortened(whole, LONGEST_CONFIG))
    )
    return section("Origin", table(("what", "value"), cells, class_="origin"), details, class_="long")
