"""A trial as a recording for Rerun, read back by Rerun's own reader."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.report.rerun_file import all_series
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import START_NS, TICK_NS, a_frame, a_log, a_step, a_trial, an_observation


def exported(folder, out):
    """Every chunk of the recording, by its entity: {entity: [record batch]}."""
    from rerun.chunk import RrdReader

    assert main(["export", str(folder), "--out", str(out)]) == 0
    found = {}
    for chunk in RrdReader(out).stream():
        found.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
    return found


def test_what_can_be_plotted_is_what_was_known_and_moved():
    steps = [
        a_step(0, pose=None, battery=None, state_age_s=math.inf, distance_m=None),
        a_step(1, velocity=None, action=(), distance_m=2.0, state_age_s=0.5),
    ]
    series = all_series(steps)
    assert series["velocity/asked/vx"] == {0: 1.0, 1: 1.0}
    assert series["velocity/measured/vx"] == {0: 0.7}
    assert not [name for name in series if name.endswith(("/vy", "/vz"))]
    assert series["action/1"] == {0: -0.25}
    assert (series["pose/x"], series["pose/yaw"]) == ({1: 1.0}, {1: 0.3})
    assert (series["robot/state_age_s"], series["truth/distance_m"]) == ({1: 0.5}, {1: 2.0})
    assert "robot/battery" not in {name for name in series if 0 in series[name]}
    assert series["latency_ms/infer"] == {0: 2, 1: 2}


def test_an_axis_that_moved_once_is_shown_wherever_it_is_known():
    steps = [a_step(0), a_step(1, sent=Twist(vz=0.2))]
    series = all_series(steps)
    assert series["velocity/sent/vz"] == {0: 0.0, 1: 0.2}
    assert series["velocity/asked/vz"] == {0: 0.0, 1: 0.0}


def test_rerun_reads_every_picture_number_and_event_at_its_time(tmp_path, capsys):
    with a_log(tmp_path, steps=4) as log:
        for step in range(5):
            lost = {"box": None} if step == 2 else {}
            log.step(a_step(step, **lost), a_frame(step), an_observation(step))
        log.event("warning", "the wind is up", START_NS + TICK_NS)
        log.close({"outcome": "completed"})
    folder, out = log.folder, tmp_path / "trial.rrd"
    found = exported(folder, out)
    assert capsys.readouterr().out == f"{out}\n"
    (numbers,) = found["/velocity/sent/vx"]
    assert np.array(numbers["time"].cast("int64")).tolist() == [step * TICK_NS for step in range(5)]
    assert numbers["tick"].to_pylist() == [0, 1, 2, 3, 4]
    assert numbers["Scalars:scalars"].to_pylist() == [[0.8]] * 5
    rows = {name: sum(batch.num_rows for batch in batches) for name, batches in found.items()}
    assert (rows["/camera/picture"], rows["/camera/mask"], rows["/camera/target"]) == (5, 5, 5)
    (event,) = [batch for batch in found["/events"] if "wind" in str(batch["TextLog:text"])]
    assert event["TextLog:level"].to_pylist() == [["WARN"]]
    assert abs(event["time"].cast("int64")[0].as_py() - TICK_NS) < 1e6


def test_pictures_are_passed_on_as_they_were_taken(tmp_path):
    folder = a_trial(tmp_path, [a_step(0)])
    (frame,) = read_trial(folder).frames()
    (batch,) = exported(folder, tmp_path / "trial.rrd")["/camera/picture"]
    (blobs,) = batch["EncodedImage:blob"].to_pylist()
    assert bytes(blobs[0]) == frame.jpeg


@pytest.mark.parametrize(
    ("out", "told"),
    [("trial.mp4", "expected a file that ends in .rrd"), ("no/folder.rrd", "cannot be written")],
)
def test_a_file_that_cannot_be_is_refused_in_a_line(tmp_path, capsys, out, told):
    folder = a_trial(tmp_path, [a_step(0)])
    assert main(["export", str(folder), "--out", str(tmp_path / out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_without_the_sdk_it_says_what_to_install(tmp_path, capsys, monkeypatch):
    folder = a_trial(tmp_path, [a_step(0)])
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["export", str(folder), "--out", str(tmp_path / "trial.rrd")]) == 2
    assert "pip install 'adatracker-deploy[rerun]'" in capsys.readouterr().err
