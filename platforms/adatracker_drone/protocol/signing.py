"""MAVLink message signing with a key shared by both ends."""

from __future__ import annotations

from adatracker_deploy.config.secret_file import check_secret
from adatracker_deploy.core.errors import UsageError
from adatracker_drone.protocol.packets import (
    KEY_BYTES,
    TICK_NS,
    Packet,
    is_signed_with,
    sign,
    signature_of,
    signing_time,
)

_LATE = 60 * 1_000_000_000 // TICK_NS
"""A link that is heard for the first time may be a minute behind, as MAVLink's guide has it."""
_LINK = 0
_MOST_LINKS = 16


def read_key(path: str) -> bytes:
    """Read a signing key: a file of 32 bytes that nobody but its owner may read.

    Raises:
        UsageError: it is missing, is not such a file, or others may read it.
    """
    where = "connection: signing_key"
    try:
        with check_secret(path, where=where).open("rb") as file:
            key = file.read(KEY_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{where}: {path} cannot be read ({error.strerror})") from error
    if len(key) != KEY_BYTES:
        raise UsageError(
            f"{where}: {path} is not {KEY_BYTES} bytes, such as head -c {KEY_BYTES} /dev/urandom makes"
        )
    if not any(key):
        raise UsageError(f"{where}: {path} is all zeros, which is not a secret")
    return key


class Signer:
    """Signs outgoing and verifies incoming frames; time is an argument."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._sent = 0
        self._heard: dict[tuple[int, int, int], int] = {}
        """The newest time of each link of each sender."""

    def sign(self, frame: bytes, unix_ns: int) -> bytes:
        """Return a MAVLink 2 frame, signed; no two have the same time."""
        self._sent = max(self._sent + 1, signing_time(unix_ns))
        return sign(frame, self._key, _LINK, self._sent)

    def believes(self, packet: Packet, unix_ns: int) -> bool:
        """Return whether a packet was signed with the key and is neither repeated nor old.

        A rejected packet changes nothing: a forged time cannot lock the true sender out.
        """
        if not packet.signed or not is_signed_with(packet, self._key):
            return False
        link, time = signature_of(packet)
        sender = (packet.system, packet.component, link)
        if sender in self._heard:
            fresh = time > self._heard[sender]
        else:
            fresh = time + _LATE >= signing_time(unix_ns) and len(self._heard) < _MOST_LINKS
        if fresh:
            self._heard[sender] = time
        return fresh
