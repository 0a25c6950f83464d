"""Plans of short trials with the fake robot."""

from __future__ import annotations

from adatracker_deploy.app.trial_plan import TrialPlan
from adatracker_deploy.perception.segmenters import TRUTH, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.platform import Scenario
from adatracker_deploy.policy.pid import PidPolicy
from adatracker_deploy.testing.fake import FakePlatform


def fake_plan(profile, log_dir, steps) -> TrialPlan:
    """Plan a rehearsal of the fake robot, which sees by the truth."""
    segmenter, segmenter_name = open_segmenter(TRUTH, "person", Choice.read("largest"), rate_hz=30.0)
    return TrialPlan(
        platform=FakePlatform,
        profile=profile,
        policy=PidPolicy(),
        scenario=Scenario(),
        camera="",
        segmenter=segmenter,
        segmenter_name=segmenter_name,
        sitl=True,
        dry_run=False,
        steps=steps,
        speed=1.0,
        log_dir=log_dir,
    )
