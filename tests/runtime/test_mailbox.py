"""The newest whole message is always readable, whatever the writer is doing."""

from __future__ import annotations

import multiprocessing
import zlib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import Acted, LinkStatus, Phase
from adatracker_deploy.runtime.mailbox import Mailbox
from adatracker_deploy.runtime.wire import (
    STATUS_BYTES,
    pack_setpoint,
    pack_status,
    unpack_setpoint,
    unpack_status,
)

CAPACITY = 2048
numbers = st.floats(allow_nan=False, allow_infinity=True)


def test_nothing_is_read_before_the_first_message():
    assert Mailbox(bytearray(Mailbox.size(16)), 16).read() is None


@given(st.lists(st.binary(max_size=64), min_size=1, max_size=8))
def test_the_newest_message_wins(messages):
    memory = bytearray(Mailbox.size(64))
    writer, reader = Mailbox(memory, 64), Mailbox(memory, 64)
    for message in messages:
        writer.write(message)
        assert reader.read() == message


def test_a_message_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="does not fit"):
        Mailbox(bytearray(Mailbox.size(4)), 4).write(b"12345")


def test_a_half_written_message_leaves_the_one_before():
    memory = bytearray(Mailbox.size(8))
    mailbox = Mailbox(memory, 8)
    mailbox.write(b"first")
    whole = bytes(memory)
    mailbox.write(b"second")
    changed = [i for i, (a, b) in enumerate(zip(whole, memory, strict=True)) if a != b]
    for i in changed:
        half = bytearray(whole)
        half[changed[0] : i] = memory[changed[0] : i]
        assert Mailbox(half, 8).read() == b"first"


def _write_for_ever(memory, ready):
    mailbox, i = Mailbox(memory, CAPACITY), 0
    ready.set()
    while True:
        i += 1
        body = bytes([i % 251]) * (i % (CAPACITY - 4))
        mailbox.write(zlib.crc32(body).to_bytes(4, "little") + body)


def test_reads_beside_a_writer_in_another_process_are_never_torn():
    context = multiprocessing.get_context("spawn")
    memory, ready = context.RawArray("B", Mailbox.size(CAPACITY)), context.Event()
    writer = context.Process(target=_write_for_ever, args=(memory, ready), daemon=True)
    writer.start()
    try:
        assert ready.wait(30)
        mailbox, seen = Mailbox(memory, CAPACITY), set()
        while len(seen) < 500:
            message = mailbox.read()
            if message is not None:
                assert zlib.crc32(message[4:]).to_bytes(4, "little") == message[:4]
                seen.add(message)
    finally:
        writer.kill()
        writer.join()


@given(numbers, numbers, st.integers(0, 2**62))
def test_a_setpoint_survives_its_bytes(vx, yaw_rate, t_ns):
    setpoint = Setpoint(Twist(vx, 0.0, -0.5, yaw_rate), t_ns, 0.1, t_ns - 1, t_ns + 1, 0.2)
    assert unpack_setpoint(pack_setpoint(setpoint)) == setpoint


def test_a_setpoint_of_an_older_black_box_can_still_be_read():
    assert unpack_setpoint(b"[7, 0.1, 6, null, 0.5, 0.0, 0.0, -0.1]") == Setpoint(
        Twist(0.5, 0, 0, -0.1), 7, 0.1, 6
    )


@example("\U0001f6d1" * 2000, None)
@given(st.text(max_size=2000), st.one_of(st.none(), st.builds(Pose, numbers, numbers)))
def test_a_status_always_fits_and_survives_but_for_its_length(text, pose):
    status = LinkStatus(
        Phase.HOLDING,
        PlatformState(7, "HOLD", pose=pose, stopped=text),
        Twist(1.0),
        ("stale",),
        text,
        True,
        9,
        Acted(1, 2, 3),
    )
    message = pack_status(status)
    assert len(message) <= STATUS_BYTES
    back = unpack_status(message)
    assert text.startswith(back.stopped)
    assert back.state.pose == pose
    assert (back.phase, back.sent, back.reasons) == (status.phase, status.sent, status.reasons)
    assert back.acted == status.acted
