"""Commands never override a pilot's takeover or a stop, at any latency; exact time and a minimal vehicle."""

import dataclasses
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_drone.adapter.authority import ControlAuthority
from adatracker_drone.adapter.command_client import CommandClient
from adatracker_drone.adapter.commands import HOLD, LAND, OFFBOARD, TAKE_OFF, TELL_MODE
from adatracker_drone.adapter.transport import Answer
from adatracker_drone.adapter.vehicle_state import VehicleState
from adatracker_drone.protocol.connection import Connection

DENIED = 2


class Telling(FakeClock):
    """Time in which a vehicle's news arrive."""

    def __init__(self):
        super().__init__()
        self.news = []

    def sleep_until(self, t_ns):
        for at_ns, tell in sorted(self.news, key=lambda each: each[0]):
            if at_ns <= t_ns:
                self.t_ns = max(self.t_ns, at_ns)
                tell()
        self.news = [(at_ns, tell) for at_ns, tell in self.news if at_ns > t_ns]
        super().sleep_until(t_ns)


class Vehicle:
    """In OFFBOARD until its pilot switches; answers orders after a round trip, and beats once a second."""

    def __init__(self, clock, authority, *, round_trip_s=0.01, pilot_s=1e9, tells=True, grants=True):
        self.heard = VehicleState(mode="OFFBOARD")
        self.foreign_datagrams = 0
        self.orders = []
        self.asked_s = -1.0
        self._clock, self._authority = clock, authority
        self._round_trip_ns, self._pilot_s = round(round_trip_s * 1e9), pilot_s
        self._tells, self._grants = tells, grants
        self._answers = {}
        for second in range(20):
            at_ns = clock.t_ns + round((second + 0.5) * 1e9)
            mode = self.mode_at(second + 0.5 - round_trip_s / 2)
            clock.news.append((at_ns, partial(self.tell, mode)))

    @property
    def now_s(self):
        return self._clock.t_ns / 1e9 - 1.0

    def mode_at(self, at_s):
        return "POSCTL" if at_s >= self._pilot_s else "OFFBOARD"

    def tell(self, mode):
        self.heard = dataclasses.replace(self.heard, mode=mode, mode_t_ns=self._clock.t_ns)
        self._authority.on_mode(mode)

    def order(self, order):
        if order is TELL_MODE:
            self.asked_s = self.now_s
            mode = self.mode_at(self.now_s + self._round_trip_ns / 2e9)
        else:
            self.orders.append((self.now_s, order))
        if not self._tells:
            return

        def arrive():
            if order is TELL_MODE and self._grants:
                self.tell(mode)
            before = self._answers.get(order.command, Answer())
            granted = order is not TELL_MODE or self._grants
            self._answers[order.command] = Answer(before.number + 1, 0 if granted else DENIED)

        self._clock.news.append((self._clock.t_ns + self._round_trip_ns, arrive))

    def answer(self, order):
        return self._answers.get(order.command, Answer())

    def send_velocity(self, command, now_ns):
        pass


def flying(**made):
    clock = Telling()
    authority = ControlAuthority(Connection(), clock)
    vehicle = Vehicle(clock, authority, **made)
    authority.give_consent()
    authority.take_charge()
    authority.engage(vehicle)
    return clock, authority, vehicle, CommandClient(vehicle, authority, clock)


@given(
    pilot_s=st.floats(0, 2),
    stop_s=st.floats(0, 2),
    round_trip_s=st.floats(0.001, 0.15),
    grants=st.booleans(),
    order=st.sampled_from([HOLD, LAND]),
)
def test_a_pilot_who_switched_before_the_drone_was_asked_is_never_overridden(
    pilot_s, stop_s, round_trip_s, grants, order
):
    clock, authority, vehicle, talk = flying(pilot_s=pilot_s, round_trip_s=round_trip_s, grants=grants)
    clock.sleep_until(clock.t_ns + round(stop_s * 1e9))
    authority.withdraw(vehicle, "enough")
    try:
        ours = talk.order_down(order, "LAND", "HOLD")
    except PlatformError:
        ours = False
    assert bool(vehicle.orders) == ours
    if ours and grants:
        assert pilot_s > vehicle.asked_s
    if ours:
        (at_s, _), *_ = vehicle.orders
        assert pilot_s > at_s - 0.05 - round_trip_s, "what was on its way is as old as that"


@given(stop_s=st.floats(0, 2), round_trip_s=st.floats(0.001, 0.15))
def test_a_drone_that_nobody_took_is_told_within_a_round_trip(stop_s, round_trip_s):
    clock, authority, vehicle, talk = flying(round_trip_s=round_trip_s)
    clock.sleep_until(clock.t_ns + round(stop_s * 1e9))
    authority.withdraw(vehicle, "enough")
    stopped_s = vehicle.now_s
    assert talk.order_down(LAND, "LAND")
    (at_s, order), *_ = vehicle.orders
    assert order is LAND
    assert at_s - stopped_s < round_trip_s + 0.06


def test_a_drone_that_tells_nothing_is_told_nothing():
    _, authority, vehicle, talk = flying(tells=False)
    vehicle._clock.news.clear()
    authority.withdraw(vehicle, "enough")
    with pytest.raises(PlatformError, match="nobody knows who controls the drone"):
        talk.order_down(LAND, "LAND")
    assert vehicle.orders == []
    assert authority.in_charge, "it may still tell later"


@pytest.mark.parametrize("order", [TAKE_OFF, OFFBOARD])
def test_an_order_towards_flight_is_not_repeated_once_it_was_stopped(order):
    clock, authority, vehicle, talk = flying(tells=False)
    clock.news.append((clock.t_ns + 100_000_000, lambda: authority.withdraw(reason="enough")))
    with pytest.raises(PlatformError, match="enough"):
        talk.order(order, "TAKEOFF")
    assert [each for _, each in vehicle.orders] == [order]
    assert vehicle.now_s < 0.15, "and the stop waits for no time-out"
