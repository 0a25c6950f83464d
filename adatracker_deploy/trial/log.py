"""The control loop's side of a trial's log: passes every tick to the writer process without waiting."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
import yaml

from adatracker_deploy.core.errors import UsageError, line_of
from adatracker_deploy.core.messages import Click
from adatracker_deploy.trial.folder import (
    CONFIG_NAME,
    FILE_NAME,
    PART_NAME,
    SUMMARY_NAME,
    new_folder,
    writable,
    write_file,
)
from adatracker_deploy.trial.ipc import (
    SLOTS,
    End,
    Free,
    Level,
    LogFailed,
    LogLine,
    Look,
    PageStart,
    Picture,
    PictureSlots,
    Place,
    Post,
    Ready,
    Start,
    Step,
)
from adatracker_deploy.trial.provenance import provenance
from adatracker_deploy.trial.step_json import STEP_FORMAT

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Frame, Observation
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.privacy import Frames

START_TIMEOUT_S = 30.0
CLOSE_TIMEOUT_S = 10.0

Kind = Literal["sitl", "dry", "real"]


@dataclass(slots=True)
class TrialLog:
    """One trial's folder, being written.

    `step` and `event` take well under a millisecond, never wait and never raise: what the writer cannot take
    in time is dropped and counted, `trouble` reports what goes wrong.
    """

    folder: Path
    _post: Post
    _slots: PictureSlots
    _writer: subprocess.Popen[bytes]
    _wall_minus_run_ns: int
    _frames: Frames
    dropped: int = 0
    """Steps and events that are missing from the log because the writer was too far behind."""
    frames_dropped: int = 0
    """Frames that are missing from the log, though their steps are there."""
    _trouble: str = ""
    _free: list[int] = field(default_factory=lambda: list(range(SLOTS)))
    _clicks: list[Click] = field(default_factory=list)
    _last_seq: int | None = None
    _looked_seq: int | None = None
    _closed: bool = False

    @classmethod
    def create(
        cls,
        log_dir: Path,
        *,
        platform: str,
        kind: Kind,
        policy: str,
        steps: int,
        config: Mapping[str, Any],
        now_ns: int,
        live_port: int | None = None,
        frames: Frames = "full",
        page: PageStart | None = None,
    ) -> TrialLog:
        """Make the folder ``LOG_DIR/<UTC time>_<platform>_<kind>/`` (mode 0700) and start the writer.

        Args:
            log_dir: made when it is not there.
            platform: the robot's name.
            kind: simulator, dry run, or the robot itself.
            policy: the policy's name.
            steps: the planned horizon.
            config: everything else that the run was started with, in plain YAML types.
            now_ns: the run's clock. Wall-clock time is read once, here, and only written down.
            live_port: where the writer serves the live view (`live_port.choose_port`); None for none.
            frames: what is kept of the camera's pictures; masks and boxes are kept in any case.
            page: the operator's page, which the writer serves as well; None for none.

        Raises:
            UsageError: the folder cannot be written, the port is in use, or the writer does not start.
        """
        wall_ns = time.time_ns()
        folder = new_folder(log_dir, wall_ns, f"{platform}_{kind}")
        config_yaml = yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True)
        with writable(folder):
            write_file(folder / CONFIG_NAME, config_yaml)
        metadata = {
            "trial": {
                "step_format": str(STEP_FORMAT),
                "platform": platform,
                "kind": kind,
                "policy": policy,
                "steps": str(steps),
                "started": datetime.fromtimestamp(wall_ns / 1e9, UTC).isoformat(),
                "run_clock_ns": str(now_ns),
                **provenance(),
            },
            "config": {"yaml": config_yaml},
        }
        near, far = Post.pair()
        memory_fd = PictureSlots.allocate()
        try:
            writer = subprocess.Popen(
                (
                    sys.executable,
                    *("-m", "adatracker_deploy.trial.writer", str(far.fileno()), str(memory_fd)),
                ),
                pass_fds=(far.fileno(), memory_fd),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # a Ctrl-C at the terminal is the tracker's business
            )
            slots = PictureSlots(memory_fd)
        finally:
            far.close()
            os.close(memory_fd)
        log = cls(folder, Post(near), slots, writer, wall_ns - now_ns, frames)
        log._start(Start(str(folder / PART_NAME), str(folder / FILE_NAME), metadata, live_port, frames, page))
        return log

    def step(self, record: StepRecord, frame: Frame, observation: Observation) -> None:
        """Hand over one tick, and the frame with its mask unless an earlier tick had the same."""
        try:
            self._hear()
            place = None
            if frame.seq != self._last_seq:
                self._last_seq = frame.seq
                place = self._put(frame, observation)
            message = Step(self._wall_ns(record.t_ns), self._wall_ns(frame.t_ns), record, place)
            if not self._hand_over(message) and place is not None:
                self._free.append(place.slot)
                self.frames_dropped += 1
        except Exception as error:  # nothing that goes wrong with writing down may stop a robot's control
            self._trouble = self._trouble or f"a tick could not be logged: {line_of(error)}"
            self.dropped += 1

    def look(self, frame: Frame, observation: Observation, t_ns: int) -> None:
        """Show a new frame from before the first tick on the operator's page; nothing is written."""
        self._hear()
        if frame.seq == self._looked_seq or len(self._free) < SLOTS // 2:
            return
        self._looked_seq = frame.seq
        target = observation.target.value if observation.target else None
        place = self._put(frame, observation)
        wall_ns, captured_ns = self._wall_ns(t_ns), self._wall_ns(frame.t_ns)
        message = Look(wall_ns, captured_ns, frame.seq, target, observation.box, place)
        try:
            self._post.send(message, timeout_s=0.0)
        except OSError:  # a full socket too: the next one is as good
            self._free += [place.slot] if place is not None else []

    def clicks(self) -> list[Click]:
        """Return where the operator has clicked on the page since the last call."""
        self._hear()
        clicks, self._clicks = self._clicks, []
        return clicks

    def event(self, level: Level, message: str, t_ns: int) -> None:
        """Write down something that happened, at the run's clock `t_ns`."""
        self._hand_over(LogLine(self._wall_ns(t_ns), level, message))

    @property
    def trouble(self) -> str:
        """Reason why the log is incomplete (the disk is full, the writer died); empty while it is not."""
        self._hear()
        return self._trouble

    @property
    def writer_pid(self) -> int:
        """The writer's process id."""
        return self._writer.pid

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Write ``summary.json``, let the writer finish ``trial.mcap``, and wait for it; may be called twice.

        Without a summary the log is that of a trial that was cut short. Nothing is raised: see `trouble`.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if summary is not None:
                text = json.dumps(summary, indent=2, allow_nan=False)
                write_file(self.folder / SUMMARY_NAME, text + "\n")
                self._post.send(End(text), CLOSE_TIMEOUT_S)
            self._post.finish()
            self._writer.wait(CLOSE_TIMEOUT_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            self._trouble = self._trouble or f"the log was not finished: {error}"
        self._hear()
        self._post.close()
        if self._writer.poll() is None:
            self._writer.kill()
            self._writer.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _start(self, start: Start) -> None:
        try:
            self._post.send(start, START_TIMEOUT_S)
            answer = self._post.receive(START_TIMEOUT_S)
        except (OSError, EOFError) as error:
            answer = LogFailed(f"{self.folder}: the log's writer did not start: {error}")
        if not isinstance(answer, Ready):
            self.close()
            raise UsageError(answer.message)

    def _put(self, frame: Frame, observation: Observation) -> Place | None:
        """Copy a frame into a free slot, the one last used first: its memory is warm."""
        if not self._free:
            self.frames_dropped += 1
            return None
        slot = self._free.pop()
        try:
            size = frame.rgb.shape[1], frame.rgb.shape[0]
            return self._slots.put(slot, Picture(size, self._content(frame), observation.mask))
        except ValueError as error:
            self._free.append(slot)
            self.frames_dropped += 1
            self._trouble = self._trouble or f"a frame could not be logged: {line_of(error)}"
            return None

    def _content(self, frame: Frame) -> NDArray[np.uint8]:
        """Return what the writer needs of a frame: no more leaves this process."""
        if self._frames == "none":
            return np.empty(0, np.uint8)
        if self._frames == "full" and frame.jpeg is not None and len(frame.jpeg) < frame.rgb.nbytes:
            return np.frombuffer(frame.jpeg, np.uint8)
        return frame.rgb

    def _hand_over(self, message: Step | LogLine) -> bool:
        try:
            self._post.send(message, timeout_s=0.0)
        except BlockingIOError:
            self.dropped += 1
            return False
        except OSError as error:
            self._trouble = self._trouble or f"the log's writer cannot be reached: {error.strerror}"
            self.dropped += 1
            return False
        return True

    def _hear(self) -> None:
        """Take what the writer said."""
        try:
            while True:
                match self._post.receive(timeout_s=0.0):
                    case Free(slot):
                        self._free.append(slot)
                    case LogFailed(message):
                        self._trouble = self._trouble or message
                    case Click() as click:
                        self._clicks.append(click)
        except OSError:
            return  # nothing more
        except EOFError:
            if not self._closed:
                self._trouble = self._trouble or "the log's writer has gone"

    def _wall_ns(self, t_ns: int) -> int:
        return max(0, t_ns + self._wall_minus_run_ns)
