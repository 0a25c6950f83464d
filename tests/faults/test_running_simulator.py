"""A simulator that outlives its runs is reached by a file, takes orders from each, and is its owner's."""

from __future__ import annotations

import dataclasses
import threading

import pytest

from adatracker_deploy.core.faults import LINK_DROP
from adatracker_deploy.faults.running_simulator import RunningSimulator, serving
from adatracker_deploy.platform import Scenario, Sitl
from adatracker_deploy.testing.fake import FakePlatform, fake_profile


class Ordered(Sitl):
    """A simulator that keeps what it is ordered."""

    faults = (LINK_DROP,)

    def __init__(self, profile):
        self.profile, self.orders, self.closed = profile, [], False
        self.news = threading.Condition()

    def start(self, clock, scenario):
        camera = dataclasses.replace(self.profile.camera, uri="http://127.0.0.1:4711/stream")
        return dataclasses.replace(self.profile, camera=camera)

    def order(self, line):
        with self.news:
            self.orders.append(line)
            self.news.notify_all()

    def close(self):
        self.closed = True


@pytest.mark.timeout(30)
def test_two_runs_meet_the_same_robot(tmp_path, monkeypatch):
    profile = fake_profile()
    simulator = Ordered(profile)
    monkeypatch.setattr(FakePlatform, "sitl", lambda _: simulator)
    with serving(FakePlatform, profile, Scenario(), tmp_path) as (file, witness):
        for number in (1, 2):
            with RunningSimulator(file, FakePlatform, profile) as run:
                assert run.start(None, Scenario()).camera.uri == "http://127.0.0.1:4711/stream"
                assert (run.faults, run.witness) == ((LINK_DROP,), witness)
                run.order(f"begin {number}")
            with simulator.news:
                assert simulator.news.wait_for(
                    lambda number=number: f"begin {number}" in simulator.orders, 10
                )
        assert not simulator.closed
    assert simulator.closed
    assert simulator.orders == [f"witness {witness.resolve()}", "begin 1", "begin 2"]
