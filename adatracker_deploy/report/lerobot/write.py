"""Writes the data set: a file of rows and a video for each trial, in a folder that appears when complete."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.mask_png import PALETTE
from adatracker_deploy.perception.film_writer import FilmWriter
from adatracker_deploy.report.lerobot.features import CAMERA, MASK, Columns, Layout, columns, knows_state
from adatracker_deploy.report.lerobot.statistics import PictureTally, Statistics, of_numbers
from adatracker_deploy.trial.ending import ending
from adatracker_deploy.trial.episodes import episodes, tick_rate_hz
from adatracker_deploy.trial.reader import LoggedFrame, LoggedMask

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from adatracker_deploy.trial.episodes import Episode
    from adatracker_deploy.trial.reader import Trial

VERSION = "v3.0"
TASK = "Follow the person."
_FILES_PER_CHUNK = 1000
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_DATA, _VIDEO = f"data/{_FILE}.parquet", f"videos/{{video_key}}/{_FILE}.mp4"
_EPISODES = f"meta/episodes/{_FILE}.parquet"
_LARGEST_MB = {"data_files_size_in_mb": 100, "video_files_size_in_mb": 200}
"""lerobot's defaults, by which its own tools split files anew; readers take any size."""
_COLOURS = np.array(PALETTE, np.uint8)
_NEAR = 0.02
"""A measured rate within this of a whole number is that number: loops are told whole rates."""


@dataclass(frozen=True, slots=True)
class Written:
    """Size of a data set that was written."""

    trials: int
    episodes: int
    rows: int
    left_out: int
    """Ticks that are in no row: those at gaps, and each episode's last, which only shows what came of the
    one before."""


def write_lerobot(trials: Iterable[Trial], out: Path, task: str = TASK) -> Written:
    """Write trials as a LeRobotDataset v3.0.

    Args:
        trials: of one rate, with pictures of one size; those without an episode are passed over.
        out: the folder; it must not be there.
        task: what the robots were to do, in words.

    Raises:
        UsageError: the `lerobot` extra is not installed, no trial has an episode, the trials differ in what a
            data set has once, a picture is damaged, or the folder is there or cannot be written.
        PlatformError: a video cannot be finished.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        told = "LeRobot's format needs pyarrow: pip install 'adatracker-deploy[lerobot]'"
        raise UsageError(told) from error
    if out.exists():
        raise UsageError(f"--lerobot {out}: is there already; name a new folder")
    cuts = [cut for trial in trials if (cut := _cut(trial)) is not None]
    layout = _shared_layout(cuts)
    unfinished = out.with_name(f".{out.name}.{os.getpid()}")
    try:
        unfinished.mkdir()
        with contextlib.ExitStack() as undo:
            undo.callback(shutil.rmtree, unfinished)
            written = _Folder(unfinished, layout, task).write(cuts)
            unfinished.replace(out)
            undo.pop_all()
    except OSError as error:
        raise UsageError(f"--lerobot {out}: cannot be written: {error.strerror}") from error
    return written


@dataclass(frozen=True, slots=True)
class _Cut:
    trial: Trial
    outcome: str
    episodes: list[Episode]
    layout: Layout


def _cut(trial: Trial) -> _Cut | None:
    """Cut a trial, and look at its first picture; None where there is no episode in it."""
    ended = ending(trial)
    steps = trial.steps[: ended.ticks]
    kept = trial.frame_seqs or {mask.seq for mask in trial.masks()}
    found = episodes(steps, ended.outcome, kept)
    rate_hz, picture = tick_rate_hz(steps), next(_pictures(trial), None)
    if not found or rate_hz is None or picture is None:
        return None
    whole_hz = round(rate_hz)
    near = whole_hz > 0 and abs(rate_hz - whole_hz) <= _NEAR * whole_hz
    height, width = picture.mask.shape
    layout = Layout(
        rate_hz=whole_hz if near else round(rate_hz, 1),
        camera=_even(picture.rgb).shape[:2] if isinstance(picture, LoggedFrame) else None,
        mask=(height, width),
        has_state=all(map(knows_state, found)),
    )
    return _Cut(trial, ended.outcome, found, layout)


def _shared_layout(cuts: Sequence[_Cut]) -> Layout:
    """Return the layout of all; the robots' velocity is in it where all of them know it.

    Raises:
        UsageError: there are none, or one differs from the first.
    """
    if not cuts:
        raise UsageError("no trial has two ticks in a row with their pictures, so there is nothing to write")
    first = cuts[0]
    for cut in cuts[1:]:
        for name in ("rate_hz", "camera", "mask"):
            here, there = getattr(cut.layout, name), getattr(first.layout, name)
            if here != there:
                raise UsageError(
                    f"{cut.trial.path}: {_WORDS[name]} {here}, and {there} in {first.trial.path}: "
                    "a data set has one; export them apart"
                )
    layout = {field.name: getattr(first.layout, field.name) for field in fields(Layout)}
    return Layout(**layout | {"has_state": all(cut.layout.has_state for cut in cuts)})


_WORDS = {
    "rate_hz": "its rate, Hz, is",
    "camera": "its pictures' height and width are",
    "mask": "its masks' height and width are",
}


@dataclass(frozen=True, slots=True)
class _Pictures:
    """An episode's pictures, as they were written."""

    file: dict[str, int]
    """The chunk and file of its trial."""
    first: int
    """Number of its first picture in its trial's video."""
    tallies: dict[str, PictureTally]
    masks: list[bytes]


class _Folder:
    """The data set in the making."""

    def __init__(self, root: Path, layout: Layout, task: str) -> None:
        self._root = root
        self._layout = layout
        self._task = task
        self._keys = [MASK] if layout.camera is None else [CAMERA, MASK]
        self._tallies = {key: PictureTally() for key in self._keys}
        self._numbers: list[Columns] = []
        """The numbers of each episode so far."""
        self._rows = 0
        self._episodes: list[dict[str, Any]] = []

    def write(self, cuts: Sequence[_Cut]) -> Written:
        """Write all of it."""
        from adatracker_deploy.report.lerobot import tables

        for place, cut in enumerate(cuts):
            self._write_trial(place, cut)
        tables.write_table(
            self._root / _EPISODES.format(chunk_index=0, file_index=0), tables.episodes_table(self._episodes)
        )
        tables.write_table(self._root / "meta/tasks.parquet", tables.tasks_table([self._task]))
        self._write_json("meta/info.json", self._info(cuts))
        self._write_json("meta/stats.json", self._statistics(_joined(self._numbers), self._tallies))
        ticks = sum(len(cut.trial.steps) for cut in cuts)
        return Written(len(cuts), len(self._episodes), self._rows, ticks - self._rows)

    def _write_trial(self, place: int, cut: _Cut) -> None:
        from adatracker_deploy.report.lerobot import tables

        file = {"chunk_index": place // _FILES_PER_CHUNK, "file_index": place % _FILES_PER_CHUNK}
        video = self._root / _VIDEO.format(video_key=CAMERA, **file)
        album, parts, filmed = _Album(cut.trial), [], 0
        with contextlib.closing(FilmWriter(video, self._layout.rate_hz)) as film:
            if CAMERA in self._keys:
                video.parent.mkdir(parents=True, exist_ok=True)
            for episode in cut.episodes:
                pictures = _Pictures(file, filmed, {key: PictureTally() for key in self._keys}, [])
                for row, transition in enumerate(episode, filmed):
                    picture = album.at(transition.tick.frame_seq)
                    painted = _COLOURS[picture.mask]
                    pictures.masks.append(_png(painted))
                    pictures.tallies[MASK].add(painted)
                    if isinstance(picture, LoggedFrame):
                        film.write(_even(picture.rgb), round(row * 1e9 / self._layout.rate_hz))
                        pictures.tallies[CAMERA].add(picture.rgb)
                parts.append(self._add(cut, episode, pictures))
                filmed += len(episode)
        tables.write_rows(self._root / _DATA.format(**file), parts)

    def _add(self, cut: _Cut, episode: Episode, pictures: _Pictures) -> Any:
        """Take note of an episode; return its rows."""
        from adatracker_deploy.report.lerobot import tables

        number, first, rate_hz = len(self._episodes), self._rows, self._layout.rate_hz
        numbers = columns(
            episode,
            rate_hz=rate_hz,
            began_ns=cut.trial.steps[0].t_ns,
            number=number,
            first=first,
            has_state=self._layout.has_state,
        )
        self._rows += len(episode)
        self._numbers.append(numbers)
        for key, tally in pictures.tallies.items():
            self._tallies[key].merge(tally)
        told = {
            "episode_index": number,
            "tasks": [self._task],
            "length": len(episode),
            "dataset_from_index": first,
            "dataset_to_index": self._rows,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            "trial": cut.trial.path.parent.name,
            "trial_platform": cut.trial.platform,
            "trial_policy": cut.trial.policy,
            "trial_outcome": cut.outcome,
        }
        told |= {f"data/{name}": value for name, value in pictures.file.items()}
        if CAMERA in self._keys:
            told |= {f"videos/{CAMERA}/{name}": value for name, value in pictures.file.items()}
            told[f"videos/{CAMERA}/from_timestamp"] = pictures.first / rate_hz
            told[f"videos/{CAMERA}/to_timestamp"] = (pictures.first + len(episode)) / rate_hz
        for key, found in self._statistics(numbers, pictures.tallies).items():
            told |= {f"stats/{key}/{name}": value for name, value in found.items()}
        self._episodes.append(told)
        return tables.rows_table(numbers, {MASK: pictures.masks})

    def _statistics(self, numbers: Columns, tallies: dict[str, PictureTally]) -> dict[str, Statistics]:
        found = {key: tally.statistics() for key, tally in tallies.items()}
        return found | {key: of_numbers(values) for key, values in numbers.items()}

    def _info(self, cuts: Sequence[_Cut]) -> dict[str, Any]:
        return {
            "codebase_version": VERSION,
            "robot_type": "+".join(sorted({cut.trial.platform for cut in cuts})),
            "total_episodes": len(self._episodes),
            "total_frames": self._rows,
            "total_tasks": 1,
            "chunks_size": _FILES_PER_CHUNK,
            **_LARGEST_MB,
            "fps": self._layout.rate_hz,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": _DATA,
            "video_path": _VIDEO if CAMERA in self._keys else None,
            "features": self._layout.features(),
        }

    def _write_json(self, name: str, content: dict[str, Any]) -> None:
        (self._root / name).write_text(json.dumps(content, indent=4, allow_nan=False))


class _Album:
    """A trial's pictures, looked up in the order in which they were taken."""

    def __init__(self, trial: Trial) -> None:
        self._trial = trial
        self._pictures = _pictures(trial)
        self._picture = next(self._pictures, None)

    def at(self, seq: int) -> LoggedFrame | LoggedMask:
        """Return the picture of a number, which is at least the last one asked for.

        Raises:
            UsageError: the log's is damaged, or of another size.
        """
        while self._picture is not None and self._picture.seq < seq:
            self._picture = next(self._pictures, None)
        if self._picture is None or self._picture.seq != seq:
            raise UsageError(f"{self._trial.path}: frame {seq} is damaged")
        return self._picture


def _pictures(trial: Trial) -> Iterator[LoggedFrame] | Iterator[LoggedMask]:
    """Read a trial's frames with their masks; the masks alone where the log keeps no pictures."""
    return trial.frames() if trial.frame_seqs else trial.masks()


def _even(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture without its last row or column where their number is odd: VP9 halves the colours."""
    return rgb[: rgb.shape[0] // 2 * 2, : rgb.shape[1] // 2 * 2]


def _png(rgb: NDArray[np.uint8]) -> bytes:
    _, png = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    return bytes(png)


def _joined(parts: Sequence[Columns]) -> Columns:
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
