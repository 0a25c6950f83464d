"""Control authority: set-points leave only with consent; tested in exact time and without a drone."""

import dataclasses
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_drone.adapter.authority import ControlAuthority
from adatracker_drone.adapter.commands import LAND, OFFBOARD, TAKE_OFF, VehicleCommand
from adatracker_drone.adapter.vehicle_state import VehicleState
from adatracker_drone.protocol.connection import Connection


class RecordingVehicle:
    """A vehicle at 2 m in OFFBOARD that writes down every set-point; the wire itself is tested in SITL."""

    def __init__(self, clock: FakeClock) -> None:
        self.sent: list[Twist] = []
        self.orders: list[VehicleCommand] = []
        self.foreign_datagrams, self.ignored = 0, "3 from an address"
        self._clock = clock
        self.heard = VehicleState(mode="OFFBOARD")
        self.hear()

    def hear(self, **news) -> None:
        position = {"position_t_ns": self._clock.now_ns(), "position_ned_m": (0.0, 0.0, -2.0)}
        self.heard = dataclasses.replace(self.heard, **(position | news))

    def send_velocity(self, command: Twist, now_ns: int) -> None:
        self.sent.append(command)

    def order(self, order: VehicleCommand) -> None:
        self.orders.append(order)


class Rig:
    def __init__(self, speed: float = 1.0) -> None:
        self.clock = FakeClock(speed=speed)
        self.vehicle = RecordingVehicle(self.clock)
        self.authority = ControlAuthority(Connection(), self.clock)

    def steer(self, command: Twist = ZERO) -> Twist:
        return self.authority.steer(self.vehicle, command, self.clock.now_ns())

    def engage(self) -> "Rig":
        self.authority.give_consent()
        self.authority.take_charge()
        self.authority.hold_altitude(self.vehicle, (1.0, 6.0))
        self.authority.engage(self.vehicle)
        return self


def test_without_consent_nothing_leaves():
    rig = Rig()
    for send in (rig.steer, lambda: rig.authority.keep_alive(rig.vehicle)):
        with pytest.raises(PlatformError):
            send()
    assert rig.vehicle.sent == []


def test_consent_alone_lets_only_zero_out():
    rig = Rig()
    rig.authority.give_consent()
    rig.authority.keep_alive(rig.vehicle)
    with pytest.raises(PlatformError, match="not engaged"):
        rig.steer(Twist(vx=1.0))
    assert rig.vehicle.sent == [ZERO]


def test_what_is_returned_is_what_was_sent_with_the_climb_that_keeps_the_altitude():
    rig = Rig().engage()
    rig.vehicle.hear(position_ned_m=(0.0, 0.0, -1.7))
    sent = rig.steer(Twist(vx=1.0, yaw_rate=0.2))
    assert sent == rig.vehicle.sent[-1]
    assert (sent.vx, sent.yaw_rate) == (1.0, 0.2)
    assert sent.vz == pytest.approx(0.3)


def test_the_altitude_counts_from_where_the_drone_took_off():
    rig = Rig()
    rig.authority.ground_down_m = 1.0
    assert rig.authority.altitude_m(rig.vehicle.heard) == 3.0


def test_a_stop_sends_a_last_zero_and_then_nothing_until_consent_is_given_again():
    rig = Rig().engage()
    rig.steer(Twist(vx=1.0))
    rig.authority.withdraw(rig.vehicle, "enough")
    assert rig.vehicle.sent[-1].vx == 0.0
    count = len(rig.vehicle.sent)
    with pytest.raises(PlatformError, match="enough"):
        rig.steer(Twist(vx=1.0))
    rig.authority.on_mode("OFFBOARD")
    with pytest.raises(PlatformError):
        rig.authority.take_charge()
    assert len(rig.vehicle.sent) == count
    rig.engage()
    assert rig.steer(Twist(vx=1.0)).vx == 1.0
    assert rig.authority.stopped == ""


def test_the_first_reason_stays_and_fits_its_place():
    rig = Rig().engage()
    rig.authority.withdraw(reason="x" * 500)
    rig.authority.withdraw(reason="later")
    assert rig.authority.stopped == "x" * 95


@given(st.sampled_from(["POSCTL", "MANUAL", "HOLD", "LAND", "RETURN_TO_LAUNCH", "UNKNOWN"]))
def test_a_mode_that_nobody_asked_for_ends_everything_and_the_drone_is_no_longer_ours(mode):
    rig = Rig().engage()
    rig.authority.on_mode(mode)
    assert not rig.authority.engaged
    assert not rig.authority.in_charge
    assert mode in rig.authority.stopped
    rig.authority.on_mode("OFFBOARD")
    with pytest.raises(PlatformError, match=mode):
        rig.steer(Twist(vx=1.0))
    assert rig.vehicle.sent == []


def test_the_modes_that_follow_a_stop_are_nobodys_takeover():
    rig = Rig().engage()
    rig.authority.withdraw(rig.vehicle, "enough")
    assert rig.authority.order_down(rig.vehicle, LAND, "LAND")
    rig.authority.on_mode("LAND")
    assert rig.authority.stopped == "enough"
    assert rig.authority.in_charge


@given(st.sampled_from(["POSCTL", "HOLD", "RETURN_TO_LAUNCH", "MISSION"]))
def test_a_mode_that_nobody_asked_for_makes_it_the_pilots_after_a_stop_too(mode):
    rig = Rig().engage()
    rig.authority.withdraw(rig.vehicle, "enough")
    rig.authority.on_mode(mode)
    assert not rig.authority.order_down(rig.vehicle, LAND, "LAND")
    assert rig.vehicle.orders == []
    assert rig.authority.taken_over


def test_without_consent_nothing_is_ordered_that_leads_towards_flight():
    rig = Rig()
    rig.authority.give_consent()
    rig.authority.order(rig.vehicle, TAKE_OFF)
    rig.authority.withdraw(reason="enough")
    for order in (TAKE_OFF, OFFBOARD):
        with pytest.raises(PlatformError, match="enough"):
            rig.authority.order(rig.vehicle, order)
    assert rig.vehicle.orders == [TAKE_OFF]


def test_a_takeover_between_the_switch_and_the_engagement_is_seen():
    rig = Rig()
    rig.authority.give_consent()
    rig.vehicle.hear(mode="POSCTL")
    with pytest.raises(PlatformError, match="POSCTL"):
        rig.authority.engage(rig.vehicle)
    assert not rig.authority.engaged


def test_a_drone_that_is_no_longer_heard_is_flown_no_further():
    rig = Rig().engage()
    rig.clock.advance(0.26)  # of 0.27 s
    rig.steer()
    rig.clock.advance(0.02)
    count = len(rig.vehicle.sent)
    with pytest.raises(PlatformError, match="no position"):
        rig.steer()
    rig.vehicle.hear()
    with pytest.raises(PlatformError, match="no position"):
        rig.steer()
    assert len(rig.vehicle.sent) == count


def test_silence_is_counted_in_the_machines_time():
    rig = Rig(speed=5.0).engage()
    rig.clock.advance(1.3)
    rig.steer()
    rig.clock.advance(0.1)
    with pytest.raises(PlatformError, match="no position"):
        rig.steer()


@pytest.mark.parametrize("stop", [False, True])
def test_a_sender_that_was_stopped_itself_sends_no_zero_into_the_autopilots_landing(stop):
    rig = Rig().engage()
    rig.steer(Twist(vx=1.0))
    rig.clock.advance(0.6)  # COM_OF_LOSS_T is 1 s, and what is sent now is not heard at once
    rig.vehicle.hear()
    count = len(rig.vehicle.sent)
    if stop:
        rig.authority.withdraw(rig.vehicle, "enough")
    with pytest.raises(PlatformError, match="enough" if stop else "no set-point went out for 0.6 s"):
        rig.steer(Twist(vx=1.0))
    assert len(rig.vehicle.sent) == count


def test_a_shorter_loss_time_is_minded():
    rig = Rig().engage()
    rig.authority.loss_s = 0.2
    rig.clock.advance(0.11)
    with pytest.raises(PlatformError, match="no set-point"):
        rig.steer()


def test_after_a_suspend_nothing_that_moves_is_sent():
    rig = Rig().engage()
    rig.steer(Twist(vx=1.0))
    count = len(rig.vehicle.sent)
    rig.clock.suspend(0.2)
    with pytest.raises(PlatformError, match=r"suspended for 0\.2 s"):
        rig.steer(Twist(vx=1.0))
    rig.authority.withdraw(rig.vehicle, "enough")
    assert len(rig.vehicle.sent) == count
    assert rig.authority.order_down(rig.vehicle, LAND, "LAND"), "it is still ours to land"


def test_after_a_suspend_while_engaging_nothing_climbs():
    rig = Rig()
    rig.authority.give_consent()
    rig.clock.suspend(5.0)
    with pytest.raises(PlatformError, match="suspended"):
        rig.authority.order(rig.vehicle, TAKE_OFF)
    assert rig.vehicle.orders == []


def test_a_suspend_too_short_to_matter_is_none():
    rig = Rig().engage()
    rig.clock.suspend(0.05)
    assert rig.steer(Twist(vx=1.0)).vx == 1.0


def test_somebody_else_on_a_link_where_nobody_may_be_ends_a_flight():
    rig = Rig()
    rig.authority = ControlAuthority(Connection(alone=True), rig.clock)
    rig.engage().steer(Twist(vx=1.0))
    rig.vehicle.foreign_datagrams = 1
    with pytest.raises(PlatformError, match="somebody else sends"):
        rig.steer(Twist(vx=1.0))
    assert rig.vehicle.sent[-1].vx == 0.0


def test_no_set_point_slips_out_after_a_stop_however_the_threads_interleave():
    for _ in range(20):
        rig = Rig().engage()
        go = threading.Event()

        def sender(rig=rig, go=go) -> None:
            go.wait()
            try:
                while True:
                    rig.steer(Twist(vx=1.0))
            except PlatformError:
                pass

        thread = threading.Thread(target=sender)
        thread.start()
        go.set()
        while not rig.vehicle.sent:
            pass
        rig.authority.withdraw(rig.vehicle, "enough")
        after_the_stop = len(rig.vehicle.sent)
        thread.join(5.0)
        assert not thread.is_alive()
        assert len(rig.vehicle.sent) == after_the_stop
        assert rig.vehicle.sent[-1].vx == 0.0
