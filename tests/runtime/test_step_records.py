"""A step's record is of one tick: what was asked, what was sent for it, and where its time went."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adatracker_deploy.core.messages import ZERO, Action, Twist
from adatracker_deploy.runtime.link import Acted, Phase
from adatracker_deploy.runtime.phase import WAIT
from tests.runtime.loop_in_memory import FLYING, INFO, STEPS, Rehearsal


class Wired(Rehearsal):
    """Its link judges every set-point 5 ms after it came and sends half of it within 2 ms more."""

    def send(self, setpoint):
        super().send(setpoint)
        judged_ns = self.clock.now_ns() + 5_000_000
        acted = Acted(setpoint.t_ns, judged_ns, judged_ns + 2_000_000)
        twist = setpoint.twist
        half = Twist(vx=twist.vx / 2, yaw_rate=twist.yaw_rate / 2)
        self.status_now = replace(FLYING, sent=half, reasons=(f"tick {self.tick}",), acted=acted)

    def act(self, observation):
        super().act(observation)
        return Action(np.array([self.tick / 1000, 0.0], np.float32))


def test_each_step_says_where_its_time_went_from_the_sensor_to_the_wire():
    rehearsal = Wired(stall_s=0.003)
    rehearsal.run()
    latency = rehearsal.records[3].latency
    ways = (latency.capture_ms, latency.perceive_ms, latency.wait_ms, latency.infer_ms)
    assert ways == pytest.approx((4.0, 9.0, 7.0, 3.0))
    assert latency.sensor_to_command_ms == pytest.approx(sum(ways))
    assert (latency.gate_ms, latency.send_ms) == pytest.approx((5.0, 2.0))
    assert latency.sensor_to_wire_ms == pytest.approx(latency.sensor_to_command_ms + 7.0)


def test_a_tick_that_waited_for_its_observation_begins_when_that_is_ready():
    at_once, waiting = Wired(), Wired(waited_s=0.006, age_s=0.013)
    at_once.run()
    waiting.run()
    first, second = at_once.records[3], waiting.records[3]
    assert second.t_ns - first.t_ns == pytest.approx(6e6, abs=3e6)  # the slots, too, come a little later
    assert second.latency.wait_ms == pytest.approx(0.0)
    assert second.latency.lateness_ms == first.latency.lateness_ms
    assert waiting.patience_s == pytest.approx(WAIT / INFO.rate_hz)


def test_a_record_is_one_ticks_what_was_asked_and_what_was_sent_for_it():
    rehearsal = Wired()
    rehearsal.run()
    assert [record.step for record in rehearsal.records] == list(range(STEPS + 1))
    for record in rehearsal.records:
        assert record.sent.vx == pytest.approx(record.command.vx / 2)
        assert record.gate == (f"tick {record.step}",)


def test_what_stopped_the_robot_stands_in_the_record_of_the_command_that_it_forestalled():
    stop = replace(FLYING, phase=Phase.HOLDING, stopped="not_finite", reasons=("not_finite",))
    rehearsal = Rehearsal(at={5: {"status_now": stop}})  # as the sixth tick's observation is taken
    rehearsal.run()
    assert [record.step for record in rehearsal.records] == [0, 1, 2, 3, 4, 5]
    assert (rehearsal.records[-1].sent, rehearsal.records[-1].gate) == (ZERO, ("not_finite",))


class FilmOver(Exception): ...


def test_whatever_ends_the_loop_every_tick_that_was_driven_is_written():
    rehearsal = Wired()
    observe = rehearsal.observe

    def until_the_film_is_over(patience_s):
        if rehearsal.tick == 7:
            raise FilmOver
        return observe(patience_s)

    rehearsal.observe = until_the_film_is_over
    with pytest.raises(FilmOver):
        rehearsal.run()
    assert [record.step for record in rehearsal.records] == list(range(8))
    assert rehearsal.records[-1].sent.vx == pytest.approx(rehearsal.records[-1].command.vx / 2)
