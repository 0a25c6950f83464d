"""``score --mlflow``: each trial's scores are in MLflow, in one run however often it is scored."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("mlflow")

from mlflow import MlflowClient

from adatracker_deploy.cli import main
from adatracker_deploy.hub.tracking import EXPERIMENT
from tests.trial.records import a_step, a_trial


@pytest.fixture(scope="module")
def uri(tmp_path_factory):
    """A database of SQLite; making its tables takes seconds."""
    return f"sqlite:///{tmp_path_factory.mktemp('mlflow')}/mlflow.db"


def test_a_trials_scores_are_there_once_and_are_renewed(uri, tmp_path, capsys):
    for name, seen in (("a", 11), ("it's b", 6)):
        steps = [a_step(step, box=a_step(0).box if step < seen else None) for step in range(11)]
        a_trial(tmp_path / name, steps, {"outcome": "completed"})
    assert main(["score", str(tmp_path), "--json", "--mlflow", uri]) == 0
    first = json.loads(capsys.readouterr().out)["trials"]
    assert main(["score", str(tmp_path), "--json", "--mlflow", uri, "--lost-steps", "3"]) == 0
    again = json.loads(capsys.readouterr().out)["trials"]
    assert [one["mr"] for one in first] != [one["mr"] for one in again]

    client = MlflowClient(tracking_uri=uri)
    runs = client.search_runs([client.get_experiment_by_name(EXPERIMENT).experiment_id])
    scores = {run.data.tags["adatracker.trial"]: run for run in runs}
    assert len(runs) == len(again) == 2
    for one in again:
        run = scores[one["trial"].rpartition("/")[2]]
        assert (run.info.status, run.data.tags["outcome"]) == ("FINISHED", one["outcome"])
        assert (run.data.params["platform"], run.data.params["policy"]) == (one["platform"], one["policy"])
        for name in ("mr", "el", "mr_visible"):
            assert run.data.metrics[name] == one[name]
        assert run.data.metrics["latency_ms.p50"] == one["latency_ms"]["p50"]


def test_where_nothing_can_be_logged_is_refused_in_one_line(tmp_path, capsys):
    a_trial(tmp_path / "a", [a_step(step) for step in range(3)], {"outcome": "completed"})
    assert main(["score", str(tmp_path), "--mlflow", "nonsense://x"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "--mlflow nonsense://x: cannot be used" in line
