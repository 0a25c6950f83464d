"""Reads, checks and describes an ONNX file without running it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import onnx

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.onnx_file import RUNTIME_DOMAINS, check_plain, opsets, read_model

FILE_CAP_BYTES = (2 << 30) - 1
"""Largest protobuf message, and so the largest single ONNX file."""
EXTERNAL_CAP_BYTES = 8 << 30
OPSETS = range(11, 27)
"""ONNX operator versions that the adapters' files may state: the oldest that the exporters write, and
the newest that was looked at."""

Shape = tuple[int | None, ...]
"""None where a file leaves a dimension free."""


@dataclass(frozen=True, slots=True)
class Tensor:
    """One input or output as the file declares it."""

    name: str
    dtype: str
    """As numpy names it; "bfloat16" and their like as ONNX does."""
    shape: Shape

    def __str__(self) -> str:
        sides = ", ".join("any" if size is None else str(size) for size in self.shape)
        return f"{self.name} [{sides}] {self.dtype}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFile:
    """The facts that an ONNX file states about itself."""

    path: Path
    data: bytes
    sha256: tuple[tuple[str, str], ...]
    """(file, digest): the file's own, then those of the weights that it keeps beside itself."""
    opset: int
    inputs: dict[str, Tensor]
    outputs: dict[str, Tensor]
    metadata: dict[str, str]

    @property
    def external(self) -> bool:
        """Whether it keeps weights in other files."""
        return len(self.sha256) > 1


def read_model_file(path: Path, *, external_data: bool = False, cap_bytes: int = FILE_CAP_BYTES) -> ModelFile:
    """Read and check one ONNX file.

    Args:
        path: the file.
        external_data: whether it may keep weights in other files, which then lie beside it.
        cap_bytes: a larger file is refused.

    Raises:
        UsageError: one line that names the file, what was found and what was expected.
    """
    data = _read(path, cap_bytes)
    where = str(path)
    model = read_model(data, where=where)
    if not model.graph.node:
        raise UsageError(f"{where}: is not an ONNX model, or only the beginning of one: it holds no graph")
    versions = opsets(model)
    if len(versions) != 1 or versions[0] not in OPSETS:
        raise UsageError(
            f"{where}: uses opset {versions}; expected one from {OPSETS[0]} to {OPSETS[-1]}: export it again"
        )
    outside = check_plain(model, where=where, domains=RUNTIME_DOMAINS, outside=external_data)
    weights = {initializer.name for initializer in model.graph.initializer}
    inputs = [value for value in model.graph.input if value.name not in weights]
    return ModelFile(
        path=path,
        data=data,
        sha256=(
            (path.name, hashlib.sha256(data).hexdigest()),
            *((name, _digest_beside(path, name)) for name in sorted(outside)),
        ),
        opset=versions[0],
        inputs={value.name: _tensor(value) for value in inputs},
        outputs={value.name: _tensor(value) for value in model.graph.output},
        metadata={entry.key: entry.value for entry in model.metadata_props},
    )


def _read(path: Path, cap_bytes: int) -> bytes:
    try:
        if not path.is_file():
            raise UsageError(f"{path}: no such file; expected an ONNX model")
        if (size := path.stat().st_size) > cap_bytes:
            raise UsageError(f"{path}: has {size >> 10} KiB; a model may have {cap_bytes >> 10} KiB")
        return path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error}") from error


def _digest_beside(path: Path, name: str) -> str:
    """Return the digest of a file of weights; only a plain file in the model's own folder will do."""
    beside = path.parent / name
    if Path(name).name != name or beside.is_symlink() or not beside.is_file():
        raise UsageError(f"{path}: keeps weights in {name!r}, which is not a plain file beside it")
    if beside.stat().st_size > EXTERNAL_CAP_BYTES:
        raise UsageError(f"{beside}: is larger than {EXTERNAL_CAP_BYTES >> 20} MiB")
    with beside.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _tensor(value: Any) -> Tensor:
    kind = value.type.tensor_type
    return Tensor(
        name=value.name,
        dtype=_dtype(kind.elem_type),
        shape=tuple(dim.dim_value if dim.HasField("dim_value") else None for dim in kind.shape.dim),
    )


def _dtype(code: int) -> str:
    names = {"float": "float32", "double": "float64"}
    name = onnx.TensorProto.DataType.Name(code).lower()
    return str(names.get(name, name))
