"""Logs a training run's settings and curves in MLflow. Needs the `mlflow` extra."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from adatracker_deploy.hub.tracking import one_line, open_experiment, unusable

ID_NAME = "mlflow-run.txt"
"""Holds the run's id, in its folder: a resumed training goes on with the same run."""


class MlflowRun:
    """Implements `curves.MetricLogger`; a server that is lost is told of once, and the training goes on."""

    def __init__(
        self, uri: str, out: Path, settings: Mapping[str, str], *, say: Callable[[str], None]
    ) -> None:
        """Begin a run, or go on with the one that the folder names.

        Args:
            uri: of a tracking server, or of a file: ``sqlite:///FILE``.
            out: the training's folder, made where it is missing; the run is named after it.
            settings: of the training, for a run that begins.
            say: told in a line that nothing more is logged.

        Raises:
            UsageError: MLflow is not installed, or cannot log there.
        """
        self._client, self._experiment = open_experiment(uri)
        self._say = say
        self._lost = False
        path = out / ID_NAME
        try:
            self._id = self._begun(path.read_text().strip()) if path.exists() else self._begin(out, settings)
            out.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{self._id}\n")
        except Exception as error:  # of MLflow, its database and its connection: they have no common class
            raise unusable(uri, error) from error

    def _begun(self, run_id: str) -> str:
        self._client.update_run(run_id, status="RUNNING")
        return run_id

    def _begin(self, out: Path, settings: Mapping[str, str]) -> str:
        run = self._client.create_run(self._experiment, run_name=out.resolve().name)
        for name, value in settings.items():
            self._client.log_param(run.info.run_id, name, value)
        return str(run.info.run_id)

    def write(self, update: int, means: Mapping[str, float]) -> None:
        """Add a point to each curve."""
        for name, mean in means.items():
            self._try(self._client.log_metric, self._id, name, mean, step=update)

    def close(self) -> None:
        """End the run."""
        self._try(self._client.set_terminated, self._id)

    def _try(self, call: Callable[..., Any], *arguments: object, **named: object) -> None:
        if self._lost:
            return
        try:
            call(*arguments, **named)
        except Exception as error:  # hours of training are worth more than their curves elsewhere
            self._lost = True
            self._say(f"warning: MLflow is lost, nothing more is logged there: {one_line(error)}")
