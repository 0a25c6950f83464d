"""A training run's curves and settings are in MLflow, in one run however often it is resumed."""

from __future__ import annotations

import pytest

pytest.importorskip("mlflow")
pytest.importorskip("torch")

from mlflow import MlflowClient

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.hub.tracking import EXPERIMENT
from adatracker_deploy.learning.train.curves import EVERY, Curves
from adatracker_deploy.learning.train.mlflow_run import ID_NAME, MlflowRun


@pytest.fixture(scope="module")
def uri(tmp_path_factory):
    """A database of SQLite; making its tables takes seconds."""
    return f"sqlite:///{tmp_path_factory.mktemp('mlflow')}/mlflow.db"


def trained(uri, out, updates, said=None):
    """Write as many updates' curves as `train` would."""
    logger = MlflowRun(uri, out, {"seed": "7"}, say=(said if said is not None else []).append)
    curves = Curves(out, updates.start, [logger])
    for update in updates:
        curves.add(update + 1, {"loss": float(update + 1)})
    return curves, logger


def test_curves_and_settings_arrive_and_a_resumed_training_is_the_same_run(uri, tmp_path):
    out = tmp_path / "my-run"
    trained(uri, out, range(EVERY))[0].close()
    trained(uri, out, range(EVERY, 2 * EVERY))[0].close()
    client = MlflowClient(tracking_uri=uri)
    (run,) = client.search_runs([client.get_experiment_by_name(EXPERIMENT).experiment_id])
    assert run.info.run_id == (out / ID_NAME).read_text().strip()
    assert (run.info.run_name, run.info.status) == ("my-run", "FINISHED")
    assert run.data.params == {"seed": "7"}
    points = [(point.step, point.value) for point in client.get_metric_history(run.info.run_id, "loss")]
    assert points == [(EVERY, (1 + EVERY) / 2), (2 * EVERY, EVERY + (1 + EVERY) / 2)]
    assert (out / "curves.csv").read_text().splitlines()[1:] == [
        f"{step},loss,{value:.6g}" for step, value in points
    ]


def test_what_is_lost_on_the_way_is_told_once_and_training_goes_on(uri, tmp_path):
    said = []
    curves, logger = trained(uri, tmp_path, range(0), said)
    logger._client.delete_run(logger._id)  # as somebody else may
    for update in range(2 * EVERY):
        curves.add(update + 1, {"loss": 1.0, "cloning": 2.0})
    curves.close()
    (line,) = said
    assert line.startswith("warning: MLflow is lost")
    assert len((tmp_path / "curves.csv").read_text().splitlines()) == 5


def test_where_nothing_can_be_logged_is_refused_before_the_training(tmp_path):
    with pytest.raises(UsageError, match="--mlflow nonsense://x: cannot be used") as refused:
        MlflowRun("nonsense://x", tmp_path, {}, say=print)
    assert len(str(refused.value).splitlines()) == 1
