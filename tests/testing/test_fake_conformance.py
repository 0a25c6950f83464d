"""The fake keeps the promises that it stands in for."""

from typing import ClassVar

import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_deploy.testing.fake import FakeConnection, FakePlatform, fake_profile

pytestmark = pytest.mark.slow


class TestFakePlatform(PlatformConformance):
    platform_class = FakePlatform
    clock_speed = 10.0
    manual: ClassVar = {
        Twist(vx=0.5): "000000000000e03f" + "00" * 8,  # IEEE 754: forward, then counter-clockwise
        Twist(yaw_rate=0.25): "00" * 8 + "000000000000d03f",
    }
    says = "adatracker_deploy.testing.fake:to_wire"

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return fake_profile(FakeConnection(engage_s=2.0))


def engaged_fake() -> tuple[FakePlatform, FakeClock]:
    clock = FakeClock()
    platform = FakePlatform(fake_profile(), clock)
    platform.connect()
    platform.engage()
    return platform, clock


def test_a_pilot_who_takes_over_stops_it_for_good():
    platform, clock = engaged_fake()
    platform.take_over()
    assert "pilot" in platform.state().stopped
    with pytest.raises(PlatformError, match="pilot"):
        platform.send(ZERO, clock.now_ns())


def test_the_first_reason_for_a_stop_stays():
    platform, _ = engaged_fake()
    platform.hold("first")
    platform.hold("second")
    assert platform.state().stopped == "first"


def test_in_exact_time_it_runs_on_for_its_time_out_and_then_stops():
    platform, clock = engaged_fake()
    platform.send(Twist(vx=1.0), clock.now_ns())
    clock.advance(10.0)
    assert platform.state().pose.x == pytest.approx(0.5, abs=0.01)
    assert platform.state().velocity.vx == pytest.approx(0.0, abs=1e-3)


def test_it_remembers_everything_that_was_sent_and_a_last_zero():
    platform, clock = engaged_fake()
    platform.send(Twist(vx=0.3, vy=0.2), clock.now_ns())
    platform.hold("enough")
    assert platform.sent == [Twist(vx=0.3), ZERO]
