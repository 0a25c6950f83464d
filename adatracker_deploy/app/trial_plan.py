"""The plan of a trial: all that it needs, decided and checked before it begins."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.camera import without_password
from adatracker_deploy.runtime.scheduling import ORDINARY, Scheduling

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera_info import CameraInfo
    from adatracker_deploy.faults.schedule import ScheduledFault
    from adatracker_deploy.page.address import Address
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.platform import Platform, Scenario, Sitl
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.runtime.start_line import StartLine
    from adatracker_deploy.trial.privacy import Frames


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialPlan:
    """Everything a trial needs, already checked."""

    name: str = ""
    """The robot's, where it has one of its own."""
    platform: type[Platform]
    profile: Profile
    policy: Policy
    scenario: Scenario
    camera: str
    """The camera's URI; empty for the profile's, or the simulator's own in a rehearsal."""
    segmenter: Segmenter
    segmenter_name: str
    target: str = "ahead"
    """How the segmenter chooses the target (`Choice.read`)."""
    sitl: bool
    dry_run: bool
    """Run everything but the actuators; no robot is connected."""
    steps: int
    live_port: int | None = None
    """Local port of the live view; None for no live view."""
    page: Address | None = None
    """Address of the operator's page; None for no page."""
    frames: Frames = "full"
    """The camera images that the log keeps."""
    speed: float
    """Seconds of the run's clock per second of the machine's; 1 on real robots."""
    log_dir: Path
    scheduling: Scheduling = ORDINARY
    """Scheduling of the loop's thread and of the link."""
    faults: tuple[ScheduledFault, ...] = ()
    """Faults to inject in a rehearsal, and when."""
    teleop: str = ""
    """Device by which an operator can take over (`teleop.open_hand.check`); empty for none."""
    simulator: Sitl | None = None
    """A simulator that is already running; None to start one."""
    start_line: StartLine | None = None
    """Place to wait, connected, until the other robots of a fleet are; None to engage at once."""

    def config(self, profile: Profile, lens: CameraInfo | None = None) -> dict[str, Any]:
        """Return the run's configuration for the log, without passwords.

        Args:
            profile: what is really driven; a simulator has changed the plan's own.
            lens: what the camera itself says of its lens; None where it says nothing.
        """
        shown = without_password(self.camera or profile.camera.uri)
        return {
            "robot": self.name,
            "profile": asdict(replace(profile, camera=replace(profile.camera, uri=shown))),
            "policy_sha256": dict(self.policy.info.sha256),
            "policy_source": self.policy.info.source,
            "policy_server": self.policy.info.server,
            "policy_runs_on": self.policy.info.runs_on,
            "gate_switched_off": list(profile.limits.switched_off),
            **asdict(self.scenario),
            "camera": shown,
            "camera_info": None if lens is None else asdict(lens),
            "segmenter": self.segmenter_name,
            "frames": self.frames,
            "faults": [str(strike) for strike in self.faults],
            "speed": self.speed,
            "teleop": self.teleop,
            "realtime": self.scheduling.realtime,
            "cpus": sorted(self.scheduling.cpus),
        }
