"""Every trial warns at its start of the gate checks that its profile switches off, and logs them."""

from __future__ import annotations

from dataclasses import replace

import yaml

from adatracker_deploy.app.trial_run import run_trial
from adatracker_deploy.testing.fake import fake_profile
from adatracker_deploy.trial.reader import read_trial
from tests.trial.plans import fake_plan


class Told:
    def __init__(self):
        self.lines = []

    def phase(self, text):
        self.lines.append(text)

    def logging(self, folder): ...

    def step(self, record): ...


SWITCHED_OFF = ("geofence", "jerk")


def test_every_trial_tells_what_its_gate_goes_without(tmp_path):
    profile = fake_profile()
    limits = replace(profile.limits, switched_off=SWITCHED_OFF)
    told = Told()
    run_trial(fake_plan(replace(profile, limits=limits), tmp_path, steps=3), told, started_s=0.0)
    expected = [f"the gate runs without {name}: " for name in SWITCHED_OFF]
    shown = [line for line in told.lines if line.startswith("warning: the gate")]
    (folder,) = tmp_path.iterdir()
    config = yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))
    logged = [event.message for event in read_trial(folder).events if event.level == "warning"]
    for lines, start in ((shown, "warning: "), ([line for line in logged if "the gate" in line], "")):
        assert len(lines) == len(expected)
        assert all(line.startswith(start + words) for line, words in zip(lines, expected, strict=True))
    assert config["gate_switched_off"] == list(SWITCHED_OFF)
