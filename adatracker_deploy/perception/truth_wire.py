"""Serialises a simulated frame's ground truth, for simulators that send frames over a robot's own protocol.

A JSON header with its length before it, then the class mask as PNG. Only rehearsals carry it.
"""

from __future__ import annotations

import dataclasses
import json
import struct

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.mask_png import decode_mask, encode_mask
from adatracker_deploy.core.messages import Contact, MaskClass, Truth

_LENGTH = struct.Struct("<I")
_LARGEST_BYTES = 1 << 20


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Header:
    robot: Pose
    camera: Pose
    target_xy: tuple[float, float]
    distance_m: float
    bearing_rad: float
    contact: Contact | None
    in_view: bool


def encode_truth(truth: Truth) -> bytes:
    """Return the truth as bytes."""
    header = {
        field.name: getattr(truth, field.name) for field in dataclasses.fields(truth) if field.name != "mask"
    }
    text = json.dumps(header, default=dataclasses.asdict).encode()
    return b"".join((_LENGTH.pack(len(text)), text, encode_mask(truth.mask)))


def decode_truth(data: bytes) -> Truth:
    """Return the truth that `encode_truth` wrote.

    Raises:
        ValueError: it is something else, or larger than 1 MiB.
    """
    if len(data) > _LARGEST_BYTES:
        raise ValueError(f"not a truth: {len(data)} bytes")
    try:
        (length,) = _LENGTH.unpack_from(data)
        text = data[_LENGTH.size : _LENGTH.size + length]
        header = parse(_Header, json.loads(text), where="truth")
        mask = decode_mask(data[_LENGTH.size + length :])
        if not mask.size or mask.max() > max(MaskClass):
            raise ValueError("unknown classes in its mask, or none")
    except (struct.error, UsageError, RecursionError, ValueError) as error:
        raise ValueError(f"not a truth: {error}") from error
    values = {field.name: getattr(header, field.name) for field in dataclasses.fields(header)}
    return Truth(mask=mask, **values)
