"""A robot from outside, installed beside the toolkit's wheel, is found, rehearsed and conforms."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.installed import ROOT, install_wheel
from tests.tiers import EXHAUSTIVE

GUIDE = ROOT / "docs" / "add-a-robot.md"


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The rover's project, copied and renamed by the very commands that the guide gives."""
    home = tmp_path_factory.mktemp("home")
    (commands, *_) = re.findall(r"```sh\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    subprocess.run(["bash", "-euc", commands], check=True, cwd=ROOT, env=os.environ | {"HOME": str(home)})
    return home / "mybot"


@pytest.fixture(scope="module")
def run(project):
    """Run a module in a environment that has the toolkit's wheel and the copy, both installed."""
    environment = install_wheel(project.parent)

    def run(*arguments: str, folder: Path = project) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [environment / "bin" / "python", "-P", "-m", *arguments],
            check=False,
            cwd=folder,
            env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            timeout=170,
        )

    installed = run("pip", "install", "-q", "--no-build-isolation", "--no-deps", "--no-index", str(project))
    assert installed.returncode == 0, installed.stderr
    return run


@pytest.mark.slow
def test_it_is_listed_with_its_profile(run, tmp_path):
    for what, text in (("platforms", "default profile mybot"), ("profiles", "mybot: the example mybot")):
        listed = run("adatracker_deploy", what, "--json", folder=tmp_path)
        assert listed.returncode == 0, listed.stderr
        assert text in json.loads(listed.stdout)[what]["mybot"]


def test_it_imports_the_public_interface_alone():
    sources = list((ROOT / "examples" / "rover").rglob("*.py"))
    imported = {name for path in sources for name in re.findall(r"adatracker_deploy[.\w]*", path.read_text())}
    public = {"adatracker_deploy", "adatracker_deploy.sim", "adatracker_deploy.testing.conformance"}
    assert len(sources) > 10
    assert imported == public


@pytest.mark.slow
def test_it_rehearses(run, tmp_path):
    done = run(
        "adatracker_deploy", *("--platform", "mybot", "--sitl", "--steps", "60", "--json"), folder=tmp_path
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    print({key: summary[key] for key in ("mr", "el", "rate_hz", "stop_s")})
    assert summary["outcome"] == "completed"
    assert summary["mr"] > 0


@EXHAUSTIVE
@pytest.mark.slow
def test_its_own_tests_pass_where_it_is_installed(run):
    """They inherit the conformance suite from the toolkit."""
    tested = run("pytest", "-q", "-p", "no:cacheprovider")
    assert tested.returncode == 0, tested.stdout
    print(tested.stdout.splitlines()[-1])


@pytest.mark.slow
def test_the_toolkit_knows_nothing_of_it_where_it_is_not_installed():
    listed = subprocess.run(
        [sys.executable, "-m", "adatracker_deploy", "platforms", "--json"],
        check=True,
        capture_output=True,
        text=True,
    )
    assert "mybot" not in json.loads(listed.stdout)["platforms"]
