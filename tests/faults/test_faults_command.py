"""``faults``: what is asked for is run for real, told as JSON and Markdown, and decides the exit status."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import threading

import pytest

from adatracker_deploy import platform, registry
from adatracker_deploy.cli import extras, faults, main
from adatracker_deploy.faults.judge import Result
from adatracker_deploy.faults.stalls import StallMonitor
from adatracker_deploy.faults.table import BEGIN, END
from adatracker_deploy.testing.fake import FakePlatform

REFUSED = ("model_wrong_shape", "profile_malformed")


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_what_must_be_refused_is_refused_and_written_down(capsys, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"{BEGIN}{END}")
    assert (
        main(["faults", "--platform", "wheeled", "--fault", *REFUSED, "--json", "--markdown", str(page)]) == 0
    )
    told = json.loads(capsys.readouterr().out)["faults"]
    assert [(one["fault"], one["platform"], one["verdict"], one["outcome"]) for one in told] == [
        (name, "wheeled", "ok", "exit 2") for name in REFUSED
    ]
    assert all(f"| `{name}` | " in page.read_text() for name in REFUSED)


def test_a_robot_that_lacks_what_was_asked_for_is_told_with_the_reason(capsys):
    assert main(["faults", "--platform", "drone", "--fault", "camera_gone"]) == 0
    out = capsys.readouterr().out
    assert "nothing to show" in out
    assert "drone camera_gone: its camera is drawn in the tracker" in " ".join(out.split())


def test_a_robot_whose_simulator_takes_no_orders_is_refused_or_left_out(capsys, monkeypatch):
    monkeypatch.setattr(registry, "platform_names", lambda: ["fake"])
    monkeypatch.setattr(registry, "load_platform", lambda _: FakePlatform)
    monkeypatch.setattr(registry, "load_profile", lambda *_: None)
    monkeypatch.setattr(FakePlatform, "sitl", lambda _: NoOrders())
    assert main(["faults", "--platform", "fake"]) == 2
    assert "its simulator takes no commands" in capsys.readouterr().err
    assert main(["faults"]) == 0


def test_a_robot_whose_libraries_are_not_installed_is_refused_or_left_out_aloud(capsys, monkeypatch):
    monkeypatch.setattr(registry, "platform_names", lambda: ["ros2"])
    monkeypatch.setattr(extras, "installed", lambda name: name != "ros-rclpy")
    assert main(["faults", "--platform", "ros2"]) == 2
    assert "platform ros2 needs ros-rclpy: pip install" in capsys.readouterr().err
    assert main(["faults"]) == 0
    assert capsys.readouterr().err.startswith("left out: platform ros2 needs ros-rclpy")


class NoOrders(platform.Sitl):
    def start(self, clock, scenario): ...

    def close(self): ...


def test_a_run_without_faults_holds_nothing_that_could_strike():
    loaded = "'adatracker_deploy.faults.injection' in sys.modules"
    looks = f"import adatracker_deploy.app.trial_run, sys; sys.exit({loaded})"
    assert subprocess.run([sys.executable, "-c", looks], check=False).returncode == 0


def answer(verdict, stall_s=0.0):
    return Result(platform="wheeled", fault="link_kill", says="", limit="", verdict=verdict, stall_s=stall_s)


@pytest.mark.parametrize(
    ("answers", "alone", "verdict", "tries"),
    [
        ([answer("ok", 0.5)], False, "ok", 1),
        ([answer("LATE", 0.01)], False, "LATE", 1),
        ([answer("LATE", 0.2), answer("WRONG", 0.1), answer("ok")], False, "ok", 3),
        ([answer("LATE", 0.2)] * 3, False, "LATE", 3),
        ([answer("ok")], True, "ok", 1),
        ([answer("LATE", 0.01), answer("ok")], True, "ok", 2),
        ([answer("LATE", 0.01)] * 3, True, "LATE", 3),
    ],
)
def test_a_row_that_goes_wrong_is_run_again_where_the_machine_stood_still_or_it_is_one_of_timing(
    answers, alone, verdict, tries
):
    left, folders = iter(answers), []

    def row(_, folder):
        folders.append(folder)
        assert list(folder.iterdir()) == []
        return next(left)

    result = faults._until_calm(faults.Job(row, alone), StallMonitor())
    assert (result.verdict, result.tries) == (verdict, tries)
    assert next(left, None) is None
    assert not any(folder.exists() for folder in folders)


class Yard:
    """Rows that note which others run; the first ones wait until all of these do."""

    def __init__(self, robots):
        self.together = threading.Barrier(robots)
        self.running, self.seen = [], []

    def job(self, platform, *verdicts, alone=False):
        left = iter(verdicts)

        def run(*_):
            self.running.append(platform)
            self.seen.append((tuple(self.running), alone))
            if len(self.seen) <= self.together.parties:
                self.together.wait(10)
            self.running.remove(platform)
            return dataclasses.replace(answer(next(left)), platform=platform)

        return faults.Job(run, alone)


def test_rows_are_rehearsed_side_by_side_of_one_robot_too():
    yard, told = Yard(robots=2), []
    jobs = [yard.job(name, "ok") for name in ("drone", "drone", "drone", "wheeled", "wheeled")]
    results = faults._run_all(jobs, 2, StallMonitor(), told.append)
    assert [result.platform for result in results] == ["drone"] * 3 + ["wheeled"] * 2
    assert yard.seen[1] == (("drone", "drone"), False)
    assert {len(running) for running, _ in yard.seen} == {1, 2}
    assert len(told) == 5


def test_rows_of_timing_and_those_that_went_wrong_beside_another_run_alone_and_the_first_failure_stays():
    yard, told = Yard(robots=2), []
    jobs = [
        yard.job("drone", "ok", alone=True),
        yard.job("drone", "LATE", "ok"),
        yard.job("wheeled", "ok"),
    ]
    results = faults._run_all(jobs, 2, StallMonitor(), told.append)
    assert [result.verdict for result in results] == ["ok"] * 3
    assert yard.seen[2:] == [(("drone",), True), (("drone",), False)]
    assert [result.platform for result in told] == ["wheeled", "drone", "drone"]
    assert results[1].first_failure.startswith("beside others, LATE")
    assert not results[0].first_failure
    assert not results[2].first_failure


def test_rows_that_went_wrong_beside_many_are_run_beside_half_as_many_and_only_then_alone():
    yard, told = Yard(robots=4), []
    jobs = [
        yard.job("a", "LATE", "ok"),
        yard.job("b", "WRONG", "LATE", "ok"),
        yard.job("c", "ok"),
        yard.job("d", "ok"),
    ]
    results = faults._run_all(jobs, 4, StallMonitor(), told.append)
    assert [result.verdict for result in results] == ["ok"] * 4
    assert [result.platform for result in told[2:]] == ["a", "b"]
    assert len(yard.seen) == 4 + 2 + 1
    assert max(len(running) for running, _ in yard.seen[4:]) <= 2
    assert results[0].first_failure.startswith("beside others, LATE")
    assert results[1].first_failure.startswith("beside others, WRONG")


def test_a_row_that_is_wrong_alone_too_is_wrong():
    jobs = [faults.Job(lambda *_: answer("LATE"))]
    assert [result.verdict for result in faults._run_all(jobs, 2, StallMonitor(), lambda _: None)] == ["LATE"]


def test_every_first_failure_is_told_and_counted(capsys, monkeypatch):
    once = iter([answer("WRONG", 0.2), answer("ok")])
    monkeypatch.setattr(faults, "_jobs", lambda _: [faults.Job(lambda *_: next(once))])
    monkeypatch.setattr(faults, "_absent", lambda _: [])
    assert main(["faults", "--json"]) == 0
    captured = capsys.readouterr()
    (told,) = json.loads(captured.out)["faults"]
    assert told["first_failure"] == "WRONG (limit ), machine stalled 0.20 s"
    assert "first try of wheeled link_kill: WRONG" in captured.err
    assert "failed at their first try: 1" in captured.err


def test_phases_are_chosen_by_name(capsys):
    assert main(["faults", "--platform", "drone", "--phase", "between", "--fault", "link_kill"]) == 0
    assert "drone link_kill@between: no link and no camera then" in " ".join(capsys.readouterr().out.split())
    assert main(["faults", "--phase", "landing"]) == 2
    assert "connecting" in capsys.readouterr().err
    assert main(["faults", "--fault", "interrupt@landing"]) == 2
    assert "unknown to the matrix" in capsys.readouterr().err
