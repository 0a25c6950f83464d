"""Binds a graph's inputs and outputs by name to what an adapter needs; others are refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.model_file import ModelFile, Shape, Tensor

REAL = ("float32", "float16")
WHOLE = ("int64", "int32")
TRUTH = ("bool", "int64", "int32")


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """One input or output that an adapter knows how to use."""

    names: tuple[str, ...]
    """The names that exporters give it."""
    shapes: tuple[Shape, ...]
    """Any of these; None stands for any size. A file that leaves a dimension free fits every size."""
    dtypes: tuple[str, ...] = REAL
    optional: bool = False


Bound = dict[str, Tensor]
"""The file's tensors by the adapter's own names of them; an optional one that is not there is left out."""


def bind(
    file: ModelFile,
    inputs: Mapping[str, Port],
    outputs: Mapping[str, Port],
    names: Mapping[str, str],
) -> tuple[Bound, Bound]:
    """Find the adapter's inputs and outputs among the file's.

    Args:
        file: the model.
        inputs: by the adapter's names.
        outputs: by the adapter's names.
        names: the user's own map from the adapter's names to the file's; goes before `Port.names`.

    Raises:
        UsageError: one is missing, or has another dtype or shape, or the file wants an input that no one
        feeds;
            says what was found and what was expected.
    """
    for role in names:
        if role not in inputs and role not in outputs:
            raise UsageError(
                f"{file.path}: tensors: unknown name {role!r}; known are {', '.join((*inputs, *outputs))}"
            )
    fed = _bind(file, inputs, file.inputs, names, "input")
    unknown = file.inputs.keys() - {tensor.name for tensor in fed.values()}
    if unknown:
        raise UsageError(
            f"{file.path}: wants the input {_listed(file.inputs[name] for name in sorted(unknown))}, which "
            f"nobody feeds; known are {', '.join(inputs)}: map them by name under `tensors` in the sidecar"
        )
    return fed, _bind(file, outputs, file.outputs, names, "output")


def _bind(
    file: ModelFile, ports: Mapping[str, Port], has: Mapping[str, Tensor], names: Mapping[str, str], side: str
) -> Bound:
    bound: Bound = {}
    for role, port in ports.items():
        candidates = (names[role],) if role in names else port.names
        found = [has[name] for name in candidates if name in has]
        if found:
            _check(file, port, found[0], side)
            bound[role] = found[0]
        elif role in names or not port.optional:
            raise UsageError(
                f"{file.path}: has no {side} {' or '.join(map(repr, candidates))}; it has "
                f"{_listed(has.values())}: name under `tensors` in the sidecar the one that is {role!r}"
            )
    return bound


def _check(file: ModelFile, port: Port, tensor: Tensor, side: str) -> None:
    if tensor.dtype not in port.dtypes or not any(_fits(tensor.shape, shape) for shape in port.shapes):
        expected = " or ".join(
            str(Tensor(tensor.name, "/".join(port.dtypes), shape)) for shape in port.shapes
        )
        raise UsageError(f"{file.path}: {side}: expected {expected}; found {tensor}")


def _fits(got: Shape, wanted: Shape) -> bool:
    return len(got) == len(wanted) and all(
        a is None or b is None or a == b for a, b in zip(got, wanted, strict=True)
    )


def _listed(tensors: object) -> str:
    return ", ".join(map(str, tensors)) or "none"  # type: ignore[call-overload]
