"""Opens a trial's camera: the robot's own, one with an address, or a rendered world."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.core.camera import ROBOT, scene_of, without_password
from adatracker_deploy.core.errors import UsageError
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
    camera = plan.platform.camera(profile, clock) if uri.startswith(ROBOT) else open_source(uri, clock)
    tell(f"opening the camera {without_password(uri)}")
    stack.callback(camera.close)
    camera.open()
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
