"""A hand's events as a file: a JSON object a line, ``{"t_s": 1.25, "code": "forward", "value": 0.5}``.

Every trial with ``--teleop`` leaves one beside its log, and ``--teleop FILE`` drives by one. Times are
seconds since the first tick, with nine decimals, so that they come back exactly: up to 10^6 s a double tells
one nanosecond from the next.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.teleop.takeover import AXES, CODES, InputEvent

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

EVENTS_NAME = "teleop.jsonl"
"""Name of the file in a trial's folder."""
_SIZE_CAP_BYTES = 1 << 26
_LONGEST_S = 1e6


def write_events(events: Iterable[InputEvent]) -> str:
    """Return events as a file's text."""
    return "".join(
        f'{{"t_s": {_seconds(event.t_ns)}, "code": "{event.code}", "value": {event.value!r}}}\n'
        for event in events
    )


def read_events(path: Path) -> tuple[InputEvent, ...]:
    """Return a file's events.

    Raises:
        UsageError: it cannot be read, a line holds no event, or the times run backwards.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_SIZE_CAP_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    if len(data) > _SIZE_CAP_BYTES:
        raise UsageError(f"{path}: larger than 64 MiB; these are no events of a hand")
    events: list[InputEvent] = []
    for number, line in enumerate(data.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            event = _event(json.loads(line))
        except (ValueError, RecursionError, OverflowError) as error:
            raise UsageError(f"{path}: line {number}: {error}") from error
        if events and event.t_ns < events[-1].t_ns:
            raise UsageError(f"{path}: line {number}: its time is before that of the event above")
        events.append(event)
    return tuple(events)


def _event(fields: Any) -> InputEvent:
    """Return a line's event.

    Raises:
        ValueError: it holds none.
    """
    if not isinstance(fields, dict) or set(fields) - {"t_s", "code", "value"} or "t_s" not in fields:
        raise ValueError('expected {"t_s": SECONDS, "code": NAME, "value": NUMBER}')
    t_s, code, value = fields["t_s"], fields.get("code"), fields.get("value", 1.0)
    if code not in CODES:
        raise ValueError(f"unknown code {code!r}: there are {', '.join(CODES)}")
    for name, number, most in (("t_s", t_s, _LONGEST_S), ("value", value, 1.0)):
        if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) <= most:
            raise ValueError(f"{name} {number!r}: expected a number from {-most:g} to {most:g}")
    if code not in AXES and value < 0:
        raise ValueError(f"value {value!r}: {code} has none below 0")
    return InputEvent(round(t_s * 1e9), code, float(value))


def _seconds(t_ns: int) -> str:
    sign, (whole, rest) = "-" if t_ns < 0 else "", divmod(abs(t_ns), 10**9)
    return f"{sign}{whole}.{rest:09d}"
