"""Trials in MLflow: one run for each, however often it is scored. Needs the `mlflow` extra."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from adatracker_deploy.hub.tracking import open_experiment, unusable

TRIAL = "adatracker.trial"
"""Tag with the name of the trial's folder, by which it is found again."""
_SETTINGS = ("platform", "policy", "kind", "steps", "episode")


def log_trials(uri: str, summaries: Sequence[Mapping[str, Any]]) -> None:
    """Log each trial's scores, in the run that it has there or in one of its own.

    Args:
        uri: of a tracking server, or of a file: ``sqlite:///FILE``.
        summaries: of trials, as `scoring.summary` makes them.

    Raises:
        UsageError: MLflow is not installed, or cannot log there.
    """
    client, experiment = open_experiment(uri)
    try:
        for summary in summaries:
            name = Path(summary["trial"]).resolve().name
            there = client.search_runs([experiment], f"tags.`{TRIAL}` = {_quoted(name)}", max_results=1)
            run = there[0] if there else client.create_run(experiment, tags={TRIAL: name}, run_name=name)
            if not there:
                for setting in _SETTINGS:
                    if summary.get(setting) is not None:
                        client.log_param(run.info.run_id, setting, summary[setting])
            client.set_tag(run.info.run_id, "outcome", summary["outcome"])
            for metric, value in metrics(summary):
                client.log_metric(run.info.run_id, metric, value)
            client.set_terminated(run.info.run_id)
    except Exception as error:  # of MLflow, its database and its connection: they have no common class
        raise unusable(uri, error) from error


def metrics(summary: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Give a summary's finite numbers by name; those of a group within it as ``group.name``."""
    for name, value in summary.items():
        if isinstance(value, Mapping):
            yield from metrics(value, f"{prefix}{name}.")
        elif isinstance(value, bool | int | float) and name not in _SETTINGS and math.isfinite(value):
            yield f"{prefix}{name}", float(value)


def _quoted(name: str) -> str:
    quote = '"' if "'" in name else "'"
    return f"{quote}{name}{quote}"
