"""Encodes and decodes CAN frames by a DBC and the profile's roles; no I/O.

The adapter uses `command`, `enable` ... and `parse`; the simulator uses `parse_command` and
``*_frames``, from the same description, so neither can disagree with the other about a byte.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import product

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.protocol.dbc import Database, Layout, Raw
from adatracker_wheeled.protocol.dispatch import Dispatch, Gather, Reader, Told
from adatracker_wheeled.protocol.frames import BaseStatus, CanFrame, Demand, Malformed, Reading
from adatracker_wheeled.protocol.kinematics import CREEP_M_S, Drive
from adatracker_wheeled.protocol.message_codec import Link, Part, Quantities
from adatracker_wheeled.protocol.roles import Fixed, Linked, Roles
from adatracker_wheeled.protocol.status import StatusCodec, worst

FASTEST = 100.0
"""Nothing above this, in m/s or rad/s, is a command for a base."""

_REQUESTS = ("enable", "disable", "release_brake")


class Codec:
    """One base's language.

    Where a motion or a state is spread over several messages (one a wheel), `parse` and `parse_command` tell
    it when each of them has come, and then begin again: use one codec a receiver, from one thread.
    """

    def __init__(self, roles: Roles) -> None:
        """Read the DBC and look up everything that the roles name.

        Raises:
            UsageError: one line that names the role, the file, the message and the signal.
        """
        with _role("dbc"):
            self._database = Database(roles.dbc, roles.checksum)
        self._roles = roles
        self._drive = Drive(roles.wheels, roles.steering)
        self._command = self._parts("command", roles.command)
        self._feedback = self._parts("feedback", roles.feedback)
        self._odometry = self._parts("odometry", roles.odometry)
        self._battery = self._parts("battery", roles.battery)
        self._requests = {name: self._parts(name, getattr(roles, name)) for name in _REQUESTS}
        with _role("state"):
            self._states = [
                StatusCodec(roles.state, self._database.layout(name)) for name in roles.state.messages
            ]
        self._from_base = self._listen_to_base()
        self._to_base = self._listen_to_commands()
        with _role("command"):
            for part, link in self._command_links():
                if link.signal.exact(0.0) is None:
                    raise UsageError(
                        f"{part.layout.dbc}: {part.layout.name}.{link.signal.name} cannot carry zero"
                    )

    def _parts(self, role: str, described: tuple[Linked, ...] | tuple[Fixed, ...]) -> tuple[Part, ...]:
        with _role(role):
            return tuple(
                Part.of(each, self._database.layout(each.message), self._roles.wheels) for each in described
            )

    def _command_links(self) -> list[tuple[Part, Link]]:
        return [(part, link) for part in self._command for link in part.links]

    def command(self, twist: Twist, count: int = 0) -> tuple[Twist, tuple[CanFrame, ...]]:
        """Return the velocity that the frames really say (clipped, rounded, steered), and the frames.

        Args:
            twist: body frame, m/s and rad/s; a component that the base cannot follow is left out.
            count: how many commands came before, for bases that want frames counted.

        Raises:
            PlatformError: a component is NaN, infinite or beyond `FASTEST`; nothing is encoded.
        """
        if not all(abs(value) <= FASTEST for value in (twist.vx, twist.vy, twist.vz, twist.yaw_rate)):
            raise PlatformError(f"refused to send {twist}: not a velocity that a base can drive")
        values = self._drive.quantities(twist)
        said: Quantities = {}
        frames = []
        for part in self._command:
            raws = part.write(values, count)
            frames.append(part.layout.encode(raws))
            said |= part.read(raws)
        return self._drive.twist(said), tuple(frames)

    def enable(self, count: int = 0) -> tuple[CanFrame, ...]:
        """Return the frames that ask the base to obey; empty where it needs none."""
        return self._request("enable", count)

    def disable(self, count: int = 0) -> tuple[CanFrame, ...]:
        """Return the frames that ask the base to obey no longer."""
        return self._request("disable", count)

    def release_brake(self, count: int = 0) -> tuple[CanFrame, ...]:
        """Return the frames that release the parking brake."""
        return self._request("release_brake", count)

    def _request(self, name: str, count: int) -> tuple[CanFrame, ...]:
        return tuple(part.layout.encode(part.write({}, count)) for part in self._requests[name])

    def check_limits(self, limits: Limits) -> None:
        """Check that every velocity within the profile's limits can be said.

        Raises:
            UsageError: a signal is too narrow; the line names it and what it reaches.
        """
        speeds = (limits.forward_m_s, -limits.backward_m_s, CREEP_M_S, -CREEP_M_S)
        turns = (limits.yaw_rate_rad_s, -limits.yaw_rate_rad_s)
        for vx, yaw_rate in product(speeds, turns):
            values = self._drive.quantities(Twist(vx=vx, yaw_rate=yaw_rate))
            for part, link in self._command_links():
                (low, high), value = link.span, values[link.quantity]
                if not low - 1e-9 <= value <= high + 1e-9:
                    raise UsageError(
                        f"roles: command: {part.layout.dbc}: {part.layout.name}.{link.signal.name} carries "
                        f"{link.quantity} from {low:.4g} to {high:.4g}, but the profile's limits reach "
                        f"{value:.4g}: lower them"
                    )

    def parse(self, frame: CanFrame) -> Reading | None:
        """Return what a received frame tells, or None when no role names it.

        Raises:
            Malformed: a frame that a role names is short, oversized, wrong in its checksum or out of range.
        """
        told = self._from_base.read(frame)
        return None if told is None else Reading(**told)

    @property
    def wheel_wrap_m(self) -> float | None:
        """Distance, m, after which the wheels' counters start over; None if they do not, or for none."""
        wraps = [link.wrap for part in self._odometry for link in part.links if link.wrap is not None]
        return min(wraps, default=None)

    def _listen_to_base(self) -> Dispatch:
        dispatch = Dispatch()
        dispatch.add_parts(self._feedback, lambda said: {"motion": self._drive.twist(said)})
        dispatch.add_parts(self._odometry, lambda said: {"wheels_m": (said["left_m"], said["right_m"])})
        dispatch.add_parts(self._battery, _battery)
        gather: Gather[BaseStatus] = Gather(len(self._states))
        for index, state in enumerate(self._states):
            dispatch.add(state.layout, _state_reader(gather, index, state))
        return dispatch

    def parse_command(self, frame: CanFrame) -> Demand | None:
        """Return what a frame asks of the base, or None when no role of that direction names it.

        Raises:
            Malformed: as in `parse`, but an oversized frame is taken by its first bytes.
        """
        told = self._to_base.read(frame)
        return None if told is None else Demand(**told)

    def is_command(self, frame: CanFrame) -> bool:
        """Return whether a frame has an id with which hosts command the base, whatever its bytes."""
        return self._to_base.knows(frame) and not self._from_base.knows(frame)

    def _listen_to_commands(self) -> Dispatch:
        dispatch = Dispatch(padded=True)  # AgileX's public SDK fills requests of one byte up to eight
        dispatch.add_parts(self._command, lambda said: {"twist": self._drive.twist(said)})
        for name, parts in self._requests.items():
            dispatch.add_parts(parts, partial(_ask, name))
        return dispatch

    def status_frames(self, reading: Reading, count: int = 0) -> tuple[CanFrame, ...]:
        """Return the messages of the state role, in which the base says its condition.

        Args:
            reading: all that the base has to say, as one message can serve several roles; None is sent as 0.
            count: how many such messages came before, for bases that count them.

        Raises:
            UsageError: the profile names no way to say it.
        """
        with _role("state"):
            return self._frames([state.layout for state in self._states], reading, count)

    def feedback_frames(self, reading: Reading, count: int = 0) -> tuple[CanFrame, ...]:
        """Return the messages of the feedback and odometry roles: measured velocity, and wheels that wrap."""
        return self._frames([part.layout for part in (*self._feedback, *self._odometry)], reading, count)

    def battery_frames(self, reading: Reading, count: int = 0) -> tuple[CanFrame, ...]:
        """Return the messages of the battery role."""
        return self._frames([part.layout for part in self._battery], reading, count)

    def _frames(self, layouts: list[Layout], reading: Reading, count: int) -> tuple[CanFrame, ...]:
        values = self._quantities(reading)
        frames = []
        for layout in dict.fromkeys(layouts):
            raws: dict[str, Raw] = {}
            for part in (*self._feedback, *self._odometry, *self._battery):
                if part.layout is layout:
                    raws |= part.write(values, count)
            for state in self._states:
                if state.layout is layout and reading.status is not None:
                    raws |= state.write(reading.status, count)
            frames.append(layout.encode(raws))
        return tuple(frames)

    def _quantities(self, reading: Reading) -> Quantities:
        values = {"charge": reading.battery or 0.0, "volts": reading.volts or 0.0}
        if reading.motion is not None:
            values |= self._drive.quantities(reading.motion)
        if reading.wheels_m is not None:
            values |= dict(zip(("left_m", "right_m"), reading.wheels_m, strict=True))
            for part in self._odometry:
                values |= {link.quantity: link.wrapped(values[link.quantity]) for link in part.links}
        return values


@contextmanager
def _role(name: str) -> Iterator[None]:
    """Say in which role a mistake was found."""
    try:
        yield
    except UsageError as error:
        raise UsageError(f"roles: {name}: {error}") from error


def _state_reader(gather: Gather[BaseStatus], index: int, state: StatusCodec) -> Reader:
    def read(raws: dict[str, Raw]) -> Told:
        complete = gather.add(index, state.read(raws))
        return {"status": worst(complete)} if complete else {}

    return read


def _ask(name: str, _said: Quantities) -> Told:
    return {name: True}


def _battery(said: Quantities) -> Told:
    charge = said.get("charge")
    if charge is not None and not 0 <= charge <= 1:
        raise Malformed(f"a state of charge of {charge:g} is out of its range")
    return {"battery": charge, "volts": said.get("volts")}
