"""adatracker-deploy: take a visual person-following policy to real robots safely.

The names below are the public interface, with `adatracker_deploy.sim` (a robot's simulator) and
`adatracker_deploy.testing` (the conformance suite): a robot from outside needs nothing else, and the other
modules may move between minor versions. No robot's library is imported here: each robot is a package of its
own, found by the entry-point group ``adatracker_deploy.platforms``. `docs/architecture.md` shows the rooms.
"""

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.profile import CameraSettings, Profile
from adatracker_deploy.config.schema import Range, parse
from adatracker_deploy.core.camera import Camera
from adatracker_deploy.core.clock import Clock, FakeClock, MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.faults import (
    BATTERY_LOW,
    CAMERA_FREEZE,
    CAMERA_GONE,
    LINK_DROP,
    ROBOT_SILENT,
    TAKEOVER,
    Fault,
)
from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import (
    ZERO,
    Action,
    Box,
    Frame,
    MaskClass,
    Observation,
    PlatformState,
    Twist,
)
from adatracker_deploy.core.stamps import fresh_or_none
from adatracker_deploy.platform import Body, CameraMount, Check, Platform, Scenario, Sitl
from adatracker_deploy.registry import load_platform, load_profile, platform_names, profile_names
from adatracker_deploy.runtime.pacer import Pacer

__all__ = [
    "BATTERY_LOW",
    "CAMERA_FREEZE",
    "CAMERA_GONE",
    "LINK_DROP",
    "ROBOT_SILENT",
    "TAKEOVER",
    "ZERO",
    "Action",
    "Body",
    "Box",
    "Camera",
    "CameraMount",
    "CameraSettings",
    "Check",
    "Clock",
    "FakeClock",
    "Fault",
    "Frame",
    "Limits",
    "MaskClass",
    "MonotonicClock",
    "Observation",
    "Pacer",
    "Platform",
    "PlatformError",
    "PlatformState",
    "Pose",
    "Profile",
    "Range",
    "Scenario",
    "Sitl",
    "Twist",
    "UsageError",
    "fresh_or_none",
    "load_platform",
    "load_profile",
    "parse",
    "platform_names",
    "profile_names",
    "wrap_angle",
]

__version__ = "0.1.0"
