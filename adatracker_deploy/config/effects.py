"""Effects that make a virtual world harder to see in than a clear day on a smooth floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, cast, get_args

from adatracker_deploy.core.errors import UsageError

RoadClass = Literal["smooth", "A", "B", "C", "D"]
"""Roughness by ISO 8608: from A, very good, to D, poor, as unpaved ones are."""

EXPECTED = "fog=METRES, road=A to D and sit, with commas between, as in 'fog=40,road=C,sit'"


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """The effects; the defaults are none. `str` is the inverse of `read`.

    Raises:
        UsageError: a value is out of range.
    """

    fog_m: float = 0.0
    """Meteorological optical range, m, 5 to 100,000; 0 is none. It is fog below 1000 m."""
    road: RoadClass = "smooth"
    """The roughness that shakes the camera of a body that drives."""
    sit: bool = False
    """People sit down at times, and stand up again."""

    def __post_init__(self) -> None:
        if self.fog_m != 0.0 and not 5.0 <= self.fog_m <= 100_000.0:  # false for NaN too
            raise UsageError(
                f"fog {self.fog_m:g}: expected an optical range of 5 to 100,000 m, or 0 for none"
            )
        if self.road not in get_args(RoadClass):
            raise UsageError(f"road {self.road!r}: expected {', '.join(get_args(RoadClass))}")

    @classmethod
    def read(cls, text: str) -> Effects:
        """Read ``fog=40,road=C,sit``, each of them optional.

        Raises:
            UsageError: it is not that.
        """
        fog_m, road, sit = 0.0, "smooth", False
        for part in filter(None, text.split(",")):
            name, _, value = part.partition("=")
            if name == "fog" and _is_number(value):
                fog_m = float(value)
            elif name == "road" and value:
                road = value
            elif part == "sit":
                sit = True
            else:
                raise UsageError(f"effects {text!r}: {part!r} is none of {EXPECTED}")
        return cls(fog_m=fog_m, road=cast("RoadClass", road), sit=sit)

    def __str__(self) -> str:
        parts = (
            f"fog={self.fog_m!r}" if self.fog_m else "",
            "" if self.road == "smooth" else f"road={self.road}",
            "sit" if self.sit else "",
        )
        return ",".join(filter(None, parts))


NONE = Effects()


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
