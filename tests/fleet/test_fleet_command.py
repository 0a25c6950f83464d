"""A wrong fleet gets one clear line and exit status 2 before anything moves, and leaves nothing behind."""

from __future__ import annotations

import pytest

from adatracker_deploy.cli import main

BUS = "{platform: wheeled, profile: %s}"


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("ADATRACKER_RUN_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)


def refused(capsys, tmp_path, text: str, *arguments: str) -> str:
    (tmp_path / "fleet.yaml").write_text(text)
    assert main(["--fleet", "fleet.yaml", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert not (tmp_path / "trials").exists() or not list((tmp_path / "trials").iterdir())
    (line,) = err.strip().splitlines()
    return line


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robots: {a: {platform: submarine}}", "robots: a: unknown platform 'submarine'"),
        ("robots: {a: {platform: 'drone,wheeled'}}", "robots: a: unknown platform 'drone,wheeled'"),
        ("robots: {a: {platform: drone, profile: px5}}", "robots: a: unknown profile 'px5'"),
        ("robots: {a: {platform: drone, steps: 0}}", "robots: a: argument --steps: 0 is out of range"),
        ("robots: {a: {platform: drone, teleop: keyboard}}", "a fleet has no keyboard of its own"),
        (
            "robots: {a: {platform: drone}, b: {platform: wheeled}, c: {platform: drone}}",
            "robots: a and c reach the same robot, mavlink:udpin://127.0.0.1:14540:1",
        ),
        (
            "robots: {a: {platform: wheeled, profile: scout}, b: {platform: wheeled, profile: tracer}}",
            "robots: a and b reach the same robot, can:socketcan:can0",
        ),
        ("robots: {a: {platform: quadruped}, b: {platform: quadruped}}", "reach the same robot, zenoh:tcp/"),
        (
            "{common: {page: 8080}, robots: {a: {platform: drone}, b: {platform: wheeled}}}",
            "robots: a and b have their page at the same port, 8080",
        ),
        (
            "{common: {live: 8765}, robots: {a: {platform: drone}, b: {platform: wheeled}}}",
            "robots: a and b have the same live port, 8765",
        ),
        (
            "{common: {teleop: true}, robots: {a: {platform: drone}, b: {platform: wheeled}}}",
            "robots: a and b are driven by the same hand, gamepad",
        ),
    ],
)
def test_what_can_be_seen_in_the_file_is_refused_at_once(capsys, tmp_path, text, words):
    line = refused(capsys, tmp_path, text)
    assert line.startswith("adatracker-deploy: fleet.yaml: ")
    assert words in line


def test_a_robots_options_are_not_the_command_lines(capsys, tmp_path):
    text = "robots: {a: {platform: drone}}"
    assert "--steps goes into fleet.yaml" in refused(capsys, tmp_path, text, "--steps", "5")
    assert "not allowed with" in refused(capsys, tmp_path, text, "--sitl", "--dry-run")
    assert main(["--fleet", "no/such.yaml"]) == 2
    assert "no/such.yaml" in capsys.readouterr().err


@pytest.mark.slow
def test_what_a_robots_own_run_refuses_starts_none_of_the_others(capsys, tmp_path):
    """Three real runs: two are right, and wait; neither opens anything."""
    text = """
    on_failure: go-on
    common: {segmenter: truth}
    robots:
      left: {platform: wheeled}
      wrong: {platform: wheeled, policy: genius}
      hawk: {platform: drone}
    """
    line = refused(capsys, tmp_path, text, "--sitl")
    assert "fleet.yaml: robots: wrong: unknown policy 'genius'" in line
