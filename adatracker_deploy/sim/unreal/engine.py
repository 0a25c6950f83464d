"""A connection to a running game with its level made ready: people, the robot's body, a camera, mask colours.

A server takes one client at a time, so a process keeps one connection for all its episodes.
"""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim.unreal.settings import read_settings
from adatracker_deploy.sim.unreal.units import numbers, read_triple
from adatracker_deploy.sim.unreal.wire import connect

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.sim.unreal.address import Address
    from adatracker_deploy.sim.unreal.units import Triple
    from adatracker_deploy.sim.unreal.wire import Client

COLOURS = {
    MaskClass.BACKGROUND: (0, 0, 0),
    MaskClass.TARGET: (255, 0, 0),
    MaskClass.PERSON: (0, 255, 0),
    MaskClass.OBSTACLE: (0, 0, 255),
}
"""RGB of the classes in the engine's object masks."""
ROBOT = "adatracker_robot"
PERSON = "adatracker_person_{}"
"""Names of what is spawned; people are counted from 1."""
_LEVEL_S, _LOOK_S = 120.0, 0.2
"""Machine time, s: how long a level may take to open, and how often it is asked whether it has."""


class Engine:
    """A level behind a connection; one thread uses it at a time.

    Args:
        client: connected; this object's from now on.
        address: which level.
        clock: the clock that the game's time follows.

    Attributes:
        settings: of the level.
        camera: id of the camera to use.

    Raises:
        UsageError: there is no such setting file, or nobody in the level to follow.
        PlatformError: the game does not do what it is asked to.
    """

    def __init__(self, client: Client, address: Address, clock: Clock | None = None) -> None:
        self.address, self.clock = address, clock or MonotonicClock()
        self._client = client
        self.settings = read_settings(address.settings)
        self._open_level()
        self.do("vset /action/game/pause")
        self._objects = set(self.text("vget /objects").split())
        self._paint(self._objects)
        player = self.settings.player
        if player not in self._objects:
            if not self.settings.starts:
                raise UsageError(
                    f"scene {address.level!r}: has no {player!r} to follow; name the level's own file of "
                    "UnrealZoo's with ?settings=FILE"
                )
            self._spawn(player, MaskClass.TARGET)
        self.do(_colour(player, MaskClass.TARGET))
        self._spawn(ROBOT, MaskClass.PERSON)
        self.do(f"vset /object/{ROBOT}/hide")
        self.camera = self._spawn_camera() if address.camera is None else address.camera
        self._others: list[str] = []

    def people(self, others: int) -> list[str]:
        """Return the names of the target and so many others, shown; those who are not needed are hidden."""
        while len(self._others) < others:
            name = PERSON.format(len(self._others) + 1)
            self._spawn(name, MaskClass.PERSON)
            self._others.append(name)
        self.do(*(f"vset /object/{name}/show" for name in self._others[:others]))
        self.do(*(f"vset /object/{name}/hide" for name in self._others[others:]))
        return [self.settings.player, *self._others[:others]]

    def do(self, *commands: str) -> None:
        """Send commands.

        Raises:
            PlatformError: the connection is lost, or one was refused.
        """
        self.ask(*commands)

    def text(self, command: str) -> str:
        """Return the answer to a command.

        Raises:
            PlatformError: the connection is lost, or it was refused.
        """
        return self.ask(command)[0].decode(errors="replace")

    def triples(self, *commands: str, first: Sequence[str] = ()) -> list[Triple]:
        """Return answers of three numbers each, after the commands of `first`.

        Raises:
            PlatformError: the connection is lost, or an answer is something else.
        """
        answers = self.ask(*first, *commands)[len(first) :]
        return [triple(answer, command) for answer, command in zip(answers, commands, strict=True)]

    def ask(self, *commands: str) -> list[bytes]:
        """Send commands and return their answers.

        Raises:
            PlatformError: the connection is lost, or one was refused.
        """
        try:
            return self._client.ask(commands)
        except PlatformError:
            self.close()
            raise

    def close(self) -> None:
        """Close the connection; the next episode opens another."""
        self._client.close()
        if _engines.get(_key(self.address)) is self:
            del _engines[_key(self.address)]

    def at(self, address: Address) -> Engine:
        """Return this connection with another level made ready."""
        return Engine(self._client, address, self.clock)

    def _open_level(self) -> None:
        level = self.address.level
        if self.text("vget /level/name").strip() == level:
            return
        self.do(f"vset /action/game/level {level}")
        until_s = time.monotonic() + _LEVEL_S
        while self.text("vget /level/name").strip() != level:
            if time.monotonic() > until_s:
                raise PlatformError(f"UnrealCV at {self._client.name}: level {level!r} does not open")
            time.sleep(_LOOK_S)

    def _paint(self, names: Iterable[str]) -> None:
        """Colour what is in the level; the people's own colours come later."""
        background = re.compile(self.settings.background, re.IGNORECASE)
        commands = [
            _colour(name, MaskClass.BACKGROUND if background.search(name) else MaskClass.OBSTACLE)
            for name in sorted(names)
        ]
        self._client.ask(commands, lenient=True)

    def _spawn(self, name: str, kind: MaskClass) -> None:
        """Have a character of this name, beside the player where it is new."""
        if name not in self._objects:
            self.do(f"vset /objects/spawn {self.settings.class_name} {name}")
            if self.settings.player in self._objects:
                place = self.triples(f"vget /object/{self.settings.player}/location")[0]
                self.do(f"vset /object/{name}/location {numbers(_beside(place, len(self._objects)))}")
            self._objects.add(name)
        self.do(f"vbp {name} set_phy 0", _colour(name, kind))

    def _spawn_camera(self) -> int:
        self.do("vset /cameras/spawn")
        return len(self.text("vget /cameras").split()) - 1


def engine_at(address: Address) -> Engine:
    """Return this process's engine at an address, connected when first asked for.

    Raises:
        UsageError: no server there, no such setting file, or nobody to follow.
        PlatformError: the game does not do what it is asked to.
    """
    engine = _engines.get(_key(address))
    if engine is None:
        client = connect(address.host, address.port)
        try:
            engine = Engine(client, address)
        except (PlatformError, UsageError):
            client.close()  # it is the only one that the server takes
            raise
    elif engine.address != address:
        engine = engine.at(address)
    adopt(engine)
    return engine


def adopt(engine: Engine) -> None:
    """Use this engine from now on for its server."""
    _engines[_key(engine.address)] = engine


_engines: dict[tuple[str, int], Engine] = {}


def _key(address: Address) -> tuple[str, int]:
    return address.host, address.port


def _colour(name: str, kind: MaskClass) -> str:
    r, g, b = COLOURS[kind]
    return f"vset /object/{name}/color {r} {g} {b}"


def _beside(place: Triple, count: int) -> Triple:
    """Return a place 2 m from another in one of eight directions, cm."""
    x, y = ((200, 0), (0, 200), (-200, 0), (0, -200), (200, 200), (-200, 200), (-200, -200), (200, -200))[
        count % 8
    ]
    return place[0] + x, place[1] + y, place[2]


def triple(answer: bytes, command: str) -> Triple:
    """Return an answer's three numbers.

    Raises:
        PlatformError: it is something else.
    """
    try:
        return read_triple(answer.decode())
    except ValueError as error:
        raise PlatformError(
            f"UnrealCV answers {command!r} with {answer[:80]!r}: not three numbers"
        ) from error
