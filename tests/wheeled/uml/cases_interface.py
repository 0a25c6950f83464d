"""Behaviour of python-can's ``socketcan`` interface that the wheeled adapter relies on, on a real ``vcan0``.

Run by ``test_socketcan.py``; by itself only where there is a ``vcan0`` that this process may take down.
"""

from __future__ import annotations

import errno
import os
import queue
import select
import signal
import subprocess
import sys
import time

import can
import pytest

from tests.wheeled.uml.interfaces import add_vcan, remove, set_up

CAN_ERR_BUSOFF = 0x40
"""Flags in the identifier of an error frame (linux/can/error.h)."""
WAIT_S = 10.0
"""Far more than anything here takes, even on the single processor of a user-mode kernel."""


@pytest.fixture
def vcan0():
    yield "vcan0"
    set_up("vcan0")


@pytest.fixture
def near(vcan0):
    with can.Bus(interface="socketcan", channel=vcan0) as bus:
        yield bus


@pytest.fixture
def far(vcan0):
    with can.Bus(interface="socketcan", channel=vcan0) as bus:
        yield bus


def frame(number: int = 0) -> can.Message:
    return can.Message(arbitration_id=0x111, data=number.to_bytes(8, "big"), is_extended_id=False)


def test_an_absent_interface_raises_a_plain_os_error_not_one_of_python_can():
    with pytest.raises(OSError, match="No such device") as raised:
        can.Bus(interface="socketcan", channel="vcan404")
    assert raised.value.errno == errno.ENODEV
    assert not isinstance(raised.value, can.CanError)


def test_frames_cross_in_order_and_their_sender_does_not_hear_them(near, far):
    for number in range(100):
        near.send(frame(number))
    heard = [far.recv(WAIT_S) for _ in range(100)]
    assert [int.from_bytes(message.data, "big") for message in heard] == list(range(100))
    assert near.recv(0) is None


def test_received_frames_carry_wall_clock_time_so_monotonic_time_must_be_taken_at_reception(near, far):
    before_s = time.time()
    near.send(frame())
    assert before_s - 0.1 <= far.recv(WAIT_S).timestamp <= time.time() + 0.1


def test_an_interface_that_is_down_opens_without_complaint_and_refuses_every_frame(vcan0):
    set_up(vcan0, False)
    with can.Bus(interface="socketcan", channel=vcan0) as bus, pytest.raises(can.CanOperationError) as raised:
        bus.send(frame())
    assert raised.value.error_code == errno.ENETDOWN


def test_an_interface_taken_down_tells_its_reader_once_and_its_sender_each_time(near):
    set_up("vcan0", False)
    with pytest.raises(can.CanOperationError) as raised:
        near.recv(WAIT_S)
    assert raised.value.error_code == errno.ENETDOWN
    assert near.recv(0) is None
    for _ in range(2):
        with pytest.raises(can.CanOperationError) as raised:
            near.send(frame())
        assert raised.value.error_code == errno.ENETDOWN


def test_the_same_bus_works_again_once_the_interface_is_up(near, far):
    set_up("vcan0", False)
    for bus in (near, far):
        with pytest.raises(can.CanOperationError):
            bus.recv(WAIT_S)
    set_up("vcan0")
    near.send(frame(7))
    assert far.recv(WAIT_S).data[7] == 7


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_interface_taken_down_ends_the_thread_of_a_notifier_whose_listeners_have_no_on_error(near):
    notifier = can.Notifier(near, [queue.Queue[can.Message]().put], timeout=0.05)
    (thread,) = notifier._readers
    set_up("vcan0", False)
    thread.join(WAIT_S)
    assert not thread.is_alive()
    notifier.stop()


def test_a_notifier_with_on_error_goes_on_and_hears_again_once_the_interface_is_up(near, far):
    heard: queue.Queue[object] = queue.Queue()

    class Listener(can.Listener):
        on_message_received = staticmethod(heard.put)
        on_error = staticmethod(heard.put)

    notifier = can.Notifier(near, [Listener()], timeout=0.05)
    set_up("vcan0", False)
    assert isinstance(heard.get(timeout=WAIT_S), can.CanOperationError)
    set_up("vcan0")
    with pytest.raises(can.CanOperationError):
        far.recv(WAIT_S)
    far.send(frame())
    assert isinstance(heard.get(timeout=WAIT_S), can.Message)
    notifier.stop()


def test_a_bus_whose_interface_is_gone_stays_dead_when_another_takes_its_name():
    add_vcan("vcan1")
    set_up("vcan1")
    with can.Bus(interface="socketcan", channel="vcan1") as bus:
        remove("vcan1")
        add_vcan("vcan1")
        set_up("vcan1")
        try:
            for _ in range(2):
                with pytest.raises(can.CanOperationError) as raised:
                    bus.send(frame())
            assert raised.value.error_code == errno.ENXIO
        finally:
            remove("vcan1")


SENDER = """
import sys, can, time
with can.Bus(interface="socketcan", channel="vcan0") as bus:
    task = bus.send_periodic(can.Message(arbitration_id=0x111, is_extended_id=False), 0.02)
    print("sending", flush=True)
    sys.stdin.read()
"""


def test_the_kernels_periodic_send_goes_on_while_its_process_is_stopped_and_so_is_never_used(far):
    with subprocess.Popen(
        [sys.executable, "-c", SENDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as sender:
        assert select.select([sender.stdout], [], [], WAIT_S)[0]
        sender.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, sender.pid, os.WSTOPPED | os.WNOWAIT)
        while far.recv(0):  # what came before the stop
            pass
        sent_while_stopped = [far.recv(WAIT_S) for _ in range(5)]
        sender.kill()
    assert all(sent_while_stopped)


def test_bus_off_arrives_as_an_error_frame_while_the_bus_calls_itself_active(near, far):
    bus_off = can.Message(arbitration_id=CAN_ERR_BUSOFF, is_error_frame=True, is_extended_id=False, dlc=8)
    far.send(bus_off)
    heard = near.recv(WAIT_S)
    assert heard.is_error_frame
    assert heard.arbitration_id & CAN_ERR_BUSOFF
    assert near.state is can.BusState.ACTIVE
