"""Opens a trial's camera: the robot's own, one with an address, or a rendered world."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.core.camera import OPEN_TIMEOUT_S, ROBOT, scene_of, without_password
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.live import NO_STAMPS, LiveCamera
from adatracker_deploy.perception.sources import open_source

if TYPE_CHECKING:
    import contextlib
    from collections.abc import Callable

    from adatracker_deploy.app.trial_plan import TrialPlan
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.perception.world_camera import WorldCamera


FIRST_PICTURE_S = 20.0
"""For a rehearsal's first picture. The process that draws it begins with the rehearsal, and on a slow or busy
computer, or after an installation, when all is compiled first, that takes longer than a camera may."""


def open_camera(  # noqa: PLR0917 -- each is another's, and all are needed
    plan: TrialPlan,
    profile: Profile,
    uri: str,
    clock: Clock,
    pose: Callable[[], Pose | None],
    tell: Callable[[str], None],
    stack: contextlib.ExitStack,
) -> Camera:
    """Open the camera at `uri` and check that its frames can be used.

    Args:
        plan: the trial's plan.
        profile: the robot's, as changed by its simulator.
        uri: the camera's address.
        clock: the run's.
        pose: returns the robot's reported pose, from which a virtual world is rendered.
        tell: receives progress messages and warnings.
        stack: closes the camera.

    Raises:
        UsageError: no such camera, or this segmenter cannot use its frames.
        PlatformError: the camera gives no frames.
    """
    if scene_of(uri) is not None:
        return _virtual_camera(plan, profile, pose, clock, stack)
    profile = replace(profile, camera=replace(profile.camera, uri=uri))

    def camera_there() -> Camera:
        if uri.startswith(ROBOT):
            return plan.platform.camera(profile, clock)
        return open_source(uri, clock)

    tell(f"opening the camera {without_password(uri)}")
    camera = opened(camera_there, stack, FIRST_PICTURE_S if plan.sitl else 0.0)
    if isinstance(camera, LiveCamera) and camera.hides_delay:
        tell(f"warning: camera {camera.name}: {NO_STAMPS}")
    if plan.segmenter.needs_truth:
        frame = camera.read(clock.now_ns())
        if frame is None or frame.truth is None:
            raise UsageError(
                f"camera {without_password(uri)}: gives pictures only, but this segmenter needs the ground "
                "truth that a rehearsal's camera sends: try --segmenter embedded"
            )
    return camera


def opened(make: Callable[[], Camera], stack: contextlib.ExitStack, patience_s: float) -> Camera:
    """Open a camera, which `stack` closes; one that is silent is opened again for `patience_s`.

    Raises:
        UsageError, PlatformError: as `Camera.open`.
    """
    end_s = time.monotonic() + patience_s
    while True:
        camera = make()
        stack.callback(camera.close)
        begun_s = time.monotonic()
        try:
            camera.open()
        except PlatformError:
            now_s = time.monotonic()
            if now_s - begun_s < OPEN_TIMEOUT_S or now_s > end_s:  # it said what is wrong, or had its time
                raise
        else:
            return camera


def virtual_person(plan: TrialPlan) -> str:
    """Warn that a real robot will follow a simulated person."""
    uri = plan.camera or plan.profile.camera.uri
    return (
        f"A REAL ROBOT WILL FOLLOW A VIRTUAL PERSON: its camera, {uri}, is drawn and does not see the "
        "real world; give the robot's own camera with --camera"
    )


def _virtual_camera(
    plan: TrialPlan,
    profile: Profile,
    pose: Callable[[], Pose | None],
    clock: Clock,
    stack: contextlib.ExitStack,
) -> WorldCamera:
    from adatracker_deploy.perception.world_camera import WorldCamera  # needs the world extra

    camera = WorldCamera(plan.scenario, profile.sitl.camera, pose, clock, profile.camera.rate_hz)
    stack.callback(camera.close)
    camera.open()
    return camera
