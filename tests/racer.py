"""A program that would like to have a robot, again and again: two of them race for it.

``python -m tests.racer PLATFORM CONNECTION.json [OPTION...]``; a line on stdin is a moment, ns of the
monotonic clock, at which it connects and engages. It answers ``owner`` or ``refused: WHY``, and lets go at
the next line, which it answers with ``free``. With ``--elsewhere`` it is on another machine, say claims. With
``--preflight`` it makes one before it engages, as a run does. With ``--connect-only`` it does not engage:
whose the robot is, is settled when it connects.
"""

import dataclasses
import importlib
import json
import sys
import time

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.registry import load_platform, load_profile
from tests.other_machine import OfAnotherMachine


def main(name, connection, *options):
    cls = load_platform(name)
    if "--elsewhere" in options:
        importlib.import_module(f"adatracker_{name}.adapter.transport").Claim = OfAnotherMachine
    profile = load_profile(cls.default_profile, cls)
    profile = dataclasses.replace(
        profile, connection=dataclasses.replace(profile.connection, **json.loads(connection))
    )
    clock = MonotonicClock()
    print("here", flush=True)
    for line in sys.stdin:
        with cls(profile, clock) as platform:
            clock_ns = int(line)
            while time.monotonic_ns() < clock_ns:
                time.sleep(0.0005)
            try:
                platform.connect()
                if "--preflight" in options:
                    platform.preflight()
                if "--connect-only" not in options:
                    platform.engage()
                print("owner", flush=True)
            except PlatformError as error:
                print(f"refused: {error}", flush=True)
            sys.stdin.readline()
        print("free", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
