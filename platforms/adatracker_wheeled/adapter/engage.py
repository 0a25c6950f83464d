"""Enable sequence: zeros first, then the request for command mode, then the base's confirmation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO
from adatracker_wheeled.adapter.preflight import NOT_OURS
from adatracker_wheeled.adapter.receiver import unfit
from adatracker_wheeled.adapter.transmitter import ZEROS

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock
    from adatracker_wheeled.adapter.authority import ControlAuthority
    from adatracker_wheeled.adapter.receiver import BaseTelemetry
    from adatracker_wheeled.adapter.transport import Wire
    from adatracker_wheeled.protocol.connection import Connection

_TICK_NS = 20_000_000
_LISTEN_S = 0.1
"""Somebody else's commands come 10 times a second at least, and are heard before this side's first."""


def enable(wire: Wire, authority: ControlAuthority, connection: Connection, clock: Clock) -> None:
    """Bring a base that is fit into command mode, at zero speed; its errors are not cleared.

    Raises:
        PlatformError: the base is unfit, somebody else's, or does not obey; or consent went meanwhile.
    """

    def still() -> None:
        with authority.lock:
            _refuse_unfit(wire, authority)
            authority.require_consent()
            wire.command(ZERO, clock.now_ns())

    begun_ns = clock.now_ns()
    enough_ns = begun_ns + round(_LISTEN_S * clock.speed * 1e9)
    wire.begin()
    wire.wait(
        lambda heard: heard.status_t_ns > begun_ns and clock.now_ns() > enough_ns,
        connection.roles.timing.state_timeout_s,
        authority.require_consent,
    )
    _refuse_unfit(wire, authority)
    if _enabled(wire.heard) and not authority.in_charge:
        _take_back(wire, authority, connection, clock)
    authority.take_charge()
    for _ in range(ZEROS):
        still()
        clock.sleep_until(clock.now_ns() + _TICK_NS)
    asked_ns = clock.now_ns()
    with authority.lock:
        authority.require_consent()
        wire.say((*wire.codec.enable(), *wire.codec.release_brake()))

    def obeys(heard: BaseTelemetry) -> bool:
        return heard.status_t_ns > asked_ns and wire.trouble(clock.now_ns()) is None

    if not wire.wait(obeys, connection.engage_timeout_s, still):
        found = wire.trouble(clock.now_ns())
        why = found.reason if found else "it sent no new state"
        raise PlatformError(f"the base did not obey within {connection.engage_timeout_s:g} s: {why}")
    authority.engage()


def _enabled(heard: BaseTelemetry) -> bool:
    return heard.status is not None and heard.status.mode == "ours"


def _take_back(wire: Wire, authority: ControlAuthority, connection: Connection, clock: Clock) -> None:
    """Put a base into standby that a killed run of this user's has left enabled, and nobody commands."""
    if wire.mark.left_by() is None:
        raise PlatformError(NOT_OURS)
    wire.listen(authority.require_consent)
    _refuse_unfit(wire, authority)
    authority.take_charge()
    asked_ns = clock.now_ns()
    with authority.lock:
        authority.require_consent()
        wire.say(wire.codec.disable())

    def stands_by(heard: BaseTelemetry) -> bool:
        return heard.status_t_ns > asked_ns and not _enabled(heard)

    if wire.codec.disable() and not wire.wait(
        stands_by, connection.engage_timeout_s, authority.require_consent
    ):
        raise PlatformError(f"the base does not go into standby within {connection.engage_timeout_s:g} s")


def _refuse_unfit(wire: Wire, authority: ControlAuthority) -> None:
    status = wire.heard.status
    found = wire.estranged() or (unfit(status) if status is not None else None)
    authority.on_fault(found)
    if found is not None:
        raise PlatformError(found.reason)
