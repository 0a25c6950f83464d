"""``faults``: what is asked for is run for real, told as JSON and Markdown, and decides the exit status."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from adatracker_deploy import platform
from adatracker_deploy.cli import faults, main
from adatracker_deploy.faults.judge import Result
from adatracker_deploy.faults.stalls import Stalls
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


def test_a_robot_whose_far_end_takes_no_orders_is_refused_or_left_out(capsys, monkeypatch):
    monkeypatch.setattr(platform, "platform_names", lambda: ["fake"])
    monkeypatch.setattr(platform, "load_platform", lambda _: FakePlatform)
    monkeypatch.setattr("adatracker_deploy.profile.load_profile", lambda *_: None)
    monkeypatch.setattr(FakePlatform, "sitl", lambda _: NoOrders())
    assert main(["faults", "--platform", "fake"]) == 2
    assert "its far end takes no orders" in capsys.readouterr().err
    assert main(["faults"]) == 0


class NoOrders(platform.Sitl):
    def start(self, clock, scenario): ...

    def close(self): ...


def test_a_run_without_faults_holds_nothing_that_could_strike():
    loaded = "'adatracker_deploy.faults.injection' in sys.modules"
    looks = f"import adatracker_deploy.trial_run, sys; sys.exit({loaded})"
    assert subprocess.run([sys.executable, "-c", looks], check=False).returncode == 0


def answer(verdict, stall_s=0.0):
    return Result(platform="wheeled", fault="link_kill", says="", limit="", verdict=verdict, stall_s=stall_s)


@pytest.mark.parametrize(
    ("answers", "verdict", "tries"),
    [
        ([answer("ok", 0.5)], "ok", 1),
        ([answer("LATE", 0.01)], "LATE", 1),
        ([answer("LATE", 0.2), answer("WRONG", 0.1), answer("ok")], "ok", 3),
        ([answer("LATE", 0.2)] * 3, "LATE", 3),
    ],
)
def test_a_row_that_goes_wrong_is_run_again_only_where_the_machine_stood_still(answers, verdict, tries):
    left, folders = iter(answers), []

    def job(_, folder):
        folders.append(folder)
        assert list(folder.iterdir()) == []
        return next(left)

    result = faults._until_calm(job, Stalls())
    assert (result.verdict, result.tries) == (verdict, tries)
    assert next(left, None) is None
    assert not any(folder.exists() for folder in folders)
