"""Faults that can be injected, by name; faults of one robot only are listed by its own `Sitl`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that can be injected."""

    name: str
    says: str
    """A description for people."""
    lasts_s: float = 0.0
    """Machine time, s, after which it ends by itself; 0 for a single event or a permanent fault."""


BLIND_FOR_S = 3.0
"""Longer than the loop waits for a frame; shorter gaps are bridged."""
CAMERA_FREEZE = Fault("camera_freeze", "the camera repeats one picture, time stamp and all", BLIND_FOR_S)
CAMERA_GONE = Fault("camera_gone", "the camera's server is gone, and comes back", BLIND_FOR_S)
LINK_DROP = Fault("link_drop", "the wire is cut, and reconnected", 2.0)
ROBOT_SILENT = Fault("robot_silent", "the robot receives commands but reports nothing", 2.0)
TAKEOVER = Fault("takeover", "a pilot or a remote control takes the robot over")
BATTERY_LOW = Fault("battery_low", "5 % of the charge is left")
"""Faults that a simulator may support; each `Sitl` lists its own."""

OURS = (
    CAMERA_FREEZE,  # where the simulator carries no camera
    Fault("segmenter_stall", "the segmenter does not return", BLIND_FOR_S),
    Fault("segmenter_error", "the segmenter raises an error"),
    Fault("policy_nan", "the policy's action is not a number"),
    Fault("policy_inf", "the policy's action is infinite"),
    Fault("policy_hang", "the policy does not return", 2.0),
    Fault("action_jump", "the policy's action jumps from end to end at every tick", 2.0),
    Fault("tracker_stop", "the tracker's process is stopped (SIGSTOP), and continued", 2.0),
    Fault("tracker_kill", "the tracker's process is killed (SIGKILL)"),
    Fault("link_stop", "the link's process is stopped (SIGSTOP), and continued", 2.0),
    Fault("link_kill", "the link's process is killed (SIGKILL)"),
    Fault("interrupt", "Ctrl-C (SIGINT)"),
    Fault("terminate", "SIGTERM"),
    Fault("hangup", "its terminal is gone (SIGHUP), as when an SSH session drops"),
    Fault("robot_frozen", "the robot's process is stopped (SIGSTOP), and continued", 2.0),
    Fault("suspend", "the machine sleeps: all its programs and its monotonic clock stand still", 2.0),
    Fault("cpu_hogs", "four processes take all the processor that they can get", 3.0),
    Fault("gc_pause", "the tracker's interpreter stands still for 0.1 s, as in a full collection"),
    Fault("disk_full", "the log's file cannot grow"),
)
"""Faults of the toolkit's own processes, for any robot."""


def known_faults(simulator: tuple[Fault, ...]) -> dict[str, Fault]:
    """Return the faults that a rehearsal can inject, by name; the simulator's version of a fault takes
    precedence.

    Args:
        simulator: the faults that the robot's simulator supports.
    """
    ours = {fault.name: fault for fault in OURS}
    theirs = {fault.name: fault for fault in simulator}
    return dict(sorted((ours | theirs).items()))
