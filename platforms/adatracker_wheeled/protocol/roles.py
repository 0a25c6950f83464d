"""The ``roles:`` section of a wheeled base's profile: the purpose of each DBC message.

Your own base needs its DBC and this section. Values are linked as *quantity: signal*, where the quantity's
name carries its unit and the signal is the DBC's. ``{signal: NAME, scale: S}`` says that the quantity is S
times the signal, for a mirrored motor (-1), a percentage (0.01) or a unit that is not in the table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError

_ANGLE_RAD = {"rad": 1.0, "turns": math.tau}
WHEEL_ANGLES = {
    f"{side}_{unit}{per}": (f"{side}_m{per}", radians)
    for side in ("left", "right")
    for unit, radians in _ANGLE_RAD.items()
    for per in ("", "_s")
}
"""From a wheel quantity given as an angle to the same at the wheel's rim, and the unit's radians."""
_KNOWN = {
    "command": ("vx_m_s", "vy_m_s", "yaw_rate_rad_s", "steering_rad", "left_m_s", "right_m_s"),
    "feedback": ("vx_m_s", "vy_m_s", "yaw_rate_rad_s", "steering_rad", "left_m_s", "right_m_s"),
    "odometry": ("left_m", "right_m"),
    "battery": ("charge", "volts"),
}
"""Quantities of each role: body velocity, steering angle, wheel speeds and ways; charge is 0 to 1."""
_MOTIONS = (("vx_m_s", "yaw_rate_rad_s"), ("vx_m_s", "steering_rad"), ("left_m_s", "right_m_s"))
_COMPLETE = {"command": _MOTIONS, "feedback": _MOTIONS, "odometry": (("left_m", "right_m"),)}


def at_rim(quantity: str) -> str:
    """Return a wheel quantity's name in metres of the rim; any other name as it is."""
    return WHEEL_ANGLES[quantity][0] if quantity in WHEEL_ANGLES else quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Scaled:
    """A signal whose value is not yet in the quantity's unit: quantity = scale times signal."""

    signal: str
    scale: Annotated[float, Range(-1e9, 1e9)] = 1.0


Bit = Annotated[int, Range(0, 63)]
Bits = Bit | tuple[Bit, ...]
Links = dict[str, str | Scaled]
"""From a quantity to the signal that carries it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Linked:
    """A message and the quantities that its signals carry."""

    message: str
    signals: Links
    constants: dict[str, float] = field(default_factory=dict)
    """Signals that always have the same value; a frame with another value has another meaning."""
    counter: str | None = None
    """The signal that counts frames, where the base wants one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixed:
    """A message that is sent with fixed values; signals that are not named are zero."""

    message: str
    values: dict[str, float]
    counter: str | None = None
    """The signal that counts frames, where the base wants one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """The messages in which the base reports its condition."""

    messages: tuple[str, ...]
    """One, or one an axis with the same signals: the base is what the worst of them says."""
    mode: str
    """The signal that tells who drives; its values are listed next, as raw numbers."""
    ours: tuple[int, ...]
    standby: tuple[int, ...] = ()
    """Also a value that means standby or remote control: such a base tells which by refusing to enable."""
    remote: tuple[int, ...] = ()
    condition: str | None = None
    """The signal that tells the base's health; a value in neither of the next lists is a fault."""
    ok: tuple[int, ...] = (0,)
    emergency_stop: tuple[int, ...] = ()
    errors: str | None = None
    """The signal whose bits are errors; every bit that is set and no warning is a fault."""
    faults: dict[str, Bits] = field(default_factory=dict)
    """Names of its bits, 0 the least significant; several where the manuals of one base disagree."""
    warnings: tuple[Bit, ...] | dict[str, Bits] = ()
    """Bits that stop nothing; the operator sees their names."""
    volts: str | None = None
    count: str | None = None

    def __post_init__(self) -> None:
        _once("mode", self.ours + self.standby + self.remote)
        _once("condition", self.ok + self.emergency_stop)
        _once("error bit", tuple(bit for bit, _ in (*named_bits(self.faults), *self.warned)))
        if not self.messages or not self.ours or not self.ok:
            raise UsageError("roles: state: messages, ours and ok each need at least one entry")
        for _, name in (*named_bits(self.faults), *self.warned):
            if "," in name or not name.isascii():
                raise UsageError(f"roles: state: fault name {name!r} must be ASCII without a comma")

    @property
    def warned(self) -> tuple[tuple[int, str], ...]:
        """Each bit that stops nothing, and its name; that is empty where the profile gives none."""
        if isinstance(self.warnings, dict):
            return named_bits(self.warnings)
        return tuple((bit, "") for bit in self.warnings)


def named_bits(names: dict[str, Bits]) -> tuple[tuple[int, str], ...]:
    """Return each bit and its name."""
    listed = {name: (bits,) if isinstance(bits, int) else bits for name, bits in names.items()}
    return tuple((bit, name) for name, bits in listed.items() for bit in bits)


def _once(what: str, values: tuple[int, ...]) -> None:
    for value in values:
        if values.count(value) > 1:
            raise UsageError(f"roles: state: {what} {value} is given two meanings; list it once")


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Periods and time-outs, s."""

    command_period_s: Annotated[float, Range(0.005, 0.2)] = 0.02
    base_timeout_s: Annotated[float, Range(0.02, 2)] = 0.5
    """Without a command for this long the base stops by itself."""
    state_period_s: Annotated[float, Range(0.005, 2)] = 0.1
    state_timeout_s: Annotated[float, Range(0.05, 5)] = 0.5
    """Without its state for this long the base is driven no further."""
    feedback_period_s: Annotated[float, Range(0.002, 1)] = 0.02
    feedback_timeout_s: Annotated[float, Range(0.02, 5)] = 0.2
    """Without its measured motion for this long the base is driven no further."""
    battery_period_s: Annotated[float, Range(0.02, 60)] = 1.0

    def __post_init__(self) -> None:
        for shorter, longer in (
            ("command_period_s", "base_timeout_s"),
            ("state_period_s", "state_timeout_s"),
            ("feedback_period_s", "feedback_timeout_s"),
        ):
            if getattr(self, shorter) >= getattr(self, longer):
                raise UsageError(f"roles: timing: {shorter} must be shorter than {longer}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheels:
    """The driven wheels; the track also turns wheel odometry into a heading."""

    track_m: Annotated[float, Range(0.05, 5)]
    """Between left and right; the effective one for a base that skids when it turns."""
    radius_m: Annotated[float, Range(0.01, 1)] | None = None
    """Needed when the wire speaks of wheel angles."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Steering:
    """A base that steers like a car."""

    wheelbase_m: Annotated[float, Range(0.05, 5)]
    max_angle_rad: Annotated[float, Range(0.05, 1.5)]
    """Largest angle of the steered wheels, as the wire speaks of it."""
    inner_track_m: Annotated[float, Range(0, 5)] = 0.0
    """Between the front wheels, where the wire speaks of the inner one's angle; 0 for the bicycle model's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Roles:
    """The whole of ``roles:``."""

    dbc: str
    """A shipped file's name, or a path; a relative path is relative to the working directory."""
    checksum: Literal["none", "agilex_v1"] = "none"
    """The frames' checksum: ``agilex_v1`` sums them up into their last byte."""
    wheels: Wheels | None = None
    steering: Steering | None = None
    command: tuple[Linked, ...]
    enable: tuple[Fixed, ...] = ()
    disable: tuple[Fixed, ...] = ()
    release_brake: tuple[Fixed, ...] = ()
    state: State
    feedback: tuple[Linked, ...]
    odometry: tuple[Linked, ...] = ()
    battery: tuple[Linked, ...] = ()
    timing: Timing = field(default_factory=Timing)

    def __post_init__(self) -> None:
        for role in _KNOWN:
            self._check(role, getattr(self, role))

    def _check(self, role: str, parts: tuple[Linked, ...]) -> None:
        """Check that a role's quantities are known, amount to a motion and have their geometry given."""
        given = [quantity for part in parts for quantity in part.signals]
        names = [at_rim(quantity) for quantity in given]
        for name, quantity in zip(names, given, strict=True):
            if name not in _KNOWN[role]:
                known = [
                    *_KNOWN[role],
                    *(angle for angle, (rim, _) in WHEEL_ANGLES.items() if rim in _KNOWN[role]),
                ]
                raise UsageError(
                    f"roles: {role}: unknown quantity {quantity!r}; known are {', '.join(known)}"
                )
        ways = _COMPLETE.get(role, ()) if parts or role in ("command", "feedback") else ()
        if len(set(names)) < len(names) or (ways and sum(set(way) <= set(names) for way in ways) != 1):
            wanted = " or ".join(" and ".join(way) for way in ways) or "each quantity"
            raise UsageError(
                f"roles: {role}: must carry {wanted}, once; it carries {', '.join(given) or 'nothing'}"
            )
        if "left_m_s" in names and self.wheels is None:
            raise UsageError(f"roles: {role}: wheel speeds need wheels: {{track_m: ...}}")
        if names != given and (self.wheels is None or self.wheels.radius_m is None):
            raise UsageError(f"roles: {role}: wheel angles need wheels: {{track_m: ..., radius_m: ...}}")
        if "steering_rad" in names and self.steering is None:
            raise UsageError(f"roles: {role}: needs steering: {{wheelbase_m: ..., max_angle_rad: ...}}")

    @property
    def drive(self) -> Literal["twist", "differential", "ackermann"]:
        """Kind of the base's command: a velocity, a speed for each side, or a speed and a steering angle."""
        names = {at_rim(quantity) for part in self.command for quantity in part.signals}
        if "left_m_s" in names:
            return "differential"
        return "ackermann" if "steering_rad" in names else "twist"
