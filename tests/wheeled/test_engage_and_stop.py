"""A stop at any moment of an engagement, and a machine that was suspended: nothing moves afterwards."""

import threading

import pytest
from wheeled_rig import COMMAND_MODE, STILL, base_profile, tapped, until

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist
from tests.driving import Engaging, Sleepy, send_for

pytestmark = pytest.mark.slow

AHEAD = Twist(vx=0.5)
STOPS = {
    "hold": lambda platform: platform.hold("the test says so"),
    "disengage": lambda platform: platform.disengage(),
    "close": lambda platform: platform.close(),
}
MOMENTS_MS = (0, 1, 5, 20, 60, 110, 130, 150, 170, 200, 260)
"""Engaging takes 0.15 to 0.3 s: waiting for the state, three zeros, the request, the base's word."""


@pytest.mark.parametrize("delay_ms", MOMENTS_MS)
@pytest.mark.parametrize("stop", STOPS)
def test_a_stop_at_any_moment_of_an_engagement_is_the_last_word(stop, delay_ms, monkeypatch):
    with tapped() as (platform, simulator, tap):
        begun, consent = threading.Event(), platform._authority.give_consent

        def give_consent(withdrawals):
            begun.set()
            consent(withdrawals)

        def stop_later():
            begun.wait()
            platform.clock.sleep_until(platform.clock.now_ns() + delay_ms * 1_000_000)
            STOPS[stop](platform)

        monkeypatch.setattr(platform._authority, "give_consent", give_consent)
        stopping = threading.Thread(target=stop_later)
        stopping.start()
        try:
            platform.engage()
        except PlatformError as error:
            print(error)
        stopping.join()
        assert not platform.state().engaged
        if stop != "hold":
            until(lambda: simulator.simulator.base.mode == "standby")
        with pytest.raises(PlatformError):
            platform.send(AHEAD, platform.clock.now_ns())
        assert {data for number, data in tap.commands() if number == STILL[0]} <= {STILL[1]}


@pytest.mark.parametrize("stop", STOPS)
def test_a_stop_that_comes_before_the_engagement_had_its_turn_is_newer_than_it(stop):
    with tapped() as (platform, simulator, tap):
        engaging = Engaging(platform)
        with platform._turn:  # whoever checks or connects has it
            engaging.start()
            until(engaging.is_alive)
            stopping = threading.Thread(target=STOPS[stop], args=(platform,))
            stopping.start()
            until(lambda: platform._authority.withdrawals)
        for thread in (engaging, stopping):
            thread.join()
        assert engaging.why
        assert not platform.state().engaged
        assert simulator.simulator.base.mode == "standby"
        assert COMMAND_MODE not in tap.commands()


@pytest.fixture
def clock():
    yield Sleepy()
    Sleepy.asleep_ns = 0


def test_after_a_suspend_no_repeated_command_leaves_and_a_stop_has_latched(clock):
    with tapped(clock=clock) as (platform, simulator, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.5)
        tap.frames()
        Sleepy.asleep_ns += 3_000_000_000
        moving = [data for number, data in tap.commands_until_quiet() if (number, data) != STILL]
        assert moving == []
        assert platform.state().stopped == "the machine was suspended for 3.0 s"
        assert not platform.state().taken_over
        for command in (AHEAD, ZERO):
            with pytest.raises(PlatformError, match="suspended for 3"):
                platform.send(command, clock.now_ns())
        assert (
            simulator.simulator.base.mode == "ours"
        )  # it is still this side's, which disables it in the end
        platform.disengage()
        platform.engage()
        send_for(platform, AHEAD, 0.3)


def test_a_command_made_before_a_suspend_is_refused_after_it(clock):
    with tapped(clock=clock) as (platform, _, tap):
        platform.engage()
        send_for(platform, ZERO, 0.1)
        tap.frames()
        made_ns = clock.now_ns()
        Sleepy.asleep_ns += 3_000_000_000
        with pytest.raises(PlatformError, match="suspended for 3"):
            platform.send(AHEAD, made_ns)
        assert {data for _, data in tap.commands_until_quiet()} == {STILL[1]}


def test_a_suspend_while_engaging_ends_it(clock):
    with tapped(base_profile(faults=("frozen_feedback",)), clock) as (platform, _, tap):
        engaging = Engaging(platform)
        engaging.start()
        until(lambda: COMMAND_MODE in tap.commands())
        Sleepy.asleep_ns += 500_000_000
        engaging.join()
        assert "suspended for 0.5 s" in engaging.why


def test_two_clocks_that_were_read_a_little_apart_are_no_suspend(clock):
    with tapped(clock=clock) as (platform, _, _):
        platform.engage()
        Sleepy.asleep_ns += 50_000_000
        send_for(platform, AHEAD, 0.2)
        assert platform.state().engaged
