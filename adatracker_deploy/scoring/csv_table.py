"""Trials as CSV, one line each, for spreadsheets and plots."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.scoring.tally import Summary

COLUMNS = (
    "trial", "platform", "policy", "outcome", "mr", "mr_visible", "visibility", "el", "steps", "seconds",
    "rate_hz", "ar", "missed_deadlines", "bad_boxes", "reason", "recorded_outcome",
    "stale", "timing_kept", "counted", "takeovers", "between_s", "between_m",
)  # fmt: skip
"""Keys of a trial's summary; what a trial does not have is empty."""


def csv_table(summaries: Sequence[Summary]) -> str:
    """Return a line of names and a line a trial, in full precision (RFC 4180, but lines end in a newline)."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(_flat(row) for row in summaries)
    return out.getvalue()


def _flat(row: Summary) -> Summary:
    """Return a row with the takeovers' count and rates as its own."""
    taken = row.get("takeovers")
    if not taken:
        return row
    return {
        **row,
        "takeovers": taken["count"],
        "between_s": taken["between_s"],
        "between_m": taken["between_m"],
    }
