"""Ticks of a made-up trial."""

from __future__ import annotations

import dataclasses

import numpy as np
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Box, Frame, MaskClass, Observation, Twist
from adatracker_deploy.core.record import Latency, ScoredStep, StepRecord
from adatracker_deploy.trial.log import TrialLog

START_NS = 5_000_000_000
"""The run's clock when the log began."""
TICK_NS = 50_000_000
REFERENCE = Box(0.5, 0.5, 0.2, 0.4)


def a_step(step: int, **changes) -> StepRecord:
    record = StepRecord(
        step=step,
        t_ns=START_NS + step * TICK_NS,
        frame_seq=step,
        box=REFERENCE,
        confidence=0.9,
        action=(0.5, -0.25),
        context=(0.1, 0.2),
        command=Twist(vx=1.0, yaw_rate=-0.5),
        sent=Twist(vx=0.8, yaw_rate=-0.5),
        gate=("acceleration",),
        mode="OFFBOARD",
        pose=Pose(1.0, 2.0, 3.0, 0.1, 0.2, 0.3),
        velocity=Twist(vx=0.7),
        battery=0.8,
        state_age_s=0.02,
        latency=Latency(observation_age_ms=12, infer_ms=2, sensor_to_command_ms=15, lateness_ms=0.1),
        missed_deadlines=0,
        distance_m=2.5,
        bearing_rad=0.0,
        target_visible=True,
    )
    return dataclasses.replace(record, **changes)


def any_steps(**fields) -> st.SearchStrategy[StepRecord]:
    """Generate any valid record, with its optional fields; `fields` replaces some fields' strategies."""
    return st.builds(StepRecord, **({field.name: ... for field in dataclasses.fields(StepRecord)} | fields))


def scored(record) -> ScoredStep:
    """Return the fields of a record that scoring needs."""
    return ScoredStep(**{field.name: getattr(record, field.name) for field in dataclasses.fields(ScoredStep)})


def a_frame(seq: int, width: int = 160, height: int = 120) -> Frame:
    """A grey picture, brighter from frame to frame."""
    return Frame(np.full((height, width, 3), seq % 256, np.uint8), START_NS + seq * TICK_NS, seq)


def an_observation(seq: int, width: int = 160, height: int = 120) -> Observation:
    """A target that fills the left half, another person in a corner."""
    mask = np.zeros((height, width), np.uint8)
    mask[:, : width // 2] = MaskClass.TARGET
    mask[:10, -10:] = MaskClass.PERSON
    return Observation(mask, REFERENCE, 0.9, START_NS + seq * TICK_NS, seq)


def a_log(log_dir, **changes) -> TrialLog:
    settings = {
        "platform": "drone",
        "kind": "sitl",
        "policy": "pid",
        "steps": 5,
        "config": {"seed": 1, "profile": {"name": "drone"}},
        "now_ns": START_NS,
    }
    return TrialLog.create(log_dir, **(settings | changes))


def a_trial(log_dir, steps, summary=None, **changes):
    """Log a whole trial; return its folder."""
    steps = list(steps)
    with a_log(log_dir, **({"steps": len(steps) - 1} | changes)) as log:
        for step in steps:
            log.step(step, a_frame(step.frame_seq), an_observation(step.frame_seq))
        log.close({"outcome": "completed"} if summary is None else summary)
    assert not log.trouble
    return log.folder
