"""One inheritable suite that says what every robot must do: each promise of `Platform` is one test.

A robot's tests inherit it and fly, drive or walk through the robot's own SITL, over its real wire::

    from adatracker_deploy.testing.conformance import PlatformConformance

    class TestMyRobot(PlatformConformance):
        platform_class = MyRobotPlatform
        clock_speed = 5.0  # how fast the simulator can be rehearsed

        manual = {Twist(vx=0.5): "52 51 02 00 f4 01 00 00"}  # by the vendor's manual, typed in by hand
        says = "my_robot.wire:encode_request"  # what makes, or takes, the bytes that go out

The simulator starts once for the class; every test gets a new adapter and leaves the robot disengaged.
Override the fixture `profile` to use another one than the robot ships, and the class variables to describe a
slow or a noisy robot. Needs pytest; nothing else in the toolkit does.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import threading
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import pytest

from adatracker_deploy.config.profile import Profile
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.faults import ROBOT_SILENT
from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.platform import Platform, Scenario, Sitl
from adatracker_deploy.registry import load_profile
from adatracker_deploy.testing.driving import SEND_PERIOD_S, distance, drive, every, pose, speed
from adatracker_deploy.testing.manual import AgainstTheManual

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

STOPS: dict[str, Callable[[Platform], None]] = {
    "hold": lambda platform: platform.hold("the test says so"),
    "disengage": lambda platform: platform.disengage(),
    "close": lambda platform: platform.close(),
}


class PlatformConformance(AgainstTheManual):
    """Inherit this, call it ``Test...`` and set `platform_class`."""

    platform_class: ClassVar[type[Platform]]
    clock_speed: ClassVar[float] = 1.0
    cruise_m_s: ClassVar[float] = 0.5
    turn_rad_s: ClassVar[float] = 0.5
    still_m_s: ClassVar[float] = 0.2
    """A robot whose estimated place moves by less than this in a second stands still."""
    patience_s: ClassVar[float] = 20.0
    """Machine time after which a robot that should have come to rest, or answered, has failed."""
    silence_s: ClassVar[float] = 2.0
    """Machine time after which a robot that tells nothing must have been stopped."""
    body_height_m: ClassVar[float] = 0.0
    """Height of the body's origin when it stands or hovers."""

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls) -> Profile:
        """Return the profile of the robot under test, by default the one it ships."""
        return load_profile(cls.platform_class.default_profile, cls.platform_class)

    @pytest.fixture(scope="class")
    @classmethod
    def clock(cls) -> MonotonicClock:
        """Return the clock that the simulator and the adapters share."""
        return MonotonicClock(speed=cls.clock_speed)

    @pytest.fixture(scope="class")
    @classmethod
    def sitl(cls, profile: Profile) -> Iterator[Sitl]:
        """Give the robot's SITL; end it after the class."""
        with cls.platform_class.sitl(profile) as sitl:
            yield sitl

    @pytest.fixture(scope="class")
    @classmethod
    def simulator(cls, sitl: Sitl, clock: MonotonicClock) -> Profile:
        """Start the robot's SITL; return the profile that reaches it."""
        return sitl.start(clock, Scenario(seed=1, width_px=160))  # whose pictures nobody looks at

    @pytest.fixture
    def platform(self, simulator: Profile, clock: MonotonicClock) -> Iterator[Platform]:
        """Give a new adapter; leave its robot at rest."""
        platform = self.platform_class(simulator, clock)
        yield platform
        with contextlib.suppress(PlatformError):
            platform.disengage()
        platform.close()

    @pytest.fixture
    def engaged(self, platform: Platform) -> Platform:
        """Give an adapter that has engaged."""
        platform.connect()
        refused = [check for check in platform.preflight() if check.blocking and not check.ok]
        assert not refused, refused
        platform.engage()
        return platform

    def test_it_is_described_by_frozen_typed_sections(self, profile: Profile) -> None:
        """The profile's two sections are the classes that the platform names, and cannot be changed."""
        for section, cls in (
            (profile.connection, self.platform_class.Connection),
            (profile.sitl, self.platform_class.SitlSettings),
        ):
            assert isinstance(section, cls)
            assert cls.__dataclass_params__.frozen
        assert profile.platform == self.platform_class.name
        assert self.platform_class.axes <= {field.name for field in dataclasses.fields(Twist)}

    def test_an_adapter_that_is_not_connected_says_so(self, platform: Platform) -> None:
        """Before `connect` the state is empty and infinitely old, and nothing can be asked of the robot."""
        state = platform.state()
        assert not state.engaged
        assert state.age_s(platform.clock.now_ns()) == math.inf
        for ask in (
            platform.preflight,
            platform.engage,
            lambda: platform.send(ZERO, platform.clock.now_ns()),
        ):
            with pytest.raises(PlatformError):
                ask()

    def test_the_preflight_passes_and_explains_itself(self, platform: Platform) -> None:
        """A robot in SITL is fit to engage, and every check says what was found."""
        platform.connect()
        checks = platform.preflight()
        assert checks
        assert all(check.name and check.message and "\n" not in check.message for check in checks)
        assert not [check for check in checks if check.blocking and not check.ok]

    def test_nothing_moves_before_engage(self, platform: Platform) -> None:
        """Connecting, checking and refused commands leave the robot where it is."""
        platform.connect()
        platform.preflight()
        before = platform.state().pose
        for _ in every(platform, SEND_PERIOD_S, 2.0):
            with pytest.raises(PlatformError):
                platform.send(Twist(vx=self.cruise_m_s), platform.clock.now_ns())
        assert not platform.state().engaged
        assert distance(before, platform.state().pose) < self.still_m_s

    def test_commands_are_followed_in_the_frame_of_rep_103(self, engaged: Platform) -> None:
        """Forward goes where the nose points, and a positive yaw rate turns counter-clockwise."""
        assert engaged.state().engaged
        before = pose(engaged)
        drive(engaged, Twist(vx=self.cruise_m_s), 4.0)
        after = pose(engaged)
        assert before.distance_to(after.x, after.y) > 2.0 * self.cruise_m_s
        assert abs(before.bearing_to(after.x, after.y)) < 0.5
        drive(engaged, ZERO, 1.0)
        heading = pose(engaged).yaw
        drive(engaged, Twist(yaw_rate=self.turn_rad_s), 2.0)
        assert wrap_angle(pose(engaged).yaw - heading) > self.turn_rad_s

    def test_send_returns_what_was_sent(self, engaged: Platform) -> None:
        """An axis that the robot has no use for comes back as 0; forward and yaw as the wire rounds them."""
        sent = engaged.send(Twist(vx=self.cruise_m_s, vy=0.1, vz=0.0, yaw_rate=0.2), engaged.clock.now_ns())
        assert (sent.vx, sent.yaw_rate) == pytest.approx((self.cruise_m_s, 0.2), rel=0.05)
        for axis in {field.name for field in dataclasses.fields(Twist)} - self.platform_class.axes:
            assert getattr(sent, axis) == 0.0

    def test_a_command_that_is_not_finite_is_refused_and_moves_nothing(self, engaged: Platform) -> None:
        """NaN and infinity raise; the robot stays where it is and still takes good commands."""
        drive(engaged, ZERO, 1.0)
        before = engaged.state().pose
        for _ in every(engaged, SEND_PERIOD_S, 1.0):
            for axis in ("vx", "vy", "vz", "yaw_rate"):
                for value in (math.nan, math.inf, -math.inf):
                    with pytest.raises(PlatformError):
                        engaged.send(Twist(**{axis: value}), engaged.clock.now_ns())
            engaged.send(ZERO, engaged.clock.now_ns())
        assert engaged.state().engaged
        assert distance(before, engaged.state().pose) < self.still_m_s

    def test_state_never_blocks_and_tells_its_age(self, engaged: Platform) -> None:
        """Reading the state takes no time, also while a command goes out, and it is never from the future."""
        took_ns, ages_s, seen = [], [], set()
        machine = MonotonicClock()
        sending = threading.Thread(target=drive, args=(engaged, ZERO, 6.0))
        sending.start()
        while sending.is_alive():
            machine.sleep_until(machine.now_ns() + 10_000_000)
            begin_ns = machine.now_ns()
            state = engaged.state()
            took_ns.append(machine.now_ns() - begin_ns)
            ages_s.append(state.age_s(engaged.clock.now_ns()) / engaged.clock.speed)
            seen.add(state.t_ns)
        sending.join()
        assert sorted(took_ns)[len(took_ns) * 3 // 4] < 8_000_000
        assert min(ages_s) >= 0
        assert sorted(ages_s)[len(ages_s) * 9 // 10] < 0.2
        assert len(seen) > 10

    def test_a_robot_that_fell_silent_and_is_heard_again_stays_stopped(
        self, sitl: Sitl, engaged: Platform
    ) -> None:
        """Losing telemetry stops the robot; its return does not start it, only an explicit engage does."""
        assert ROBOT_SILENT in sitl.faults, f"let the simulator obey {ROBOT_SILENT.name}: docs/add-a-robot.md"
        cruise = Twist(vx=self.cruise_m_s)
        drive(engaged, cruise, 1.0)
        sitl.order(f"begin {ROBOT_SILENT.name}")
        try:
            with pytest.raises(PlatformError):
                drive(engaged, cruise, self.silence_s * engaged.clock.speed)
            silent_ns = engaged.state().t_ns
        finally:
            sitl.order(f"end {ROBOT_SILENT.name}")
        machine = MonotonicClock()
        give_up_ns = machine.now_ns() + round(self.patience_s * 1e9)
        while engaged.state().t_ns == silent_ns:
            assert machine.now_ns() < give_up_ns, "the robot was never heard again"
            machine.sleep_until(machine.now_ns() + 10_000_000)
        for _ in every(engaged, SEND_PERIOD_S, 1.0):
            with pytest.raises(PlatformError):
                engaged.send(cruise, engaged.clock.now_ns())
        assert not engaged.state().engaged
        assert engaged.state().stopped
        self._comes_to_rest(engaged, "silence of the robot")

    def test_hold_latches_until_an_explicit_engage(self, engaged: Platform) -> None:
        """After `hold` the robot comes to rest, refuses commands and says why; `engage` starts it again."""
        drive(engaged, Twist(vx=self.cruise_m_s), 2.0)
        engaged.hold("somebody shouted")
        state = engaged.state()
        assert not state.engaged
        assert "somebody shouted" in state.stopped
        self._comes_to_rest(engaged, "hold")
        for _ in every(engaged, SEND_PERIOD_S, 1.0):
            with pytest.raises(PlatformError):
                engaged.send(Twist(vx=self.cruise_m_s), engaged.clock.now_ns())
        assert speed(engaged) < self.still_m_s
        assert engaged.state().stopped
        engaged.engage()
        assert not engaged.state().stopped
        before = pose(engaged)
        drive(engaged, Twist(vx=self.cruise_m_s), 3.0)
        after = pose(engaged)
        assert before.distance_to(after.x, after.y) > self.cruise_m_s

    def test_a_silent_sender_is_stopped_by_the_robots_own_time_out(self, engaged: Platform) -> None:
        """The robot comes to rest by itself when set-points stop coming and nothing else is sent."""
        drive(engaged, Twist(vx=self.cruise_m_s), 2.0)
        self._comes_to_rest(engaged, "silence")

    def test_disengage_ends_at_rest_on_the_ground(self, engaged: Platform) -> None:
        """After `disengage` the robot stands, and takes no command."""
        drive(engaged, Twist(vx=self.cruise_m_s), 1.0)
        engaged.disengage()
        assert engaged.state().landed
        assert not engaged.state().engaged
        assert speed(engaged) < self.still_m_s
        with pytest.raises(PlatformError):
            engaged.send(ZERO, engaged.clock.now_ns())

    @pytest.mark.parametrize("connected", [False, True])
    @pytest.mark.parametrize("stop", STOPS)
    def test_a_robot_that_never_engaged_can_be_stopped_twice(
        self, platform: Platform, connected: bool, stop: str
    ) -> None:
        """Every stop is safe when there is nothing to stop."""
        if connected:
            platform.connect()
        STOPS[stop](platform)
        STOPS[stop](platform)
        assert not platform.state().engaged

    @pytest.mark.parametrize(
        "order",
        [
            ("hold", "disengage", "close"),
            ("disengage", "hold", "close"),
            ("close", "disengage", "hold"),
        ],
        ids="-".join,
    )
    def test_an_engaged_robot_can_be_stopped_in_any_order_and_twice(
        self, engaged: Platform, order: tuple[str, ...]
    ) -> None:
        """After any first stop the others are allowed, and nothing starts it again."""
        for stop in order:
            for _ in range(2):
                STOPS[stop](engaged)
                assert not engaged.state().engaged
                with pytest.raises(PlatformError):
                    engaged.send(ZERO, engaged.clock.now_ns())

    @pytest.mark.parametrize("stop", STOPS)
    def test_a_stop_from_another_thread_ends_an_engage(self, platform: Platform, stop: str) -> None:
        """`engage` gives up soon after any stop, and the robot is not engaged."""
        platform.connect()
        platform.preflight()
        errors: list[BaseException] = []

        def engage() -> None:
            try:
                platform.engage()
            except BaseException as error:
                errors.append(error)

        engaging = threading.Thread(target=engage)
        engaging.start()
        platform.clock.sleep_until(platform.clock.now_ns() + 300_000_000)  # any moment will do
        STOPS[stop](platform)
        engaging.join(self.patience_s)
        assert not engaging.is_alive()
        assert all(isinstance(error, PlatformError) for error in errors)
        assert not platform.state().engaged
        with pytest.raises(PlatformError):
            platform.send(ZERO, platform.clock.now_ns())

    def test_close_lets_go_of_the_wire_and_of_its_threads(
        self, simulator: Profile, clock: MonotonicClock
    ) -> None:
        """A closed adapter is in nobody's way: the next one connects, and no thread is left over."""
        threads = []
        for _ in range(3):
            platform = self.platform_class(simulator, clock)
            platform.connect()
            platform.close()
            threads.append(_thread_count())
        machine = MonotonicClock()
        give_up_ns = machine.now_ns() + 10_000_000_000
        while _thread_count() > threads[0] and machine.now_ns() < give_up_ns:
            machine.sleep_until(machine.now_ns() + 1_000_000)  # a joined thread takes a moment to vanish
        assert _thread_count() <= threads[0]

    def test_the_body_is_deterministic_by_seed(self, profile: Profile) -> None:
        """The same seed and commands give bit-equal poses, also of a body that was used before."""
        used = self.platform_class.body(profile)
        used.reset(Pose(x=3.0, z=self.body_height_m), seed=1)
        used.step(Twist(vx=self.cruise_m_s), 0.1)
        tracks = []
        for body in (self.platform_class.body(profile), used):
            body.reset(Pose(x=1.0, z=self.body_height_m, yaw=0.5), seed=7)
            track = []
            for tick in range(40):
                body.step(Twist(vx=self.cruise_m_s, yaw_rate=self.turn_rad_s * (tick % 3)), 0.05)
                track.append((body.pose, body.camera_pose, body.velocity))
            tracks.append(track)
        assert tracks[0] == tracks[1]

    def test_the_body_follows_commands_from_where_it_was_put(self, profile: Profile) -> None:
        """It stays without a command, and goes where its nose points with one."""
        body = self.platform_class.body(profile)
        start = Pose(x=2.0, y=-1.0, z=self.body_height_m, yaw=2.0)
        body.reset(start, seed=3)
        assert body.pose.distance_to(start.x, start.y) < 0.05
        for _ in range(40):
            body.step(ZERO, 0.05)
        assert body.pose.distance_to(start.x, start.y) < 0.5
        begin = body.pose
        for _ in range(80):
            body.step(Twist(vx=self.cruise_m_s), 0.05)
        assert body.velocity.vx == pytest.approx(self.cruise_m_s, rel=0.3)
        assert begin.distance_to(body.pose.x, body.pose.y) > 2.0 * self.cruise_m_s
        assert abs(begin.bearing_to(body.pose.x, body.pose.y)) < 0.5

    def _comes_to_rest(self, platform: Platform, why: str) -> None:
        """Wait until the robot stands still; print how long that took and how far it went."""
        machine = MonotonicClock()
        start_ns, start = machine.now_ns(), pose(platform)
        while (rolled_m_s := speed(platform)) >= self.still_m_s:
            waited_s = (machine.now_ns() - start_ns) / 1e9
            assert waited_s < self.patience_s, f"{why}: still at {rolled_m_s:.2f} m/s after {waited_s:.0f} s"
        took_s = (machine.now_ns() - start_ns) / 1e9 * platform.clock.speed
        print(f"{why}: at rest within {took_s:.1f} s and {distance(start, pose(platform)):.2f} m")


def _thread_count() -> int:
    """Count the threads of this process, those that Python did not start among them where that is known."""
    tasks = Path("/proc/self/task")
    return len(list(tasks.iterdir())) if tasks.is_dir() else threading.active_count()
