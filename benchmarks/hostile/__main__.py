"""A million hostile packets on each inbound wire: nothing crashes, nothing moves, nothing grows.

Each wire is flooded in a process of its own, with its adapter connected to the simulated robot and not
engaged. Memory is that of the side under attack, counted once the first thousand packets have filled what is
filled once (Zenoh alone keeps 20 MB of receive buffers for a session that was sent fragments). Afterwards the
robot must be heard again, engage and disengage, as if nothing had been.

python benchmarks/hostile [--packets 1000000] [--wire mavlink ...]
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor

from can_wire import flood_base
from flood import Result
from mavlink_wire import flood_drone, flood_drone_from_strangers, flood_signed_drone
from zenoh_wire import flood_host, flood_robot

LARGEST_GROWTH_KB = 20_000
WIRES = {
    "mavlink": ("MAVLink, from the autopilot's own address", flood_drone),
    "mavlink-strangers": ("MAVLink, from another address", flood_drone_from_strangers),
    "mavlink-signed": ("MAVLink signed, from the autopilot's address without the key", flood_signed_drone),
    "can": ("CAN (socketcand), host and base", flood_base),
    "zenoh-host": ("Zenoh, all that the host hears, camera too", flood_host),
    "zenoh-robot": ("Zenoh, commands of the simulated robot", flood_robot),
}


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--packets", type=int, default=1_000_000)
    arguments.add_argument("--wire", nargs="*", choices=WIRES, default=list(WIRES))
    asked = arguments.parse_args()
    print("| wire | packets | s | more memory, MB | ignored | verdict |\n|---|---|---|---|---|---|")
    sound = True
    for name in asked.wire:
        what, flood = WIRES[name]
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
            try:
                result = alone.submit(flood, asked.packets).result()
            except Exception as error:  # whatever it is, the other wires are flooded all the same
                result = Result(0.0, 0, "", (f"{type(error).__name__}: {error}",))
        faults = [*result.faults]
        if result.grown_kb > LARGEST_GROWTH_KB:
            faults.append(f"grew by more than {LARGEST_GROWTH_KB / 1000:g} MB")
        sound = sound and not faults
        print(
            f"| {what} | {asked.packets:,} | {result.seconds:.0f} | {result.grown_kb / 1000:.1f} "
            f"| {result.ignored} | {'; '.join(faults) or 'sound'} |",
            flush=True,
        )
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
