"""Control authority: commands are sent only while there is consent.

An explicit engage gives consent. A stop, a problem with the base or a takeover revokes it, at once and from
any thread; it never comes back by itself.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import LONGEST_REASON

if TYPE_CHECKING:
    from adatracker_wheeled.adapter.receiver import StopCause
    from adatracker_wheeled.adapter.transport import Wire


class ControlAuthority:
    """Guards everything sent to the base; every method returns at once."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        """Taken before the transmitter's, never while that is held."""
        self.wire: Wire | None = None
        """None while not connected."""
        self.engaged = False
        """The base accepts commands, and nothing has ended that."""
        self.in_charge = False
        """This side, and nobody else since, enabled the base, so it has to disable it."""
        self.stopped = ""
        """Reason for revoking consent; empty if nothing unusual has happened."""
        self.taken_over = False
        """Consent was revoked by somebody at the robot."""
        self.withdrawals = 0
        """Number of revocations, whether or not there was consent."""
        self._consent = False

    @property
    def held(self) -> bool:
        """The base was stopped, and is still to be disabled by this side."""
        return self.in_charge and not self._consent

    def give_consent(self, withdrawals: int) -> None:
        """Allow commands; clears the reason for the last stop.

        Args:
            withdrawals: the count when engaging began; a later stop takes precedence.

        Raises:
            PlatformError: there was such a stop.
        """
        with self.lock:
            if self.withdrawals == withdrawals:
                self._consent, self.stopped, self.taken_over = True, "", False
            self.require_consent()

    def require_consent(self) -> None:
        """Raise PlatformError if consent was revoked."""
        if not self._consent:
            raise PlatformError(f"engaging was stopped: {self.stopped or 'disengage or close was asked for'}")

    def take_charge(self) -> None:
        """Take charge: from now on this side has to disable the base.

        Raises:
            PlatformError: consent was revoked.
        """
        with self.lock:
            self.require_consent()
            self.in_charge = True
            if self.wire is not None:
                self.wire.mark.set()

    def engage(self) -> None:
        """Allow commands: the base has confirmed command mode.

        Raises:
            PlatformError: consent was revoked.
        """
        with self.lock:
            self.require_consent()
            self.engaged = True

    def withdraw(self, reason: str = "") -> None:
        """Stop: zero three times to a base in this side's charge, then silence. The first reason stays."""
        with self.lock:
            self.withdrawals += 1
            self.stopped = self.stopped or reason[:LONGEST_REASON]  # first, for who reads without the lock
            self._consent = self.engaged = False
            if self.wire is not None and self.in_charge:
                self.wire.stop()

    def let_go(self) -> None:
        """Leave the base alone: no frame is sent until an explicit engage."""
        with self.lock:
            self.in_charge = False
            if self.wire is not None:
                self.wire.mute()
                self.wire.mark.clear()

    def on_fault(self, cause: StopCause | None) -> None:
        """Stop on a fault, and release a base that somebody else has taken over."""
        if cause is None:
            return
        with self.lock:
            if cause.taken:
                self.let_go()
            self.taken_over = self.taken_over or (cause.by_hand and not self.stopped)
            self.withdraw(cause.reason)
