"""Turns of test files: one alone, others side by side."""

import multiprocessing
import time

from tests.alone import turn

HELD_S = 0.2


def hold(path, alone, name, told, ready):
    ready.wait()
    with turn(path, alone=alone):
        told.put((name, "begins", time.monotonic()))
        time.sleep(HELD_S)
        told.put((name, "ends", time.monotonic()))


def run(path, *kinds):
    """Let a process each ask for its turn at the same time, and return who began and ended, in order."""
    context = multiprocessing.get_context("spawn")
    told, ready = context.Queue(), context.Barrier(len(kinds))
    processes = []
    for name, alone in kinds:
        processes.append(context.Process(target=hold, args=(path, alone, name, told, ready)))
        processes[-1].start()
    moments = [told.get(timeout=30.0) for _ in range(2 * len(kinds))]
    for process in processes:
        process.join()
    return sorted(moments, key=lambda moment: moment[2])


def test_one_that_is_alone_is_beside_nobody(tmp_path):
    moments = run(tmp_path / "run", ("a", False), ("b", True), ("c", True), ("d", False))
    at = {(name, what): at_s for name, what, at_s in moments}
    for lonely in "bc":
        for other in set("abcd") - {lonely}:
            before = at[other, "ends"] <= at[lonely, "begins"]
            after = at[other, "begins"] >= at[lonely, "ends"]
            assert before or after, moments


def test_others_are_side_by_side(tmp_path):
    path = tmp_path / "run"
    with turn(path, alone=False), turn(path, alone=False):
        pass
