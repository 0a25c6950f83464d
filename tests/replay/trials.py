"""Trials that a real policy really answered, in logs as the writer writes them."""

from __future__ import annotations

import dataclasses
from dataclasses import asdict

import numpy as np
import yaml

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import ZERO, Box, Observation
from adatracker_deploy.core.record import Latency
from adatracker_deploy.policy.base import to_twist
from adatracker_deploy.trial.step_json import STEP_FORMAT
from adatracker_deploy.trial.trial_file import TrialFile
from tests.trial.records import START_NS, a_step

LIMITS = Limits(forward_m_s=1.5, backward_m_s=0.5, yaw_rate_rad_s=1.2, accel_m_s2=2.0, yaw_accel_rad_s2=4.0)
PERIOD_NS = 100_000_000
SEED = 3
GREY = np.full((24, 32, 3), 128, np.uint8)


def observations(count, seed=0, gone=()):
    """Random masks of 24 x 32 pixels, a new frame 20 ms before each tick; in those `gone` nobody is seen."""
    rng = np.random.default_rng(seed)
    seen = []
    for seq in range(count):
        mask = rng.integers(0, 4, (24, 32)).astype(np.uint8)
        box = None if seq in gone else Box(*rng.uniform(0.2, 0.5, 4).tolist())
        seen.append(
            Observation(mask, box, float(rng.uniform()), START_NS + seq * PERIOD_NS - 20_000_000, seq)
        )
    return seen


def logged(
    folder,
    policy,
    seen,
    *,
    stale=(),
    missing=(),
    unpictured=(),
    nudged=(),
    about=None,
    config=None,
    ends=True,
):
    """Let a policy answer each observation at a tick of its own and log it; return the file.

    Args:
        stale: ticks whose observation was too old: the policy is not asked.
        missing: ticks that the writer dropped.
        unpictured: ticks whose frame it dropped.
        ends: the tracker lived to say how.
        nudged: ticks whose last action is logged as the next larger float32.
    """
    policy.reset(SEED)
    said = {
        "profile": {"name": "test", "limits": asdict(LIMITS)},
        "policy_sha256": dict(policy.info.sha256),
        "seed": SEED,
        "speed": 1.0,
    }
    trial = {
        "step_format": str(STEP_FORMAT),
        "platform": "wheeled",
        "kind": "real",
        "policy": policy.info.name,
    }
    metadata = {
        "trial": trial | {"steps": str(len(seen) - 1)} | (about or {}),
        "config": {"yaml": yaml.safe_dump(said if config is None else config)},
    }
    file = folder / "trial.mcap"
    with file.open("wb") as stream:
        log = TrialFile(stream, metadata)
        shown = None
        for number, observation in enumerate(seen):
            record = a_tick(number, observation, policy, asked=number not in stale)
            if number in nudged:
                *most, last = record.action
                up = float(np.nextafter(np.float32(last), np.float32(2)))
                record = dataclasses.replace(record, action=(*most, up))
            if number in missing:
                continue
            if observation.seq != shown and number not in unpictured:
                log.picture(record.t_ns, observation.t_ns, observation.seq, GREY, observation.mask)
            shown = observation.seq
            log.step(record.t_ns, observation.t_ns, record)
        log.finish('{"outcome": "completed"}' if ends else None)
    return file


def a_tick(number, observation, policy, *, asked):
    """One tick as the loop writes it down."""
    t_ns = START_NS + number * PERIOD_NS
    age_ms = (t_ns - observation.t_ns) / 1e6
    action = policy.act(observation) if asked else None
    return a_step(
        number,
        t_ns=t_ns,
        frame_seq=observation.seq,
        box=observation.box if action else None,
        action=tuple(map(float, action.values)) if action else (),
        context=tuple(map(float, action.context)) if action and action.context is not None else (),
        command=to_twist(action.values, policy.info.action, LIMITS) if action else ZERO,
        latency=Latency(
            observation_age_ms=age_ms, infer_ms=1, sensor_to_command_ms=age_ms + 1, lateness_ms=0
        ),
    )


def moving(count, **changes):
    """Ticks of a robot that is asked for 1 m/s and does it, from its start on along x."""
    start = a_step(0)
    return [
        a_step(
            number,
            t_ns=START_NS + number * PERIOD_NS,
            command=dataclasses.replace(start.command, vx=1.0, yaw_rate=0.0),
            velocity=dataclasses.replace(start.velocity, vx=1.0),
            pose=dataclasses.replace(start.pose, x=number * 0.1, y=0.0, z=0.0, yaw=0.0, pitch=0.0, roll=0.0),
            box=Box(0.5, 0.5, 0.1, 0.3),
            **changes,
        )
        for number in range(count)
    ]
