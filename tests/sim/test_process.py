"""A simulator's process: the world it is started in, and the orders over its stdin."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.config.effects import Effects
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Scenario
from adatracker_deploy.sim.process import FaultCommands, SimulatorProcess, add_arguments, given_scenario

ECHO = """
import argparse, dataclasses, sys
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.sim import add_arguments, announce_ready, given_scenario, parent_watchdog, refuse

parser = argparse.ArgumentParser()
add_arguments(parser)
args = parser.parse_args()
try:
    scenario = given_scenario(args)
except UsageError as error:
    sys.exit(refuse(error))
announce_ready(**dataclasses.asdict(scenario))
parent_watchdog(args).wait()
"""


def test_a_simulator_stands_in_the_world_of_the_rehearsal(tmp_path, monkeypatch):
    (tmp_path / "echo_simulator.py").write_text(ECHO, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    wanted = Scenario(
        scene="urban city",
        target_speed_m_s=1 / 3,
        seed=7,
        others=2,
        person="a.glb",
        width_px=160,
        effects=Effects(fog_m=33.3, road="C", sit=True),
    )
    with contextlib.closing(SimulatorProcess("echo_simulator", "echo")) as process:
        assert process.start(MonotonicClock(), wanted) == dataclasses.asdict(wanted)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("no JSON", "--scenario: Expecting value"),
        ("[]", "--scenario: expected a mapping"),
        ('{"scenes": "urban_city"}', "unknown key 'scenes'; did you mean 'scene'?"),
        ('{"target_speed_m_s": NaN}', "expected a finite number"),
        ('{"others": 21}', "expected 0 to 20"),
        ('{"effects": {"road": "E"}}', "--scenario: effects: road: expected one of"),
        ('{"effects": {"fog_m": 1}}', "expected an optical range"),
    ],
)
def test_a_world_that_cannot_be_is_refused(text, says):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    with pytest.raises(UsageError) as refused:
        given_scenario(parser.parse_args(["--scenario", text]))
    assert says in str(refused.value)


def test_faults_begin_and_end_and_every_listener_hears_of_it():
    orders, heard = FaultCommands(), []
    orders.listen(heard.append)
    for line in ("begin camera_gone\n", "begin link_drop", "end camera_gone", "end battery_low"):
        orders.handle(line)
    assert orders.faults == {"link_drop"}
    assert heard == [{"camera_gone"}, {"camera_gone", "link_drop"}, {"link_drop"}, {"link_drop"}]


def test_a_witness_writes_where_it_is_told(tmp_path):
    orders = FaultCommands()
    orders.witness.command(Twist(1.0))  # to nobody
    path = tmp_path / "with a space.txt"
    orders.handle(f"witness {path}\n")
    orders.witness.command(Twist(0.5))
    assert path.read_text().endswith(" command 0.5 0 0 0\n")
    orders.handle(f"witness {tmp_path}/no/such/folder\n")
    orders.witness.off()
    assert path.read_text().endswith(" off\n")


@given(st.text().filter(lambda text: not text.lstrip().startswith(("begin", "witness"))))
def test_other_orders_mean_nothing(line):
    orders = FaultCommands()
    orders.handle(line)
    assert orders.faults == frozenset()


def test_a_process_that_is_not_there_is_not_told():
    SimulatorProcess("no.such.module", "simulated nothing").order("begin link_drop")
