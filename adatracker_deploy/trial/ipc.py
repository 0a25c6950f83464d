"""IPC from the control loop to the log's writer: non-blocking, bounded, and safe against a kill.

A message is one datagram of a local socket pair (SOCK_SEQPACKET: whole or not at all, with an end of file);
pictures pass through slots of shared memory, because a frame is larger than a socket holds. Both belong to
the kernel, so what was handed over reaches the writer even when the loop's process is killed with -9.
Measured for 640x480 at 20 Hz: writing in the loop costs it up to 8 ms a tick, in a thread 42 ms of lateness,
through a blocking pipe 242 ms.
"""

from __future__ import annotations

import mmap
import os
import pickle
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Box, ClassMask
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.page.address import Address
    from adatracker_deploy.trial.privacy import Frames

SLOTS = 16
SLOT_BYTES = 16 << 20
"""A 1080p frame and its mask take 8.3 MB; pages that are never touched cost nothing."""
_DATAGRAM_BYTES = 1 << 18

Level = Literal["info", "warning", "error"]


class Picture(NamedTuple):
    """A frame as the log takes it."""

    size: tuple[int, int]
    """Width and height, px."""
    content: NDArray[np.uint8]
    """RGB of shape (H, W, 3); or the JPEG that the camera sent, (n,); or nothing, (0,)."""
    mask: ClassMask


class Place(NamedTuple):
    """The place of a `Picture` in the shared memory."""

    slot: int
    size: tuple[int, int]
    content_shape: tuple[int, ...]
    mask_shape: tuple[int, int]


@dataclass(frozen=True, slots=True)
class PageStart:
    """The operator's page, as the writer is to serve it."""

    address: Address
    about: Mapping[str, Any]
    """The page's description of the run as a whole, in plain JSON types."""
    tracker_pid: int
    """The process that a stop is for."""
    unchoosable: str = ""
    """Why nobody can be chosen; empty where somebody can."""


@dataclass(frozen=True, slots=True)
class Start:
    """First message to the writer; it answers `Ready` or `LogFailed`."""

    part: str
    """The file to write."""
    path: str
    """Its name once it is whole."""
    metadata: dict[str, dict[str, str]]
    live_port: int | None = None
    """Port of the live view on this machine; None for none."""
    frames: Frames = "full"
    """The camera's pictures that the log keeps."""
    page: PageStart | None = None
    """The operator's page; None for none."""


@dataclass(frozen=True, slots=True)
class Step:
    """One tick; `place` is None when the frame was handed over before, or had to be dropped."""

    wall_ns: int
    captured_ns: int
    """Wall-clock time of the frame's capture, ns."""
    record: StepRecord
    place: Place | None


@dataclass(frozen=True, slots=True)
class Look:
    """A frame from before the first tick: for the operator's page alone, and not written down."""

    wall_ns: int
    captured_ns: int
    seq: int
    target: str | None
    box: Box | None
    place: Place | None


@dataclass(frozen=True, slots=True)
class LogLine:
    """Something worth writing down."""

    wall_ns: int
    level: Level
    message: str


@dataclass(frozen=True, slots=True)
class End:
    """Last message to the writer of a trial that ended in order."""

    summary_json: str


@dataclass(frozen=True, slots=True)
class Ready:
    """The file is open."""


@dataclass(frozen=True, slots=True)
class Free:
    """The writer has encoded a slot's picture."""

    slot: int


@dataclass(frozen=True, slots=True)
class LogFailed:
    """The log is no longer whole, and why."""

    message: str


class Post:
    """One end of the socket pair."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    @staticmethod
    def pair() -> tuple[socket.socket, socket.socket]:
        """Return two connected ends."""
        return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def send(self, message: Any, timeout_s: float | None) -> None:
        """Hand a message over; a time-out of 0 never waits, None waits for ever.

        Raises:
            BlockingIOError: there is no room and the time-out is 0.
            OSError: the other end has gone, or the message is too large.
        """
        self._end.settimeout(timeout_s)
        self._end.send(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))

    def receive(self, timeout_s: float | None) -> Any:
        """Return the next message, in the order of sending.

        Raises:
            BlockingIOError: there is none and the time-out is 0.
            TimeoutError: there was none in time.
            EOFError: the other end has gone.
        """
        self._end.settimeout(timeout_s)
        try:
            data = self._end.recv(_DATAGRAM_BYTES)
        except ConnectionResetError:
            # The other end died with mail unread, and Linux says so once, before what it had sent.
            data = self._end.recv(_DATAGRAM_BYTES)
        if not data:
            raise EOFError("the other end has gone")
        return pickle.loads(data)  # from our own process, over a socket without a name

    def finish(self) -> None:
        """Tell the other end that nothing more comes."""
        self._end.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """Release the socket."""
        self._end.close()


class PictureSlots:
    """Shared memory for `SLOTS` frames with their masks; nameless, it vanishes with its last process."""

    def __init__(self, fd: int) -> None:
        self._memory = mmap.mmap(fd, SLOTS * SLOT_BYTES)

    @staticmethod
    def allocate() -> int:
        """Return the file descriptor of new memory."""
        fd = os.memfd_create("trial-pictures")
        os.truncate(fd, SLOTS * SLOT_BYTES)
        return fd

    def put(self, slot: int, picture: Picture) -> Place:
        """Copy a picture and its mask into a slot.

        Raises:
            ValueError: they do not fit.
        """
        size, content, mask = picture
        if content.nbytes + mask.nbytes > SLOT_BYTES:
            raise ValueError(f"a frame of {size[0]}x{size[1]} is too large for the log")
        place = Place(slot, size, content.shape, (mask.shape[0], mask.shape[1]))
        in_slot = self.get(place)
        in_slot.content[...] = content
        in_slot.mask[...] = mask
        return place

    def get(self, place: Place) -> Picture:
        """Return the picture and its mask as views into the slot."""
        start = place.slot * SLOT_BYTES
        content = np.ndarray(place.content_shape, np.uint8, self._memory, start)
        mask = np.ndarray(place.mask_shape, np.uint8, self._memory, start + content.nbytes)
        return Picture(place.size, content, mask)
