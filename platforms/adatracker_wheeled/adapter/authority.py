"""Who drives the base: commands leave only while there is consent.

Consent is given by an explicit engage. It is taken away, at once and from any thread, by a stop, by trouble
with the base and by somebody who takes it over; and it never comes back by itself.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError

if TYPE_CHECKING:
    from adatracker_wheeled.adapter.receiver import StopCause
    from adatracker_wheeled.adapter.transport import Wire

_LONGEST_REASON = 95
"""As `PlatformState.stopped` promises."""


class ControlAuthority:
    """Guards what goes out on a wire; every method returns at once."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        """Taken before the transmitter's, never while that is held."""
        self.wire: Wire | None = None
        """None while not connected."""
        self.engaged = False
        """The base obeys and nothing has ended that."""
        self.in_charge = False
        """The base was enabled by this side and by nobody else since: this side has to disable it."""
        self.stopped = ""
        """Why consent went; empty while nothing unusual has happened."""
        self.taken_over = False
        """Consent went because somebody at the robot wanted it so."""
        self.withdrawals = 0
        """How often consent was taken away, whether or not there was any."""
        self._consent = False

    def give_consent(self, withdrawals: int) -> None:
        """Let commands out; forgets why they were stopped.

        Args:
            withdrawals: when whoever engages began to; a stop since then is newer than the wish to engage.

        Raises:
            PlatformError: there was such a stop.
        """
        with self.lock:
            if self.withdrawals == withdrawals:
                self._consent, self.stopped, self.taken_over = True, "", False
            self.require_consent()

    def require_consent(self) -> None:
        """Do nothing, or raise PlatformError when consent has gone."""
        if not self._consent:
            raise PlatformError(f"engaging was stopped: {self.stopped or 'disengage or close was asked for'}")

    def take_charge(self) -> None:
        """From now on this side has to disable the base again.

        Raises:
            PlatformError: consent has gone.
        """
        with self.lock:
            self.require_consent()
            self.in_charge = True
            if self.wire is not None:
                self.wire.mark.set()

    def engage(self) -> None:
        """Let commands through: the base was heard to obey.

        Raises:
            PlatformError: consent has gone.
        """
        with self.lock:
            self.require_consent()
            self.engaged = True

    def withdraw(self, reason: str = "") -> None:
        """Stop: zero three times to a base in this side's charge, then silence. The first reason stays."""
        with self.lock:
            self.withdrawals += 1
            self.stopped = self.stopped or reason[:_LONGEST_REASON]  # first, for who reads without the lock
            self._consent = self.engaged = False
            if self.wire is not None and self.in_charge:
                self.wire.stop()

    def let_go(self) -> None:
        """Leave the base alone: not another frame is sent until an explicit engage."""
        with self.lock:
            self.in_charge = False
            if self.wire is not None:
                self.wire.mute()
                self.wire.mark.clear()

    def heed(self, trouble: StopCause | None) -> None:
        """Stop for trouble, and let go of a base that somebody else has taken."""
        if trouble is None:
            return
        with self.lock:
            if trouble.taken:
                self.let_go()
            self.taken_over = self.taken_over or (trouble.by_hand and not self.stopped)
            self.withdraw(trouble.reason)
