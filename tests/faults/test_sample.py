"""The everyday sample covers what it says it covers, of all shipped robots, the same way each time."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from adatracker_deploy.cli import extras, faults, main
from adatracker_deploy.faults.matrix import ROWS
from adatracker_deploy.faults.sample import FOUND, Cell, sampled

SAFETY = Path(__file__).parents[2] / "docs" / "safety.md"
ONE_KIND = {
    "interrupt": "operator",
    "terminate": "operator",
    "hangup": "operator",
    "tracker_kill": "tracker",
    "tracker_stop": "tracker",
    "link_kill": "link",
    "link_stop": "link",
}
THE_TOOLKITS = {
    *ONE_KIND,
    *("camera_freeze", "camera_gone", "cpu_hogs", "disk_full", "gc_pause", "policy_hang", "policy_inf"),
    *("policy_nan", "segmenter_error", "segmenter_stall", "suspend", "action_jump", "battery_low"),
}
"""Faults that the same code meets whatever the robot."""


@pytest.fixture(scope="module")
def cells():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(extras, "installed", lambda _: True)  # no robot's library is needed to know its rows
        return [cell for robot in faults._robots(None) for cell in faults._cells(robot)]


def each(cells, what):
    return {what(cell) for cell in cells}


@pytest.mark.parametrize(
    "what",
    [
        lambda cell: cell.row.fault not in THE_TOOLKITS and (cell.platform, cell.row.fault),
        lambda cell: (cell.flies, ONE_KIND.get(cell.row.fault)),
        lambda cell: cell.row.fault,
        lambda cell: (cell.platform, cell.row.phase),
        lambda cell: cell.row.again,
        lambda cell: cell.row.name in FOUND and cell.row.name,
    ],
    ids=["robot, fault", "flies, kind", "faults", "robot, phase", "second runs", "found"],
)
def test_the_sample_has_each(cells, what):
    assert each(sampled(cells), what) == each(cells, what)


def test_the_sample_is_about_a_quarter_in_the_matrix_order_and_the_same_each_time(cells):
    sample = sampled(cells)
    assert len(sample) < 0.28 * len(cells)
    assert [cell for cell in cells if cell in sample] == sample
    assert sampled(list(cells)) == sample


def test_the_page_says_how_many_rows_it_has(cells):
    (told,) = re.findall(r"`--sample`, (\d+) of (\d+) rows", SAFETY.read_text())
    assert tuple(map(int, told)) == (len(sampled(cells)), len(cells))


def test_a_fault_of_the_toolkits_own_code_is_drawn_on_a_ground_robot():
    names = ("policy_nan", "policy_inf", "disk_full")
    ground, flying = (
        [Cell(name, replace(ROWS[0], fault=fault), flies) for fault in names]
        for name, flies in (("base", False), ("drone", True))
    )
    sample = sampled([*flying, *ground])
    assert [cell.platform for cell in sample].count("drone") == 1  # for the phase
    assert each(sample, lambda cell: cell.row.fault) == {*names}


def test_the_command_runs_of_a_robot_what_the_sample_of_all_has(monkeypatch, capsys):
    jobs = []
    monkeypatch.setattr(faults, "_run_all", lambda run, *_: jobs.append(len(run)) or [])
    assert main(["faults", "--platform", "wheeled", "--phase", "stopping"]) == 0
    assert main(["faults", "--platform", "wheeled", "--phase", "stopping", "--sample"]) == 0
    whole, sample = jobs
    assert 0 < sample < whole
