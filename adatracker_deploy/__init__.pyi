"""The public names; `__init__.py` loads each at its first use.

The imports say where each is; `__all__` says that it is public, to type checkers and to the API pages. ruff
refuses a name that is in one of the two alone.
"""

from .config.limits import Limits
from .config.profile import CameraSettings, Profile
from .config.schema import Range, parse
from .core.camera import Camera
from .core.clock import Clock, FakeClock, MonotonicClock
from .core.errors import PlatformError, UsageError
from .core.faults import (
    BATTERY_LOW,
    CAMERA_FREEZE,
    CAMERA_GONE,
    LINK_DROP,
    ROBOT_SILENT,
    TAKEOVER,
    Fault,
)
from .core.geometry import Pose, wrap_angle
from .core.messages import (
    ZERO,
    Action,
    Box,
    Frame,
    MaskClass,
    Observation,
    PlatformState,
    Twist,
)
from .core.stamps import fresh_or_none
from .platform import (
    Body,
    CameraMount,
    Check,
    Platform,
    Scenario,
    Sitl,
)
from .registry import (
    load_platform,
    load_profile,
    platform_names,
    profile_names,
)
from .runtime.pacer import Pacer

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
__version__: str
