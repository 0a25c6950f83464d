"""Turns of test files: two that compute, three that wait, or one alone."""

import multiprocessing
import time

import pytest

from tests.turns import Takes, turn

HELD_S = 0.2


def hold(path, takes, name, told, ready):
    ready.wait()
    with turn(path, takes):
        told.put((name, "begins", time.monotonic()))
        time.sleep(HELD_S)
        told.put((name, "ends", time.monotonic()))


def run(path, *kinds):
    """Let a process each ask for its turn at the same time, and return who began and ended, in order."""
    context = multiprocessing.get_context("spawn")
    told, ready = context.Queue(), context.Barrier(len(kinds))
    processes = []
    for name, takes in kinds:
        processes.append(context.Process(target=hold, args=(path, takes, name, told, ready)))
        processes[-1].start()
    moments = [told.get(timeout=30.0) for _ in range(2 * len(kinds))]
    for process in processes:
        process.join()
    return sorted(moments, key=lambda moment: moment[2])


def test_one_that_is_alone_is_beside_nobody(tmp_path):
    some, whole = Takes.WAITING, Takes.ALL
    moments = run(tmp_path / "run", ("a", some), ("b", whole), ("c", whole), ("d", some))
    at = {(name, what): at_s for name, what, at_s in moments}
    for lonely in "bc":
        for other in set("abcd") - {lonely}:
            before = at[other, "ends"] <= at[lonely, "begins"]
            after = at[other, "begins"] >= at[lonely, "ends"]
            assert before or after, moments


@pytest.mark.parametrize(("takes", "most"), [(Takes.COMPUTING, 2), (Takes.WAITING, 3)])
def test_no_more_are_side_by_side_than_the_machine_is_shared_by(tmp_path, takes, most):
    beside, seen = 0, []
    for _, what, _ in run(tmp_path / "run", *((name, takes) for name in "abcde")):
        beside += 1 if what == "begins" else -1
        seen.append(beside)
    assert max(seen) <= most


def test_as_many_are_side_by_side_as_the_machine_is_shared_by(tmp_path):
    path = tmp_path / "run"
    with turn(path, Takes.WAITING), turn(path, Takes.WAITING), turn(path, Takes.WAITING):
        pass
    with turn(path, Takes.COMPUTING), turn(path, Takes.COMPUTING):
        pass
