"""A unit's watchdog hears the link, and nobody else: through a real socket, as systemd's."""

from __future__ import annotations

import os
import signal
import socket

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.service_watchdog import PERIOD_VARIABLE, SOCKET_VARIABLE, ServiceWatchdog
from adatracker_deploy.testing.fake import FakePlatform, fake_profile

pytestmark = pytest.mark.slow

PERIOD_US = 400_000
BEGUN = f"READY=1\nWATCHDOG_USEC={PERIOD_US}\nWATCHDOG=1"


class Manager:
    """Hears notifications as systemd does; `silent_s` without any is None."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(path)
        self.environment = {
            SOCKET_VARIABLE: f"@{path[1:]}" if path.startswith("\0") else path,
            PERIOD_VARIABLE: str(PERIOD_US),
        }

    def heard(self, silent_s):
        self.socket.settimeout(silent_s)
        try:
            return self.socket.recv(4096).decode()
        except (TimeoutError, BlockingIOError):
            return None


@pytest.fixture(params=["file", "abstract"])
def manager(request, tmp_path):
    path = str(tmp_path / "notify") if request.param == "file" else f"\0adatracker-test-{os.getpid()}"
    manager = Manager(path)
    yield manager
    manager.socket.close()


def test_it_is_fed_four_times_in_a_period_and_rests_between_trials(manager):
    now_s = 100.0
    watchdog = ServiceWatchdog(manager.environment, lambda: now_s)
    watchdog.begin()
    assert manager.heard(1) == BEGUN
    fed = 0
    for _ in range(50):  # a second of the link's slots
        watchdog.feed()
        fed += manager.heard(0) == "WATCHDOG=1"
        now_s += 0.02
    assert fed in (9, 10)  # every fifth slot, or by rounding the sixth
    watchdog.rest()
    assert manager.heard(1) == "WATCHDOG_USEC=86400000000\nWATCHDOG=1"
    watchdog.feed()
    watchdog.rest()
    assert manager.heard(0) is None


def test_a_unit_without_a_watchdog_is_told_that_the_robot_is_connected_and_no_more(manager):
    del manager.environment[PERIOD_VARIABLE]
    watchdog = ServiceWatchdog(manager.environment)
    watchdog.begin()
    assert manager.heard(1) == "READY=1"
    watchdog.feed()
    watchdog.rest()
    assert manager.heard(0) is None


@pytest.mark.parametrize("environment", [{}, {SOCKET_VARIABLE: "/nowhere", PERIOD_VARIABLE: "1000"}])
def test_without_systemd_nothing_happens(environment):
    watchdog = ServiceWatchdog(environment)
    for step in (watchdog.begin, watchdog.feed, watchdog.rest):
        step()


def test_a_manager_that_does_not_listen_does_not_hold_the_link_up(manager):
    watchdog = ServiceWatchdog(manager.environment | {PERIOD_VARIABLE: "1"})
    for _ in range(10_000):  # far more than its socket holds
        watchdog.feed()
    assert manager.heard(1) == "WATCHDOG=1"


def test_the_links_own_process_feeds_it_until_it_is_frozen(manager, monkeypatch):
    for name, value in manager.environment.items():
        monkeypatch.setenv(name, value)
    with LinkProcess(FakePlatform, fake_profile(), MonotonicClock()) as link:
        link.connect()
        assert manager.heard(10) == BEGUN
        assert [manager.heard(10) for _ in range(8)] == ["WATCHDOG=1"] * 8
        os.kill(link.pid, signal.SIGSTOP)
        while manager.heard(0):
            pass  # what it said before
        assert manager.heard(3 * PERIOD_US / 1e6) is None
        os.kill(link.pid, signal.SIGCONT)
        assert manager.heard(10) == "WATCHDOG=1"
    said = []
    while word := manager.heard(0):
        said.append(word)
    assert said[-1].startswith("WATCHDOG_USEC=86400000000")


class Unreachable(FakePlatform):
    def connect(self):
        raise PlatformError("nobody answers")


def test_a_link_that_does_not_reach_its_robot_does_not_say_that_it_is_ready(manager, monkeypatch):
    for name, value in manager.environment.items():
        monkeypatch.setenv(name, value)
    with (
        LinkProcess(Unreachable, fake_profile(), MonotonicClock()) as link,
        pytest.raises(PlatformError, match="nobody answers"),
    ):
        link.connect()
    assert manager.heard(0) is None
