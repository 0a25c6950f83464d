"""Golden vectors: a policy's answers at export, which it must reproduce wherever it is loaded."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy import belief
from adatracker_deploy.policy.manifest import Manifest

GOLDEN_TICKS = 24
"""Ticks in the golden vectors, T."""
GOLDEN_TOLERANCE = 1e-4
"""Largest difference of any number of an answer; kernels on different processors round differently."""

Golden = Mapping[str, NDArray[np.float32]]
"""mask (T, C, S, S), action (T, A) and, where the policy has them, z (T, Z) and belief (T, `belief.SIZE`): a
run from reset, own actions fed back."""

_CAP_BYTES = 64 << 20


def pack_golden(golden: Golden) -> bytes:
    """Return the vectors as the bytes of a compressed `.npz`."""
    packed = io.BytesIO()
    np.savez_compressed(packed, allow_pickle=False, **golden)
    return packed.getvalue()


def unpack_golden(data: bytes, manifest: Manifest, *, where: str) -> Golden:
    """Read golden vectors from `.npz` bytes; pickled objects are never read.

    Raises:
        UsageError: one line that names `where` and the reason.
    """
    mask, ticks = manifest.mask, GOLDEN_TICKS
    shapes: dict[str, tuple[int, ...]] = {
        "mask": (ticks, mask.channels, mask.size, mask.size),
        "action": (ticks, len(manifest.action)),
    }
    if manifest.encoder is not None:
        shapes["z"] = (ticks, manifest.told_context)
    if manifest.believes:
        shapes["belief"] = (ticks, belief.SIZE)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            unpacked_bytes = sum(entry.file_size for entry in packed.infolist())
        if unpacked_bytes > _CAP_BYTES:
            raise UsageError(f"{where}: unpacks to more than {_CAP_BYTES >> 10} KiB")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            golden = {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, EOFError, MemoryError, zipfile.BadZipFile) as error:
        raise UsageError(f"{where}: cannot be read as plain arrays: {error}") from error
    found = {name: (array.shape, array.dtype.name) for name, array in golden.items()}
    expected = {name: (shape, "float32") for name, shape in shapes.items()}
    if found != expected:
        raise UsageError(f"{where}: expected {_listed(expected)}; got {_listed(found)}")
    if not all(np.isfinite(array).all() for array in golden.values()):
        raise UsageError(f"{where}: holds numbers that are not finite")
    return golden


def _listed(arrays: Mapping[str, tuple[tuple[int, ...], str]]) -> str:
    return ", ".join(f"{name} {list(shape)} {dtype}" for name, (shape, dtype) in sorted(arrays.items()))
