"""Speed of the drone's body, stepped at 250 Hz, against real time, and the cost of a fresh start.

    python benchmarks/flight_dynamics.py [--seconds 20] [--repeats 7]

Prints medians over the repeats: tails depend on the machine's other work.
"""

import argparse
import statistics
import time

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_drone.sim.autopilot import Autopilot
from adatracker_drone.sim.dynamics import STEP_S, DroneBody
from adatracker_drone.sim.settings import SitlSettings

COMMAND = Twist(vx=1.0, yaw_rate=0.5)


def seconds_of(work):
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def step_body(body, steps):
    for _ in range(steps):
        body.step(COMMAND, STEP_S)


def step_simulator(body, autopilot, steps):
    """Step body and autopilot and make every message, as the simulator's process does; nothing is sent."""
    for tick in range(1, steps + 1):
        demand = autopilot.step(body.motion, tick * STEP_S)
        body.step(Twist(demand.forward, -demand.right, -demand.down, -demand.yaw_rate), STEP_S)
        autopilot.transmit()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated time of a repeat")
    parser.add_argument("--repeats", type=int, default=7)
    args = parser.parse_args()
    steps = round(args.seconds / STEP_S)
    resets, bodies, simulators = [], [], []
    for seed in range(args.repeats):
        body = DroneBody()
        resets.append(seconds_of(lambda body=body, seed=seed: body.reset(Pose(z=5.0), seed)))
        bodies.append(seconds_of(lambda body=body: step_body(body, steps)))
        body.reset(Pose(z=5.0), seed)
        autopilot = Autopilot(SitlSettings(), seed)
        simulators.append(seconds_of(lambda a=autopilot, body=body: step_simulator(body, a, steps)))
    print(f"fresh start, hovering         {statistics.median(resets) * 1e3:8.1f} ms")
    for name, spent in (("body at 250 Hz", bodies), ("body + autopilot + telemetry", simulators)):
        median = statistics.median(spent)
        print(f"{name:29} {median / steps * 1e6:8.1f} us a step {args.seconds / median:8.0f} x real time")


if __name__ == "__main__":
    main()
