"""Into command mode: zeros first, then the request, then the base's own word that it obeys."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.platform import ZERO
from adatracker_wheeled.hearing import unfit
from adatracker_wheeled.transmitter import ZEROS

if TYPE_CHECKING:
    from adatracker_deploy.runtime.clock import Clock
    from adatracker_wheeled.connection import Connection
    from adatracker_wheeled.hearing import Heard
    from adatracker_wheeled.helm import Helm
    from adatracker_wheeled.wire import Wire

_TICK_NS = 20_000_000


def enable(wire: Wire, helm: Helm, connection: Connection, clock: Clock) -> None:
    """Bring a base that is fit into command mode, at zero speed; its errors are not cleared.

    Raises:
        PlatformError: the base is unfit or does not obey, or consent went meanwhile.
    """

    def still() -> None:
        with helm.lock:
            _refuse_unfit(wire, helm)
            helm.require_consent()
            wire.command(ZERO, clock.now_ns())

    begun_ns = clock.now_ns()
    wire.wait(
        lambda heard: heard.status_t_ns > begun_ns,
        connection.roles.timing.state_timeout_s,
        helm.require_consent,
    )
    _refuse_unfit(wire, helm)
    helm.take_charge()
    for _ in range(ZEROS):
        still()
        clock.sleep_until(clock.now_ns() + _TICK_NS)
    asked_ns = clock.now_ns()
    with helm.lock:
        helm.require_consent()
        wire.say((*wire.codec.enable(), *wire.codec.release_brake()))

    def obeys(heard: Heard) -> bool:
        return heard.status_t_ns > asked_ns and wire.trouble(clock.now_ns()) is None

    if not wire.wait(obeys, connection.engage_timeout_s, still):
        found = wire.trouble(clock.now_ns())
        why = found.reason if found else "it said nothing new"
        raise PlatformError(f"the base did not obey within {connection.engage_timeout_s:g} s: {why}")
    helm.engage()


def _refuse_unfit(wire: Wire, helm: Helm) -> None:
    status = wire.heard.status
    found = unfit(status) if status is not None else None
    helm.heed(found)
    if found is not None:
        raise PlatformError(found.reason)
