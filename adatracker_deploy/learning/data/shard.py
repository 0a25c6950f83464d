"""Shards: files of whole episodes. A shard is an ``.npz`` archive, whose checksums tell a damaged one.

``header`` is JSON as bytes: the schema, where the shard comes from, and for each episode its spec, its number
of steps and how it ended. The other arrays hold all steps of all episodes, one after the other; step t is the
mask that was seen, the action that followed, and what that led to. An episode's first mask is at its start.

======== ============= =======================================================================================
masks    uint8 (T, P)  class masks of 64 x 64, four pixels a byte, the first in the lowest bits; P = 1024
actions  float32 (T, 2) executed, in [-1, 1]: forward, yaw (counter-clockwise positive)
experts  float32 (T, 2) what the expert would have done there
rewards  float32 (T,)  of the step that `actions` led to
visible  bool (T,)     the target could be seen after that step, by the task's rule
dropped  bool (T,)     the mask's frame was lost: it is empty, or the one before
done     bool (T,)     the step ended the episode as lost; a horizon is not an end of the task, and not marked
states   float32 (T, S) the true state before the step, as `state.COLUMNS` names it
finals   float32 (E, S) the true state after each episode's last step
======== ============= =======================================================================================
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
import zipfile
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.episode_spec import MASK_SIZE, EpisodeSpec

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from adatracker_deploy.learning.change import Change
    from adatracker_deploy.learning.embodiment import Embodiment

SCHEMA = "adatracker-shard-2"
SHARD_STEPS = 5000
"""Steps in a full shard: about ten episodes, a few seconds of work to lose on an interrupt."""
PACKED = MASK_SIZE * MASK_SIZE // 4
"""Bytes of a packed mask."""

_SHIFTS = np.arange(0, 8, 2, dtype=np.uint8)
_UNPACKED = ((np.arange(256, dtype=np.uint8)[:, None] >> _SHIFTS) & 3).astype(np.uint8)
"""Four pixels for each byte."""
_UNPACKED_WORDS = np.ascontiguousarray(_UNPACKED).view(np.uint32).reshape(256)
"""The same four bytes as one word, so that a lookup moves them at once."""

_ARRAYS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "masks": (np.uint8, (PACKED,)),
    "actions": (np.float32, (2,)),
    "experts": (np.float32, (2,)),
    "rewards": (np.float32, ()),
    "visible": (np.bool_, ()),
    "dropped": (np.bool_, ()),
    "done": (np.bool_, ()),
    "states": (np.float32, (len(COLUMNS),)),
    "finals": (np.float32, (len(COLUMNS),)),
}
_PER_EPISODE = "finals"


def pack_masks(masks: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return masks (..., 64, 64) of classes 0 to 3 as (..., 1024)."""
    quads = masks.reshape(*masks.shape[:-2], PACKED, 4)
    packed: NDArray[np.uint8] = np.bitwise_or.reduce(quads << _SHIFTS, axis=-1)
    return packed


def unpack_masks(packed: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return packed masks (..., 1024) as (..., 64, 64)."""
    words = _UNPACKED_WORDS[packed]
    return words.view(np.uint8).reshape(*packed.shape[:-1], MASK_SIZE, MASK_SIZE)


def distinct_patches(packed: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return the different patches of 4 x 4 pixels in packed masks (..., 1024), and where they are.

    Masks are flat almost everywhere: a thousand of them have 262,144 patches, and of these about a thousand
    differ where the masks are clean.

    Returns:
        classes (U, 4, 4) of the patches, and for each patch of each mask, by rows, which it is: (..., 256).
    """
    across = MASK_SIZE // 4
    bytes_of = packed.reshape(-1, across, 4, across).swapaxes(2, 3)  # four rows of a byte each
    words, place = np.unique(np.ascontiguousarray(bytes_of).view(np.uint32), return_inverse=True)
    kinds = _UNPACKED[words.view(np.uint8)].reshape(-1, 4, 4)
    return kinds, place.reshape(*packed.shape[:-1], across * across).astype(np.int64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """The arrays of a shard, or of one episode, as the module's docstring lists them."""

    masks: NDArray[np.uint8]
    actions: NDArray[np.float32]
    experts: NDArray[np.float32]
    rewards: NDArray[np.float32]
    visible: NDArray[np.bool_]
    dropped: NDArray[np.bool_]
    done: NDArray[np.bool_]
    states: NDArray[np.float32]
    finals: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.rewards)

    @classmethod
    def joined(cls, parts: Sequence[Steps]) -> Steps:
        """Return all steps of all parts, in order."""
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS})


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeHeader:
    """The description of one episode."""

    spec: EpisodeSpec
    steps: int

    @property
    def body(self) -> Embodiment:
        """Its body, of which all is known."""
        return self.spec.embodiment

    @property
    def change(self) -> Change | None:
        """Changes of its body on the way; None if there are none."""
        return self.spec.change


Record = tuple[EpisodeHeader, Steps]
"""One episode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shard:
    """Some whole episodes; the last may have been cut short to fill the shard exactly."""

    source: str
    """The collection that it belongs to."""
    episodes: tuple[EpisodeHeader, ...]
    steps: Steps


@dataclass(frozen=True, slots=True, kw_only=True)
class _Header:
    schema: str
    source: str
    episodes: tuple[EpisodeHeader, ...]


def shard_name(index: int) -> str:
    """Return the file name of a collection's `index`-th shard."""
    return f"shard-{index:05d}.npz"


def joined_shard(source: str, records: Sequence[Record]) -> Shard:
    """Return one shard of some episodes, at least one."""
    headers, steps = zip(*records, strict=True)
    return Shard(source=source, episodes=headers, steps=Steps.joined(steps))


def packed_shard(shard: Shard) -> bytes:
    """Return a shard as the content of its file."""
    header = {
        "schema": SCHEMA,
        "source": shard.source,
        "episodes": [dataclasses.asdict(episode) for episode in shard.episodes],
    }
    arrays = {name: getattr(shard.steps, name) for name in _ARRAYS}
    file = io.BytesIO()
    np.savez_compressed(file, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)
    return file.getvalue()


def write_shard(path: Path, shard: Shard | bytes) -> None:
    """Write a shard, packed or not; it appears under its name only when it is complete."""
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    unfinished.write_bytes(shard if isinstance(shard, bytes) else packed_shard(shard))
    unfinished.replace(path)


def read_shard(path: Path) -> Shard:
    """Read a shard and check all of it.

    Raises:
        UsageError: no such file, damaged or cut short, or of another schema.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = _header(archive, path)
            steps = Steps(**{name: archive[name] for name in _ARRAYS if name in archive})
    except FileNotFoundError as error:
        raise UsageError(f"{path}: no such shard") from error
    except (OSError, EOFError, ValueError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise UsageError(f"{path}: is damaged or cut short; delete it and collect again") from error
    total = sum(episode.steps for episode in header.episodes)
    for name, (kind, inner) in _ARRAYS.items():
        array = getattr(steps, name)
        rows = len(header.episodes) if name == _PER_EPISODE else total
        if array.dtype != kind or array.shape != (rows, *inner):
            expected = f"{kind.__name__} of shape {(rows, *inner)}"
            raise UsageError(f"{path}: {name}: expected {expected}, got {array.dtype} {array.shape}")
    return Shard(source=header.source, episodes=header.episodes, steps=steps)


def _header(archive: Any, path: Path) -> _Header:
    if "header" not in archive:
        raise UsageError(f"{path}: not a shard: it has no header")
    value = json.loads(archive["header"].tobytes())
    schema = value.get("schema") if isinstance(value, dict) else None
    if schema != SCHEMA:
        raise UsageError(
            f"{path}: schema {schema!r} is not {SCHEMA!r}; collect the data again with this version"
        )
    return parse(_Header, value, where=str(path))
