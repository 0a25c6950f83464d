"""Two programs that start at once for one robot: who got it, so many times over."""

import contextlib
import json
import subprocess
import sys
import time

_AHEAD_NS = 20_000_000


@contextlib.contextmanager
def _racer(name, connection, *options):
    command = [sys.executable, "-m", "tests.racer", name, json.dumps(connection), *options]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "here\n"
            yield process
        finally:
            process.stdin.close()
            process.wait(10.0)


def _tell(racer, line):
    racer.stdin.write(f"{line}\n")
    racer.stdin.flush()


def race(name, connection, *options, starts):
    """Start two programs `starts` times; return what the two said, each time.

    Args:
        name: of the platform.
        connection: changes of its shipped profile's, with which they reach the robot.
        options: ``--elsewhere`` for two machines, ``--preflight``, ``--connect-only``.
        starts: how often.
    """
    results = []
    with contextlib.ExitStack() as stack:
        racers = [stack.enter_context(_racer(name, connection, *options)) for _ in range(2)]
        for _ in range(starts):
            begin_ns = time.monotonic_ns() + _AHEAD_NS
            for racer in racers:
                _tell(racer, begin_ns)
            results.append(tuple(racer.stdout.readline().strip() for racer in racers))
            for racer in racers:
                _tell(racer, "let go")
            for racer in racers:
                assert racer.stdout.readline() == "free\n"
    return results


def owners(result):
    return [said for said in result if said == "owner"]
