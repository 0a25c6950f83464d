"""The place where runs are tracked: MLflow's experiment of this toolkit. Needs the `mlflow` extra."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from mlflow import MlflowClient

EXPERIMENT = "adatracker-deploy"


def open_experiment(uri: str) -> tuple[MlflowClient, str]:
    """Return a client, and the id of the experiment, which is made where it is missing.

    Args:
        uri: of a tracking server, or of a file: ``sqlite:///FILE``.

    Raises:
        UsageError: MLflow is not installed, or cannot be used there.
    """
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # else it tells its makers of each run
    try:
        from mlflow import MlflowClient
    except ImportError as error:
        raise UsageError("--mlflow needs MLflow: pip install 'adatracker-deploy[mlflow]'") from error
    try:
        client = MlflowClient(tracking_uri=uri)
        known = client.get_experiment_by_name(EXPERIMENT)
        return client, str(known.experiment_id if known else client.create_experiment(EXPERIMENT))
    except Exception as error:  # of MLflow, its database and its connection: they have no common class
        raise unusable(uri, error) from error


def unusable(uri: str, error: Exception) -> UsageError:
    """Return the refusal of an address that cannot be used."""
    return UsageError(f"--mlflow {uri}: cannot be used: {one_line(error)}")


def one_line(error: Exception) -> str:
    """Return the first line of what an error says, 300 characters at most."""
    return next(iter(str(error).splitlines()), type(error).__name__)[:300]
