"""The wheeled adapter's `Bus` on a real ``vcan0``: what ends it, and that only a new one helps.

Run by ``test_socketcan.py``; by itself only where there is a ``vcan0`` that this process may take down.
"""

from __future__ import annotations

import dataclasses
import queue

import can
import pytest

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.registry import load_profile
from adatracker_wheeled.protocol.bus import Bus
from adatracker_wheeled.protocol.frames import CanFrame
from tests.wheeled.uml.interfaces import add_vcan, remove, set_up

WAIT_S = 10.0
FRAME = CanFrame(0x111, bytes(range(8)))


class End:
    """One end of the wire: its bus, and what it has heard."""

    def __init__(self, channel: str) -> None:
        connection = load_profile("scout").connection
        self.heard: queue.Queue[CanFrame | None] = queue.Queue()
        self.bus = Bus.open(
            dataclasses.replace(connection, interface="socketcan", channel=channel), self.heard.put
        )

    def next_frame(self) -> CanFrame:
        while (frame := self.heard.get(timeout=WAIT_S)) is None:
            pass
        return frame

    def wait_until_lost(self) -> str:
        while not self.bus.lost:
            self.heard.get(timeout=WAIT_S)
        return self.bus.lost


@pytest.fixture
def open_end():
    """Open ends that are closed afterwards; leave ``vcan0`` up and no ``vcan1``."""
    ends = []

    def open_one(channel="vcan0") -> End:
        ends.append(End(channel))
        return ends[-1]

    yield open_one
    for end in ends:
        end.bus.close()
    set_up("vcan0")


def test_an_absent_interface_is_named_together_with_what_to_do(open_end):
    with pytest.raises(
        PlatformError, match=r"vcan404 \(socketcan\) cannot be opened: No such device.*ip link"
    ):
        open_end("vcan404")


def test_frames_cross(open_end):
    near, far = open_end(), open_end()
    assert near.bus.send(FRAME)
    assert far.next_frame() == FRAME


def test_an_interface_taken_down_is_noticed_without_sending_and_latches(open_end):
    near = open_end()
    set_up("vcan0", False)
    assert "Network is down" in near.wait_until_lost()
    set_up("vcan0")
    with pytest.raises(PlatformError, match="Network is down"):
        near.bus.send(FRAME)


def test_a_new_bus_works_once_the_interface_is_up_again(open_end):
    near = open_end()
    set_up("vcan0", False)
    near.wait_until_lost()
    near.bus.close()
    set_up("vcan0")
    again, far = open_end(), open_end()
    assert again.bus.send(FRAME)
    assert far.next_frame() == FRAME


def test_a_bus_opened_while_its_interface_is_down_is_lost_with_its_first_frame(open_end):
    set_up("vcan0", False)
    near = open_end()
    with pytest.raises(PlatformError, match="Network is down"):
        near.bus.send(FRAME)
    assert near.bus.lost


def test_an_interface_that_is_unplugged_is_noticed_without_sending(open_end):
    add_vcan("vcan1")
    set_up("vcan1")
    near = open_end("vcan1")
    remove("vcan1")
    assert near.wait_until_lost()


def test_bus_off_loses_the_bus(open_end):
    near = open_end()
    with can.Bus(interface="socketcan", channel="vcan0") as controller:
        controller.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, dlc=8))
    assert "bus-off" in near.wait_until_lost()
