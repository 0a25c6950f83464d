"""Free space seen from above: solids as rounded rectangles, and the arena's walls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
"""Points seen from above, shape (M, 2), m."""

Clearance = Callable[[Points], NDArray[np.float64]]
"""Distance from each point to the nearest obstacle, shape (M,), m; negative inside it."""

_ON_EDGE_M = 1e-9

HEADROOM_M = 2.0
"""A solid that begins higher than this blocks nothing on the ground, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solid:
    """An upright prism over a rectangle with rounded corners; a cylinder has zero half-widths."""

    x: float
    y: float
    yaw: float = 0.0
    half_x: float = 0.0
    half_y: float = 0.0
    radius: float = 0.0
    bottom: float = 0.0
    top: float
    """Height of the lower and of the upper face in the fixed frame, m."""


class FreeSpace:
    """A walled rectangle around the origin with solids in it; all distances are exact."""

    def __init__(
        self, half_x_m: float, half_y_m: float, solids: Sequence[Solid], ground_m: float = 0.0
    ) -> None:
        """Take the arena's half-widths, its solids and the height of its lowest ground."""
        self._half = np.array([half_x_m, half_y_m])
        self._all = _Prisms(solids)
        self._standing = _Prisms([s for s in solids if s.bottom < ground_m + HEADROOM_M])

    def clearance(self, points: Points) -> NDArray[np.float64]:
        """Return the distance from each point to the nearest wall or standing solid (a `Clearance`)."""
        walls: NDArray[np.float64] = (self._half - np.abs(points)).min(axis=1)
        things = self._standing.distance(points).min(axis=1, initial=np.inf)
        clear: NDArray[np.float64] = np.minimum(walls, things)
        return clear

    def push_out(self, x: float, y: float, radius_m: float) -> tuple[float, float]:
        """Return the nearest point where a disc touches neither wall nor standing solid.

        Penetrations are resolved one by one, the deepest first. If that goes back and forth, in a corner or
        in a gap too narrow for the disc, the point after eight iterations is returned.
        """
        place = np.array([x, y])
        limit = np.maximum(self._half - radius_m, 0.0)
        for _ in range(8):
            place = place.clip(-limit, limit)
            distance = self._standing.distance(place[None])[0]
            depth = radius_m - distance.min(initial=np.inf)
            if depth <= 0.0:
                break
            place = place + depth * self._standing.way_out(place, int(distance.argmin()))
        return float(place[0]), float(place[1])

    def touches(self, x: float, y: float, z: float, radius_m: float) -> bool:
        """Return whether a sphere at this point touches a wall or a solid at any height."""
        place = np.array([[x, y]])
        if (np.abs(place[0]) > self._half - radius_m).any():
            return True
        across = self._all.distance(place)
        above = np.maximum(np.maximum(self._all.bottom - z, z - self._all.top), 0.0)
        return bool((np.hypot(np.maximum(across[0], 0.0), above) < radius_m).any())


class _Prisms:
    """Solids as arrays over N of them."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        self.bottom = np.array([s.bottom for s in solids])
        self.top = np.array([s.top for s in solids])
        self._centre = np.array([(s.x, s.y) for s in solids]).reshape(-1, 2)
        self._half = np.array([(s.half_x, s.half_y) for s in solids]).reshape(-1, 2)
        self._radius = np.array([s.radius for s in solids])
        yaw = np.array([s.yaw for s in solids])
        self._cos, self._sin = np.cos(yaw), np.sin(yaw)

    def distance(self, points: Points) -> NDArray[np.float64]:
        """Return signed distances (M, N).

        The signed distance of a rounded box: https://iquilezles.org/articles/distfunctions2d.
        """
        offset_x, offset_y = (points[:, None, :] - self._centre).transpose(2, 0, 1)
        over_x = np.abs(self._cos * offset_x + self._sin * offset_y) - self._half[:, 0]
        over_y = np.abs(self._cos * offset_y - self._sin * offset_x) - self._half[:, 1]
        outside = np.hypot(np.maximum(over_x, 0.0), np.maximum(over_y, 0.0))
        distance: NDArray[np.float64] = outside + np.minimum(np.maximum(over_x, over_y), 0.0) - self._radius
        return distance

    def way_out(self, point: NDArray[np.float64], index: int) -> NDArray[np.float64]:
        """Return the unit direction (2,) in which the distance to one solid grows."""
        cos, sin = self._cos[index], self._sin[index]
        turn = np.array([[cos, -sin], [sin, cos]])
        local = (point - self._centre[index]) @ turn
        over = np.abs(local) - self._half[index]
        # Inside the rectangle the way out is through the nearest side, elsewhere straight away from its edge.
        way = np.maximum(over, 0.0) if over.max() > _ON_EDGE_M else (over == over.max()).astype(np.float64)
        out: NDArray[np.float64] = turn @ np.copysign(way / np.linalg.norm(way), local)
        return out
