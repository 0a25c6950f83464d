"""Trials at the networks' rate, as their logs: a target that walks to the right, a robot that turns to it."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import Box, MaskClass, Observation, Twist
from tests.trial.records import START_NS, a_frame, a_log, a_step

LIMITS = Limits(forward_m_s=1.5, backward_m_s=0.5, yaw_rate_rad_s=1.2, accel_m_s2=2.0, yaw_accel_rad_s2=4.0)
PERIOD_NS = 100_000_000


def left_of(number):
    """Where the target's left edge is, in fractions of the picture."""
    return 0.1 + 0.01 * (number % 40)


def a_tick(number, box, **changes):
    sent = Twist(vx=0.3, yaw_rate=0.8 - 3.2 * left_of(number))
    return a_step(number, box=box, **({"t_ns": START_NS + number * PERIOD_NS, "sent": sent} | changes))


def a_logged_trial(log_dir, ticks, *, outcome="completed", gone=()):
    """Log a trial whose target is out of sight in the ticks `gone`; return its file."""
    with a_log(log_dir, steps=ticks - 1, config={"profile": {"limits": asdict(LIMITS)}}) as log:
        for number in range(ticks):
            left = left_of(number)
            mask = np.zeros((60, 80), np.uint8)
            if number not in gone:
                mask[20:50, int(left * 80) : int((left + 0.15) * 80)] = MaskClass.TARGET
            box = None if number in gone else Box(left + 0.075, 0.58, 0.15, 0.5)
            tick = a_tick(number, box)
            log.step(tick, a_frame(number, 80, 60), Observation(mask, box, 0.9, tick.t_ns, number))
        log.close({"outcome": outcome})
    assert not log.trouble
    return log.folder / "trial.mcap"
