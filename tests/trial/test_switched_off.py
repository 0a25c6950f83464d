"""Every trial warns at its start of the gate checks that its profile switches off, and logs them."""

from __future__ import annotations

from dataclasses import replace

import yaml

from adatracker_deploy.app.trial_plan import TrialPlan
from adatracker_deploy.app.trial_run import run_trial
from adatracker_deploy.perception.segmenters import TRUTH, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.platform import Scenario
from adatracker_deploy.policy.pid import PidPolicy
from adatracker_deploy.testing.fake import FakePlatform, fake_profile
from adatracker_deploy.trial.reader import read_trial


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
    segmenter, segmenter_name = open_segmenter(TRUTH, "person", Choice.read("largest"), rate_hz=30.0)
    plan = TrialPlan(
        platform=FakePlatform,
        profile=replace(profile, limits=replace(profile.limits, switched_off=SWITCHED_OFF)),
        policy=PidPolicy(),
        scenario=Scenario(),
        camera="",
        segmenter=segmenter,
        segmenter_name=segmenter_name,
        sitl=True,
        dry_run=False,
        steps=3,
        speed=1.0,
        log_dir=tmp_path,
    )
    told = Told()
    run_trial(plan, told, started_s=0.0)
    expected = [f"the gate runs without {name}: " for name in SWITCHED_OFF]
    shown = [line for line in told.lines if line.startswith("warning: the gate")]
    (folder,) = tmp_path.iterdir()
    config = yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))
    logged = [event.message for event in read_trial(folder).events if event.level == "warning"]
    for lines, start in ((shown, "warning: "), ([line for line in logged if "the gate" in line], "")):
        assert len(lines) == len(expected)
        assert all(line.startswith(start + words) for line, words in zip(lines, expected, strict=True))
    assert config["gate_switched_off"] == list(SWITCHED_OFF)
