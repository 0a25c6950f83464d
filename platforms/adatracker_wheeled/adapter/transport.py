"""Transport to a base over its CAN bus: telemetry and commands as values.

It has a receive and a transmit thread, which end with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.runtime.charge import ChargeMark
from adatracker_deploy.runtime.ownership import Claim
from adatracker_deploy.runtime.suspend import SuspendWatch
from adatracker_wheeled.adapter.receiver import BaseTelemetry, Receiver, StopCause, rival, trouble, unfit
from adatracker_wheeled.adapter.traffic import Traffic
from adatracker_wheeled.adapter.transmitter import Transmitter
from adatracker_wheeled.protocol.bus import Bus
from adatracker_wheeled.protocol.codec import Codec

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.config.limits import Limits
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Twist
    from adatracker_wheeled.protocol.connection import Connection
    from adatracker_wheeled.protocol.frames import CanFrame

_TICK_NS = 20_000_000
_RIVAL_S = 0.5
"""Longest interval between a commander's frames: the longest time-out of AgileX's bases."""
_LAST_WORDS_S = 0.2
"""Three zeros 20 ms apart, with room."""


class Wire:
    """One base.

    Args:
        connection: the profile's.
        limits: the profile's; a command lives for its `command_timeout_s`.
        clock: the run's.
        on_news: called in the receive thread with each frame and at every silence; must return at once.

    Raises:
        UsageError: the roles do not fit the DBC, or the connection's settings cannot work.
        PlatformError: the bus cannot be opened, or another program on this machine has it.
    """

    def __init__(
        self, connection: Connection, limits: Limits, clock: Clock, on_news: Callable[[], None]
    ) -> None:
        self.codec = Codec(connection.roles)
        self.codec.check_limits(limits)
        self.receiver = Receiver(self.codec, connection.roles, clock.speed)
        self._connection = connection
        self._timing = connection.roles.timing
        self._clock = clock
        self._on_news = on_news
        self._count = 0
        self._suspends = SuspendWatch(clock)
        self._driven_ns = 0
        """Somebody else's commands count as trouble from then on."""
        self.traffic = Traffic(clock, str(connection.channel))
        self.mark = ChargeMark(connection.robot)
        self._claim = Claim(connection.robot)
        try:
            self._bus = Bus.open(connection, self._hear, self.traffic.add)
        except BaseException:
            self._claim.close()
            raise
        self._opened_ns = clock.now_ns()
        self.transmitter = Transmitter(
            self._put, clock, self._timing.command_period_s, limits.command_timeout_s * clock.speed
        )

    @property
    def heard(self) -> BaseTelemetry:
        """The base's newest telemetry."""
        return self.receiver.heard

    @property
    def lost(self) -> str:
        """Reason for the loss of the bus; empty while it works."""
        return self._bus.lost

    @property
    def dropped(self) -> int:
        """Frames that the bus did not take."""
        return self._bus.dropped

    def trouble(self, now_ns: int) -> StopCause | None:
        """Judge whether a base that is driven may be driven on."""
        return self.estranged() or trouble(self.heard, self._timing, now_ns, self._clock.speed)

    def begin(self) -> None:
        """Mean to drive from now on: who commands the base, and a suspend, are watched for."""
        self._suspends.begin()
        self._driven_ns = self._clock.now_ns() - self._rival_ns

    def estranged(self) -> StopCause | None:
        """Return why this side must not command the base, whatever that says of itself."""
        if self._bus.lost:
            return StopCause(self._bus.lost)
        if why := self._suspends.trouble():
            return StopCause(why)
        return rival(self.heard, self._driven_ns)

    def taken(self) -> StopCause | None:
        """Return who has taken a base that is not driven at present: another host, or a remote control.

        Its mode alone says nothing: it may not have carried out the last request yet.
        """
        status = self.heard.status
        found = rival(self.heard, self._driven_ns) or (unfit(status) if status is not None else None)
        return found if found is not None and found.taken else None

    def rival(self) -> StopCause | None:
        """Return the trouble with somebody else who has commanded the base lately."""
        return rival(self.heard, self._clock.now_ns() - self._rival_ns)

    def listen(self, meanwhile: Callable[[], None], seconds: float | None = None) -> None:
        """Wait until the bus has been listened to for so long, by default for as long as a host is silent."""
        enough_ns = self._rival_ns if seconds is None else round(seconds * self._clock.speed * 1e9)
        until_ns = self._opened_ns + enough_ns
        left_s = (until_ns - self._clock.now_ns()) / 1e9 / self._clock.speed
        self.wait(lambda _: self._clock.now_ns() >= until_ns, left_s + _RIVAL_S, meanwhile)

    @property
    def _rival_ns(self) -> int:
        """After this silence a commander no longer counts: the base has stopped by itself."""
        seconds = max(_RIVAL_S, self._timing.base_timeout_s)
        return round(seconds * self._clock.speed * 1e9)

    def command(self, twist: Twist, now_ns: int) -> Twist:
        """Let a velocity made at `now_ns` go out; return the one that its frames really say.

        Raises:
            PlatformError: it is not finite, or no velocity for a base; nothing is sent.
        """
        said, _ = self.codec.command(twist)
        self.transmitter.send(twist, min(now_ns, self._clock.now_ns()))  # none lives on from the future
        return said

    def say(self, frames: tuple[CanFrame, ...]) -> None:
        """Send a request now.

        Raises:
            PlatformError: the bus is lost, or did not take it.
        """
        if not self.offer(frames):
            raise PlatformError(
                "the CAN bus takes no frame: is the base on, the cable in, the bit rate right?"
            )

    def offer(self, frames: tuple[CanFrame, ...]) -> bool:
        """Send a request now if there is room; return whether the bus took all of it.

        Raises:
            PlatformError: the bus is lost.
        """
        return all(self._bus.send(frame) for frame in frames)

    def stop(self) -> None:
        """Say zero three times, then nothing."""
        self.transmitter.stop()

    def mute(self) -> None:
        """Say nothing more, at once."""
        self.transmitter.mute()

    def finish(self) -> None:
        """Wait until a stop has been said."""
        self.transmitter.wait_until_silent(_LAST_WORDS_S)

    def reopen(self) -> None:
        """Open the bus anew after it was lost; what was heard before counts no more.

        Raises:
            UsageError, PlatformError: as when it was opened first.
        """
        self.transmitter.mute()
        self._bus.close()
        self.receiver.forget()
        self._bus = Bus.open(self._connection, self._hear, self.traffic.add)
        self._opened_ns = self._clock.now_ns()

    def hear_state(self, meanwhile: Callable[[], None]) -> None:
        """Wait for the base's first state on a bus that was just opened.

        Raises:
            PlatformError: none came within `silence_timeout_s`; says what is known of why.
        """
        timeout_s = self._connection.silence_timeout_s
        if not self.wait(lambda heard: heard.status is not None, timeout_s, meanwhile):
            why = self.lost or self.receiver.explain_silence()
            raise PlatformError(f"no state from the base within {timeout_s:g} s: {why}")

    def wait(
        self,
        condition: Callable[[BaseTelemetry], bool],
        timeout_s: float,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> bool:
        """Do something at 50 Hz until the base meets `condition`; return whether it did in time.

        The time-out is in machine time: a base is no more patient in a fast rehearsal.
        """
        deadline_ns = self._clock.now_ns() + round(timeout_s * self._clock.speed * 1e9)
        while not condition(self.heard):
            meanwhile()
            now_ns = self._clock.now_ns()
            if self.lost or now_ns > deadline_ns:
                return False
            self._clock.sleep_until(now_ns + _TICK_NS)
        return True

    def close(self) -> None:
        """End the threads, release the device, finish the CAN log, and let others have the bus."""
        self.transmitter.close()
        self._bus.close()
        self.traffic.close()
        self._claim.close()

    def _hear(self, frame: CanFrame | None) -> None:
        if frame is not None:
            self.receiver.receive(frame, self._clock.now_ns())
        self._on_news()

    def _put(self, twist: Twist) -> None:
        """Put one command on the bus, from the transmit thread; a full bus drops it.

        Raises:
            PlatformError: the bus is lost; or the command moves the base, and the machine was suspended or
                somebody else commands the base.
        """
        if twist != ZERO and (found := self.estranged()):
            raise PlatformError(found.reason)  # it latches with the next frame that is heard
        _, frames = self.codec.command(twist, self._count)
        self._count += 1
        for frame in frames:
            self._bus.send(frame)
