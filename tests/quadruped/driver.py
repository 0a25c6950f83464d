"""A host of its own: walks a robot forward, then ends in the way it is told; it closes nothing.

``python -m tests.quadruped.driver ENDPOINT drive|raise|forget``; it prints a line when the robot walks.
"""

import contextlib
import sys

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.platform import QuadrupedPlatform
from tests.driving import send_for
from tests.quadruped.rehearsal import rehearsed, speed

WALKING_M_S = 0.9
TRIES = 300


def main(endpoint, ending):
    platform = QuadrupedPlatform(rehearsed(endpoint=endpoint), MonotonicClock())
    platform.connect()
    for _ in range(TRIES):
        with contextlib.suppress(PlatformError):  # a busy machine has late odometry: a stop, rightly
            platform.engage()
            send_for(platform, Twist(vx=1.0), 0.1)
        if speed(platform) > WALKING_M_S:
            break
    else:
        sys.exit("it does not walk")
    print("walking", flush=True)
    if ending == "drive":
        send_for(platform, Twist(vx=1.0), 60.0)
    if ending == "raise":
        raise RuntimeError("something else went wrong")


if __name__ == "__main__":
    main(*sys.argv[1:])
