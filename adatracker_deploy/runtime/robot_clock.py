"""Judges whether a robot's clock agrees with this machine's, where commands carry their time. Pure.

Such a robot tells by its own clock when a command is too old: diff_drive_controller brakes `cmd_vel_timeout`
after the newest command's stamp. A stamp ahead of the robot's clock puts its own time-out off by as much.
"""

from __future__ import annotations

from adatracker_deploy.platform import Check

FURTHEST_S = 0.25
"""Clocks that are further apart do not serve to judge a command's age; NTP keeps them within milliseconds."""


def clock_ahead_s(stamp_ns: int, received_ns: int) -> float | None:
    """Return by how much this machine's clock is ahead of a robot's, s; None where it gives no stamp (0).

    The message's way counts as ahead, too.

    Args:
        stamp_ns: of a message of the robot's, ns since 1970 by its clock.
        received_ns: when it was received, ns since 1970 by this machine's.
    """
    return (received_ns - stamp_ns) / 1e9 if stamp_ns else None


def clocks_check(ahead_s: float | None) -> Check:
    """Judge the difference that `clock_ahead_s` returns."""
    if ahead_s is None:
        told = "the odometry has no stamps: whether both clocks agree is unknown, so see the robot stop once"
        return Check("clocks", ok=False, message=told, blocking=False)
    if abs(ahead_s) <= FURTHEST_S:
        return Check("clocks", ok=True, message=f"{ahead_s:+.3f} s apart")
    if ahead_s > 0:
        told = f"this computer is {ahead_s:.4g} s ahead of the robot, whose own time-out is as much later"
    else:
        told = f"this computer is {-ahead_s:.4g} s behind the robot, which takes commands for as much older"
    return Check("clocks", ok=False, message=f"{told}: set both by NTP (chrony), or command a plain twist")
