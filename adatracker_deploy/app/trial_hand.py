"""The operator's hand in one trial: who has just taken over, and what is kept of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.record import BY_HAND
from adatracker_deploy.runtime.teleop.event_file import EVENTS_NAME, write_events
from adatracker_deploy.runtime.teleop.open_hand import opened
from adatracker_deploy.trial.folder import write_file

if TYPE_CHECKING:
    import contextlib
    from pathlib import Path

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.runtime.teleop.hand import Hand


class TrialHand:
    """Opened for one trial, or not at all.

    Args:
        device: what the operator drives with (`open_hand.check`); empty for no operator.
        clock: the run's.
        alone: there is no policy to give back to.
        stack: closes the device.

    Raises:
        UsageError: it cannot be opened.
    """

    def __init__(self, device: str, clock: Clock, alone: bool, stack: contextlib.ExitStack) -> None:
        self.operator: Hand | None = (
            stack.enter_context(opened(device, clock, alone=alone)) if device else None
        )
        self._device = device
        self._drove = alone
        self._was_gone = False

    def refuse_gone(self) -> None:
        """Check, before the first tick, that the operator can take over.

        Raises:
            PlatformError: the device is lost.
        """
        if self.operator is not None and self.operator.gone:
            raise PlatformError(f"--teleop {self._device}: the device is gone")

    def news(self, record: StepRecord) -> tuple[str, bool]:
        """Return what a tick changed, in words, and whether it is a warning; no words for no change."""
        drove, self._drove = self._drove, record.driver == BY_HAND
        gone = self._drove and self.operator is not None and self.operator.gone
        was_gone, self._was_gone = self._was_gone, gone
        if gone and not was_gone:
            return (
                f"step {record.step}: --teleop {self._device} is gone: the robot stands until it is stopped",
                True,
            )
        if self._drove and not drove:
            return f"step {record.step}: taken over by hand", False
        if drove and not self._drove:
            return f"step {record.step}: given back to the policy", False
        return "", False

    def keep(self, folder: Path) -> str:
        """Write the events into a trial's folder; return why they could not be, or nothing."""
        if self.operator is None:
            return ""
        try:
            write_file(folder / EVENTS_NAME, write_events(self.operator.events))
        except OSError as error:
            return f"{EVENTS_NAME} cannot be written: {error.strerror}"
        return ""
