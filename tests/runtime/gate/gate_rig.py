"""A gate that is asked step by step, with a robot that is well unless a test says otherwise."""

from __future__ import annotations

from dataclasses import replace

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.runtime.gate import GateState, Setpoint, Verdict, judge

LIMITS = Limits(
    forward_m_s=1.5,
    backward_m_s=0.5,
    lateral_m_s=0.3,
    vertical_m_s=0.8,
    yaw_rate_rad_s=1.2,
    accel_m_s2=2.0,
    yaw_accel_rad_s2=4.0,
    jerk_m_s3=20.0,
    yaw_jerk_rad_s3=50.0,
    ramp_s=0.5,
    command_timeout_s=0.2,
    hold_after_s=0.5,
    disengage_after_s=1.5,
    state_timeout_s=1.0,
    fence_radius_m=10.0,
    altitude_m=(1.0, 6.0),
    largest_target=0.3,
    battery_warn=0.3,
    battery_stop=0.2,
)
START_NS = 10_000_000_000
WELL = PlatformState(
    t_ns=START_NS,
    mode="DRIVE",
    engaged=True,
    landed=False,
    pose=Pose(z=2.0),
    velocity=ZERO,
    battery=0.9,
)
STEP_S = 0.02


class Gate:
    """One engagement's gate; every change of `limits` is by keyword.

    Where a test is about a place and not about the way there, `jumps` lets the robot be there at once.
    """

    def __init__(self, *, jumps: bool = False, **limits) -> None:
        self.limits = replace(LIMITS, **limits)
        if jumps:
            off = (*self.limits.switched_off, "position_jumped")
            self.limits = replace(self.limits, switched_off=off)
        self.now_ns = START_NS
        self.state = GateState(armed_ns=START_NS)

    def ask(
        self,
        twist: Twist | None,
        dt_s: float = STEP_S,
        age_s: float = 0.0,
        *,
        share: float | None = None,
        others: float | None = None,
        seen_s: float | None = None,
        **robot,
    ) -> Verdict:
        """Let `dt_s` pass, then ask for `twist` (None: nothing was ever asked), `age_s` old by then, on the
        ground of a picture `seen_s` old."""
        self.now_ns += round(dt_s * 1e9)
        setpoint = None
        if twist:
            t_ns = self.now_ns - round(age_s * 1e9)
            seen_ns = None if seen_s is None else self.now_ns - round(seen_s * 1e9)
            setpoint = Setpoint(twist, t_ns, share, seen_ns, others_share=others)
        state = replace(WELL, **{"t_ns": self.now_ns} | robot)
        self.state, verdict = judge(self.limits, self.state, setpoint, state, self.now_ns)
        return verdict

    def cruise(self, twist: Twist, seconds: float = 3.0, **robot) -> Verdict:
        """Ask for the same for a while."""
        for _ in range(round(seconds / STEP_S)):
            verdict = self.ask(twist, **robot)
        return verdict
