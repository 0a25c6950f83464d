"""Command client: commands, acknowledgements and time-outs; checks who controls the drone before stopping it.

Times are the machine's seconds at any speed of the run: MAVSDK and radios run no faster in a fast rehearsal.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_drone.adapter.commands import TELL_MODE, VehicleCommand

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_drone.adapter.authority import ControlAuthority
    from adatracker_drone.adapter.transport import Vehicle

TICK_NS = 50_000_000
"""Period of set-points while engaging: 20 Hz; PX4 needs more than 2 Hz."""
_LOOK_NS = 2_000_000
"""Between two looks for an answer: it takes some milliseconds."""
_ANSWER_S = 0.5
_TRIES = 3
_ASK_AGAIN_S = 0.2
_AS_OLD_S = 0.05
"""A mode received this soon after a request may have been sent before it."""


def nothing() -> None:
    """Do nothing while waiting."""


class CommandClient:
    """Sends commands to one vehicle, from one thread at a time."""

    def __init__(self, vehicle: Vehicle, authority: ControlAuthority, clock: Clock) -> None:
        self.vehicle = vehicle
        self._authority = authority
        self._clock = clock

    def deadline_ns(self, timeout_s: float) -> int:
        """Return the deadline, by the run's clock, after a number of machine seconds."""
        return self._clock.now_ns() + round(timeout_s * self._clock.speed * 1e9)

    def wait(
        self,
        condition: Callable[[], bool],
        timeout_s: float,
        meanwhile: Callable[[], None] = nothing,
        every_ns: int = TICK_NS,
    ) -> bool:
        """Repeat an action until a condition holds; return whether it did in time."""
        deadline_ns = self.deadline_ns(timeout_s)
        while not condition():
            meanwhile()
            now_ns = self._clock.now_ns()
            if now_ns > deadline_ns:
                return False
            self._clock.sleep_until(now_ns + every_ns)
        return True

    def keep_alive(self) -> None:
        """Send a zero set-point; raise PlatformError if consent was revoked."""
        self._authority.keep_alive(self.vehicle)

    def demand(self, condition: Callable[[], bool], timeout_s: float, failure: str) -> None:
        """Wait for a condition while sending set-points, as long as there is consent.

        Raises:
            PlatformError: consent was revoked, or `condition` was not met.
        """
        if not self.wait(condition, timeout_s, self.keep_alive):
            raise PlatformError(failure)

    def order(self, order: VehicleCommand, *modes: str) -> None:
        """Send a command that leads towards flight, while there is consent, until it is acknowledged.

        Consent is checked before each transmission and while waiting for the answer.

        Args:
            order: what to do.
            modes: those that it leads to.

        Raises:
            PlatformError: consent was revoked, or the command was refused or not answered.
        """
        self._until_answered(
            order, lambda: self._authority.order(self.vehicle, order, *modes), self.keep_alive
        )

    def order_down(self, order: VehicleCommand, *modes: str) -> bool:
        """Send a command that leads towards rest if this side is still in charge; return whether it is.

        Charge is checked before each transmission.

        Raises:
            PlatformError: it was refused or not answered.
        """
        ours = [False]

        def send() -> None:
            ours[0] = self.is_ours() and self._authority.order_down(self.vehicle, order, *modes)

        self._until_answered(order, send, nothing, lambda: not ours[0])
        return ours[0]

    def is_ours(self) -> bool:
        """Ask the autopilot for its mode; return whether this side is still in charge of the drone.

        The last known mode may be a second old, and a stop would then take the drone from its pilot.

        Raises:
            PlatformError: it does not answer. Nobody knows who controls the drone then, so it is left alone.
        """
        if not self._authority.in_charge:
            return False
        if not self.hear_mode():
            raise PlatformError(
                "the autopilot does not report its mode, so nobody knows who controls the drone: its own "
                "fail-safe acts; be ready with the remote control"
            )
        return self._authority.in_charge

    def hear_mode(self) -> bool:
        """Ask the autopilot for its mode; return whether it answered and the authority has handled it."""
        for _ in range(_TRIES * 2):
            answers, asked_ns = self.vehicle.answer(TELL_MODE).number, self._clock.now_ns()
            self.vehicle.order(TELL_MODE)
            told = partial(self._is_told, answers, asked_ns)
            if self.wait(told, _ASK_AGAIN_S, every_ns=_LOOK_NS):
                return True
        return False

    def _is_told(self, answers: int, asked_ns: int) -> bool:
        answer = self.vehicle.answer(TELL_MODE)
        if answer.number > answers and answer.accepted:
            return True  # the mode came before it
        old_s = (self.vehicle.heard.mode_t_ns - asked_ns) / 1e9 / self._clock.speed
        return old_s > _AS_OLD_S

    def _until_answered(
        self,
        order: VehicleCommand,
        send: Callable[[], None],
        meanwhile: Callable[[], None],
        needless: Callable[[], bool] = lambda: False,
    ) -> None:
        answers = self.vehicle.answer(order).number
        for _ in range(_TRIES):
            send()
            if needless():
                return
            if self.wait(
                lambda: self.vehicle.answer(order).number > answers,
                _ANSWER_S,
                meanwhile,
                every_ns=_LOOK_NS * 5,
            ):
                break
        else:
            raise PlatformError(
                f"no answer from the autopilot when asked to {order.says}: its own fail-safe acts; "
                "be ready with the remote control"
            )
        answer = self.vehicle.answer(order)
        if not answer.accepted:
            complaint = self.vehicle.heard.complaint
            why = f"; its last warning: {complaint}" if complaint else ""
            raise PlatformError(f"the autopilot did not {order.says}: {answer.says}{why}")
