"""Speed of the world: masks, images and whole environment steps, on one core.

Run with ``python benchmarks/world.py``; prints one line a figure.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import CameraMount
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody
from adatracker_deploy.sim.studio import Eye
from adatracker_deploy.sim.task import Task, TaskSettings

FOV_RAD = math.pi / 2


def median_ms(call: Callable[[], object], times: int) -> float:
    taken = []
    for _ in range(times):
        begin = time.perf_counter()
        call()
        taken.append(time.perf_counter() - begin)
    return 1e3 * statistics.median(taken)


def rendering(scene: str) -> None:
    world = World(scene, seed=0, others=2)
    camera = world.start @ Pose(z=1.0)
    small = median_ms(lambda: world.render_mask(camera, FOV_RAD, 64, 64), 200)
    mask = median_ms(lambda: world.render_mask(camera, FOV_RAD, 160, 160), 50)
    image = median_ms(lambda: world.render(camera, FOV_RAD, 160, 160), 20)
    print(f"{scene:14s} mask 64x64 {small:6.2f} ms   160x160 {mask:6.2f} ms   image 160x160 {image:6.2f} ms")


def picture(scene: str) -> None:
    """A picture of five people for segmenters, 640x480: drawing alone, and with camera, JPEG and truth."""
    world = World(scene, seed=3, others=4)
    eye = Eye(world, FOV_RAD, seed=3)
    drawing, taking = [], []
    for seq in range(120):
        world.step(0.05)
        x, y = world.target_xy
        camera = Pose(x - 2.5, y, world.ground_z(x - 2.5, y) + 1.0)
        drawing.append(median_ms(lambda at=camera: world.picture(at, FOV_RAD, 480, 640), 1))
        taking.append(median_ms(lambda at=camera, k=seq: eye.take(k * 50_000_000, k, at, at), 1))
    drawn, taken = statistics.median(drawing[20:]), statistics.median(taking[20:])
    print(f"{scene:14s} five people in 640x480: drawn in {drawn:5.1f} ms, taken in {taken:5.1f} ms")


def environment(*, obstacles: bool, others: int, steps: int = 500) -> None:
    world = World("simple_room", seed=0, path="random_walk", obstacles=obstacles, others=others)
    drive = DriveSettings(camera=CameraMount(up_m=1.0), lag_s=0.2, delay_s=0.1)
    task = Task(world, KinematicBody(drive), TaskSettings(steps=steps))
    task.begin(seed=0)
    begin = time.perf_counter()
    while not task.step(_follow(task)).end:
        pass
    rate = steps / (time.perf_counter() - begin)
    content = "obstacles" if obstacles else "an empty room"
    print(f"environment with {content} and {others} other people: {rate:.0f} steps/s")


def _follow(task: Task) -> Twist:
    pose, target = task.body.pose, task.world.target_xy
    return Twist(vx=pose.distance_to(*target) - 2.5, yaw_rate=3.0 * pose.bearing_to(*target))


if __name__ == "__main__":
    build = median_ms(lambda: World("simple_room", seed=0, others=2), 10)
    print(f"building simple_room: {build:.1f} ms")
    for name in scene_names():
        rendering(name)
        picture(name)
    environment(obstacles=False, others=0)
    environment(obstacles=True, others=2)
