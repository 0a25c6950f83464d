"""Three robots at once through real processes: they complete, and one stop stops all in their limits.

Each robot's black box says, on the machine's clock, when its link was told to stop and when it stood.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from pathlib import Path

import pytest
import yaml

from adatracker_deploy.cli import main
from adatracker_deploy.registry import profile_dir
from adatracker_deploy.runtime.black_box import FILE_NAME, read_black_box
from adatracker_deploy.runtime.link import Phase
from adatracker_deploy.runtime.running import PLACE_VARIABLE, Running, running
from adatracker_deploy.trial.reader import read_trial
from tests.tiers import EXHAUSTIVE

from .conftest import gone, started

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

BUSY_S = 0.25
TOLD_S = 0.2 + BUSY_S
"""As the fault matrix's `interrupt`, whatever the number of robots."""
STANDS_S = {"left": 2.0, "right": 2.0, "hawk": 3.0}
"""As there, of a base and of a drone at full speed."""
STILL_M_S, MOVES_M_S = 0.25, 0.4


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(PLACE_VARIABLE, str(tmp_path))


@pytest.fixture(autouse=True)
def patient(tmp_path):
    """Robots that three trials at once on two shared cores do not stop: fewer pictures, more patience."""
    for name in ("scout", "tracer", "px4_quad"):
        profile = yaml.safe_load((profile_dir() / f"{name}.yaml").read_text())
        profile["camera"]["rate_hz"] = 10
        if name != "px4_quad":
            profile["connection"]["roles"].setdefault("timing", {})["feedback_timeout_s"] = 1.0
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(profile))


@pytest.fixture
def fleet(tmp_path):
    """Start a fleet: two wheeled bases, and a drone unless `flies` is false."""
    with started(tmp_path, "--fleet", "fleet.yaml", "--sitl", "--json") as start:

        def begin(steps: int, *, flies: bool = True, left: dict | None = None, **settings):
            robots = {
                "left": {"platform": "wheeled", "profile": "scout.yaml"} | (left or {}),
                "right": {"platform": "wheeled", "profile": "tracer.yaml", "seed": 1},
            }
            if flies:
                robots["hawk"] = {"platform": "drone", "profile": "px4_quad.yaml"}
            common = {"segmenter": "truth", "policy": "pid", "steps": steps}
            document = {"common": common, "robots": robots, **settings}
            (tmp_path / "fleet.yaml").write_text(yaml.safe_dump(document))
            return start()

        yield begin


def folder_of(tmp_path) -> Path:
    (folder,) = (tmp_path / "trials").glob("*_fleet_sitl")
    return folder


def await_driving(run, names, timeout_s: float = 90) -> None:
    """Wait until every robot of the fleet follows, and reports to move."""
    pause, end_s, found = threading.Event(), time.monotonic() + timeout_s, {}
    while time.monotonic() < end_s:
        found = {one.name: newest(one) for one in running() if one.name and one.log}
        if all(name in found and drives(*found[name]) for name in names):
            return
        if run.process.poll() is not None:
            pytest.fail(run.end()[2])
        pause.wait(0.2)
    pytest.fail(f"not all drive within {timeout_s} s: {found}")


def drives(phase: str, speed_m_s: float | None) -> bool:
    return phase == Phase.ACTIVE and speed_m_s is not None and speed_m_s > MOVES_M_S


def newest(one: Running) -> tuple[str, float | None]:
    """Return a robot's phase and speed, m/s, as its link knew them last."""
    box = Path(one.log) / FILE_NAME
    moments = read_black_box(box) if box.exists() else ()
    return (moments[-1].status.phase, speed_m_s(moments[-1])) if moments else ("", None)


def stop_times(trial: Path, since_ns: int) -> tuple[float, float]:
    """Return when the link began to hold, and when its robot reported to stand, s after `since_ns`."""
    after = [one for one in read_black_box(trial / FILE_NAME) if one.monotonic_ns >= since_ns]
    told = next(one for one in after if one.status.phase not in (Phase.ENGAGING, Phase.ACTIVE))
    stands = next(
        one
        for one in after
        if one.monotonic_ns >= told.monotonic_ns
        and (speed := speed_m_s(one)) is not None
        and speed < STILL_M_S
    )
    return (told.monotonic_ns - since_ns) / 1e9, (stands.monotonic_ns - since_ns) / 1e9


def speed_m_s(moment) -> float:
    velocity = moment.status.state.velocity
    return None if velocity is None else (velocity.vx**2 + velocity.vy**2) ** 0.5


@EXHAUSTIVE
def test_three_robots_start_together_and_complete_and_one_page_shows_them(fleet, tmp_path):
    status, found, err = fleet(60).end(timeout_s=200)
    assert status == 0, err
    assert {name: one["result"]["outcome"] for name, one in found["robots"].items()} == dict.fromkeys(
        STANDS_S, "completed"
    ), err
    assert err.index("all are ready; starting") < err.index("engaging")
    folder = folder_of(tmp_path)
    page = (tmp_path / found["report"]).read_text()
    for name in STANDS_S:
        (log,) = (folder / name).glob("*/trial.mcap")
        assert read_trial(log).config["robot"] == name
        assert f"{name}: {log.parent.name}" in page


@EXHAUSTIVE
def test_one_stop_stops_all_three_in_their_limits(fleet, tmp_path, capsys, measured):
    run = fleet(100_000)
    await_driving(run, STANDS_S)
    names = {one.name for one in running()}
    assert names == {"", *STANDS_S}
    onset_ns = time.monotonic_ns()
    assert main(["stop", "fleet"]) == 0
    status, found, err = run.end()
    assert status == 130, err
    capsys.readouterr()
    for name, limit_s in STANDS_S.items():
        summary = found["robots"][name]["result"]
        assert summary["outcome"] == "interrupted", err
        told_s, stands_s = stop_times(tmp_path / summary["trial"], onset_ns)
        measured(f"fleet, {name}: one stop, told after {told_s:.2f} s, stands after {stands_s:.2f} s")
        assert told_s < TOLD_S
        assert stands_s < limit_s


@EXHAUSTIVE
def test_they_stop_when_the_fleets_command_is_killed(fleet, measured):
    run = fleet(100_000)
    await_driving(run, STANDS_S)
    robots = {one.name: one for one in running() if one.name}
    onset_ns = time.monotonic_ns()
    os.kill(run.pid, signal.SIGKILL)
    over, end_s = threading.Event(), time.monotonic() + 90
    while any(one.alive() for one in robots.values()) and time.monotonic() < end_s:
        over.wait(0.05)
    for name, one in robots.items():
        assert gone(one.pid)
        assert json.loads((Path(one.log) / "summary.json").read_text())["outcome"] == "interrupted"
        told_s, stands_s = stop_times(Path(one.log), onset_ns)
        measured(f"fleet, {name}: command killed, told after {told_s:.2f} s, stands after {stands_s:.2f} s")
        assert told_s < TOLD_S
        assert stands_s < STANDS_S[name]


@EXHAUSTIVE
def test_a_robot_that_fails_stops_the_others(fleet):
    status, found, err = fleet(100_000, flies=False, left={"fault": "link_drop@1"}).end(timeout_s=120)
    assert status == 1
    assert "left has failed: all stop" in err
    assert found["robots"]["left"]["status"] == 1
    assert found["robots"]["right"]["result"]["outcome"] == "interrupted"


@EXHAUSTIVE
def test_the_others_go_on_where_the_file_says_so(fleet):
    run = fleet(80, flies=False, left={"fault": "link_drop@1"}, on_failure="go-on")
    status, found, err = run.end(timeout_s=120)
    assert status == 1
    assert found["robots"]["left"]["status"] == 1
    assert found["robots"]["right"]["result"]["outcome"] == "completed", err
