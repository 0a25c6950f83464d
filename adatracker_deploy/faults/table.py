"""Result tables: in a terminal one line per row, in Markdown one line per fault with the robots side by
side."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.faults.matrix import NOT_SHOWN, REFUSALS, ROWS
from adatracker_deploy.faults.phases import ORDER, TrialPhase

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from rich.console import RenderableType

    from adatracker_deploy.faults.judge import Result

BEGIN, END = "<!-- faults: begin -->", "<!-- faults: end -->"
"""Markers around the generated section of a Markdown file."""
_ORDER = [*(row.fault for row in ROWS), *(refusal.name for refusal in REFUSALS)]
_COLOURS = {"ok": "green", "LATE": "red", "WRONG": "red", "not shown": "yellow"}


def results_table(results: Sequence[Result]) -> RenderableType:
    """Draw every row, and each fault that could not be tested with its reason."""
    table = Table(box=box.SIMPLE_HEAD, padding=0, show_edge=False, caption=_CAPTION, caption_justify="left")
    for column in ("fault", "robot", "limit"):
        table.add_column(column, no_wrap=True)
    for column in ("time", "at m/s", "stands", "stall"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    phase = TrialPhase.FOLLOWING
    shown = [result for result in results if not _unshown(result)]
    for result in sorted(shown, key=lambda result: ORDER.index(TrialPhase(result.phase))):
        if result.phase != phase:
            phase = TrialPhase(result.phase)
            table.add_section()
            table.add_row(Text(f"{phase}:", "bold"))
        value_s = result.value_s if result.told_s is not None else None
        times = (value_s, result.onset_m_s, result.stands_s, result.stall_s)
        again = f" ({result.tries})" if result.tries > 1 else ""
        table.add_row(
            *map(Text, (f"{result.fault}{result.variant}", result.platform, result.limit)),
            *(Text(_seconds(time_s)) for time_s in times),
            Text(result.verdict + again, _COLOURS[result.verdict]),
        )
    reasons = [f"{result.platform} {result.name}: {result.note}" for result in results if _unshown(result)]
    reasons += [f"{name}: {why}" for name, why in NOT_SHOWN.items()]
    return Group(table, Text("not shown:"), *(Text(f"  {reason}") for reason in reasons))


_CAPTION = (
    "seconds from the onset; time: the measure of the limit. told: the last motion command that reached the "
    "robot; quiet: the last while the fault lasts; woken: the last after the machine's sleep; latched: the "
    "link's stop; climbs: when a drone last did; stands: the robot's true speed, 'at' is the onset's; "
    "stall: how long the machine itself stood still about the onset; in brackets how often a row was run"
)


def write_markdown(path: Path, results: Sequence[Result], day: str) -> None:
    """Replace the marked section of a Markdown file.

    Args:
        path: the file, which contains both markers.
        results: of the whole matrix or a part of it.
        day: the date, as it is to be written.

    Raises:
        UsageError: it cannot be read or written, or has no marked section.
    """
    before, after = check_section(path)
    try:
        path.write_text(f"{before}{BEGIN}\n{markdown(results, day)}{END}{after}", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--markdown {path}: {error.strerror}") from error


def check_section(path: Path) -> tuple[str, str]:
    """Return the text before and after the marked section of a Markdown file.

    Raises:
        UsageError: it cannot be read, or has no marked section.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--markdown {path}: cannot be read: {error}") from error
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise UsageError(f"--markdown {path}: has no section between {BEGIN} and {END} to write to")
    return before, after


def markdown(results: Sequence[Result], day: str) -> str:
    """Return the results as a Markdown table, one line per fault."""
    robots = list(dict.fromkeys(result.platform for result in results))
    following = [result for result in results if result.phase == TrialPhase.FOLLOWING]
    lines = [
        *_READ_AS.format(day=day).splitlines(),
        "",
        f"| fault | what happens | limit | {' | '.join(robots)} |",
        f"|---|---|---|{'---|' * len(robots)}",
    ]
    for fault in sorted({result.fault for result in following}, key=_ORDER.index):
        of_it = {result.platform: result for result in following if result.fault == fault}
        why = next((f": {result.why}" for result in of_it.values() if result.why), "")
        says = next((result.says for result in of_it.values() if result.says), "")
        fields = (_field(of_it[robot]) if robot in of_it else "" for robot in robots)
        lines.append(f"| `{fault}` | {says} | {_limits(of_it)}{why} | {' | '.join(fields)} |")
    lines += _by_phase([result for result in results if result.phase != TrialPhase.FOLLOWING], robots)
    lines += ["", "Not shown in a rehearsal:", ""]
    lines += [f"* `{name}`: {why}." for name, why in NOT_SHOWN.items()]
    return "\n".join((*lines, ""))


_READ_AS = """\
While the robot follows, measured on {day}. In each field: its true speed at the onset (m/s), the time
that the limit is of, when the robot stood, and, in brackets, the machine's own longest stall then (s)."""
_PHASES_READ_AS = """\
In the other phases. In each field also who noticed first, what was said, and what a second run did with the
robot as it was left."""


def _by_phase(results: Sequence[Result], robots: Sequence[str]) -> list[str]:
    """Return the second table: one line for each fault in each phase."""
    if not results:
        return []
    lines = [
        "",
        *_PHASES_READ_AS.splitlines(),
        "",
        f"| phase | fault | limit | {' | '.join(robots)} |",
        f"|---|---|---|{'---|' * len(robots)}",
    ]
    cells = {(result.phase, result.fault, result.variant) for result in results}
    faults = list(dict.fromkeys(result.fault for result in results))
    for phase, fault, variant in sorted(cells, key=lambda c: (ORDER.index(c[0]), faults.index(c[1]), c[2])):
        of_it = {
            result.platform: result
            for result in results
            if (result.phase, result.fault, result.variant) == (phase, fault, variant)
        }
        why = next((f": {result.why}" for result in of_it.values() if result.why), "")
        fields = (_phase_field(of_it[robot]) if robot in of_it else "" for robot in robots)
        lines.append(f"| {phase}{variant} | `{fault}` | {_limits(of_it)}{why} | {' | '.join(fields)} |")
    return lines


def _phase_field(result: Result) -> str:
    if _unshown(result):
        return _field(result)
    said = f"; {result.noticed or 'nobody'}: {result.reason or result.outcome}"
    again = f"; then {result.again}" if result.again else ""
    return f"{_field(result)}{said}{again}".replace("|", "/")


def _limits(of_it: Mapping[str, Result]) -> str:
    """Return the common limit, or each robot's own."""
    limits = {robot: result.limit for robot, result in of_it.items() if result.limit}
    if len(set(limits.values())) > 1:
        return ", ".join(f"{robot} {limit}" for robot, limit in limits.items())
    return next(iter(limits.values()), "")


def _unshown(result: Result) -> bool:
    return result.verdict == "not shown"


def _field(result: Result) -> str:
    if _unshown(result):
        return f"not shown: {result.note}"
    parts = [] if not result.onset_m_s else [f"at {result.onset_m_s:.1f}"]
    if result.value_s is not None and result.told_s is not None:
        parts.append(f"{result.value_s:.2f}")
    if result.stands_s is not None:
        parts.append(f"stands {result.stands_s:.2f}")
    text = ", ".join(parts) or result.note or result.outcome
    stall = f" ({result.stall_s:.2f})" if parts else ""
    bad = "" if result.verdict == "ok" else f" **{result.verdict}**: {result.note or result.outcome}"
    return f"{text}{stall}{bad}"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
