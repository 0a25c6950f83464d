"""A gamepad by evdev, the Linux kernel's input devices.

Buttons and sticks are those of the Linux Gamepad Specification (the kernel's
Documentation/input/gamepad.rst), which drivers follow, so that any gamepad has them in the same place.
``evdev`` is imported only here.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, NamedTuple

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.teleop.device import Told, reading

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from adatracker_deploy.runtime.teleop.takeover import Code

DEAD_ZONE = 0.1
"""Share of a stick's travel around its centre that counts as centred. Sticks at rest are off by a few
percent, and a device's own `flat` is often 0."""
_SYN, _KEY, _ABS = 0, 1, 3  # types of events, and below their codes: linux/input-event-codes.h
_SYN_REPORT, _SYN_DROPPED = 0, 3
BTN_GAMEPAD, BTN_EAST, BTN_TL, BTN_START = 0x130, 0x131, 0x136, 0x13B
ABS_X, ABS_Y, ABS_RX, ABS_RY = 0, 1, 3, 4
BUTTONS: dict[int, Code] = {BTN_TL: "dead_man", BTN_START: "give_back", BTN_EAST: "stop"}
STICKS: dict[int, Code] = {ABS_Y: "forward", ABS_X: "lateral", ABS_RX: "yaw", ABS_RY: "vertical"}
"""Each is positive to the right or down, and so is none of ours: all change their sign."""


class Travel(NamedTuple):
    """A stick's range, by the device."""

    least: int
    most: int
    flat: int = 0


def stick_share(value: int, travel: Travel) -> float:
    """Return a stick's deflection in [-1, 1]: 0 inside the dead zone, and continuous at its edge."""
    half = (travel.most - travel.least) / 2
    if half <= 0:
        return 0.0
    share = min(max((value - travel.least) / half - 1.0, -1.0), 1.0)
    dead = min(max(DEAD_ZONE, travel.flat / half), 0.9)
    beyond = max(0.0, abs(share) - dead) / (1.0 - dead)
    return beyond if share > 0 else -beyond


class Decoder:
    """Turns a gamepad's input events into a hand's.

    Args:
        travels: of the sticks that it has, by code.
        positions: returns where the sticks are, by code; asked after events were lost.
    """

    def __init__(self, travels: Mapping[int, Travel], positions: Callable[[], Mapping[int, int]]) -> None:
        self._travels = travels
        self._positions = positions
        self._dropped = False

    def decode(self, events: Iterable[Any]) -> Told:
        """Return what events with `type`, `code` and `value` say.

        After SYN_DROPPED (the kernel's buffer ran over) the button counts as released, because its release
        may have been lost; the sticks are asked.
        """
        told: Told = []
        for event in events:
            if event.type == _SYN and event.code == _SYN_DROPPED:
                self._dropped = True
                told.append(("dead_man", 0.0))
            elif event.type == _SYN and event.code == _SYN_REPORT and self._dropped:
                self._dropped = False
                told += self.sticks()
            elif self._dropped:
                continue  # up to the next report what comes is incomplete
            elif event.type == _KEY and event.code in BUTTONS:
                code = BUTTONS[event.code]
                if event.value in (0, 1) and (event.value or code == "dead_man"):
                    told.append((code, float(event.value)))
            elif event.type == _ABS and event.code in self._travels:
                told.append(self._stick(event.code, event.value))
        return told

    def sticks(self) -> Told:
        """Return where the sticks are."""
        return [self._stick(code, value) for code, value in self._positions().items()]

    def _stick(self, code: int, value: int) -> tuple[Code, float]:
        return STICKS[code], 0.0 - stick_share(value, self._travels[code])  # 0.0 -: no negative zero


def find_gamepad() -> str:
    """Return the path of the only gamepad.

    Raises:
        UsageError: there is none that can be read, or there are several.
    """
    import evdev

    found: dict[str, str] = {}
    for path in evdev.list_devices(writable=False):
        with (
            contextlib.suppress(OSError),
            contextlib.closing(evdev.InputDevice(path, readonly=True)) as device,
        ):
            if not lacking(device):
                found[path] = device.name
    if not found:
        raise UsageError(
            "--teleop gamepad: no gamepad can be read: connect one, and be in the group that may read "
            "/dev/input (often 'input')"
        )
    if len(found) > 1:
        names = ", ".join(f"{path} ({name})" for path, name in sorted(found.items()))
        raise UsageError(f"--teleop gamepad: there are several: {names}; say which with --teleop PATH")
    return next(iter(found))


def lacking(device: Any) -> list[str]:
    """Return what a device lacks to drive a robot; empty for a gamepad of the specification."""
    has = device.capabilities(absinfo=False)
    buttons = {"BTN_GAMEPAD": BTN_GAMEPAD, "BTN_TL": BTN_TL, "BTN_START": BTN_START}
    sticks = {"ABS_Y": ABS_Y, "ABS_RX": ABS_RX}
    return [
        *(name for name, code in buttons.items() if code not in has.get(_KEY, ())),
        *(name for name, code in sticks.items() if code not in has.get(_ABS, ())),
    ]


@contextlib.contextmanager
def gamepad(path: str, put: Callable[..., None]) -> Iterator[None]:
    """Read a gamepad until the context ends.

    Args:
        path: of its device, ``/dev/input/eventN``.
        put: takes the events (`Hand.put`).

    Raises:
        UsageError: it cannot be read, or is no gamepad.
    """
    import evdev

    try:
        device = evdev.InputDevice(path, readonly=True)
    except OSError as error:
        raise UsageError(f"--teleop {path}: cannot be read ({error.strerror})") from error
    with contextlib.closing(device):
        if lacks := lacking(device):
            raise UsageError(f"--teleop {path}: {device.name} is no gamepad: it lacks {', '.join(lacks)}")
        infos = dict(device.capabilities()[_ABS])
        travels = {
            code: Travel(infos[code].min, infos[code].max, infos[code].flat)
            for code in STICKS
            if code in infos
        }
        decoder = Decoder(travels, lambda: {code: device.absinfo(code).value for code in travels})
        put(*decoder.sticks())
        with reading(device.fd, lambda: decoder.decode(device.read()), put):
            yield
