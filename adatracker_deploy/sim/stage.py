"""A scene with its people for ray casting: the class and the colour of what each ray hits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim.caster import Array, Caster, Primitive, Rays
from adatracker_deploy.sim.person import LIMBS, Gait, Role, posture
from adatracker_deploy.sim.scene import Rgb, Scene, Thing

NOTHING = -1
"""Primitive index of a ray that hits nothing."""
GROUND = 0
"""Primitive index of the ground."""

_SKIN_AND_HAIR: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.86, 0.66, 0.53), (0.20, 0.13, 0.08)),
    ((0.55, 0.38, 0.28), (0.07, 0.06, 0.06)),
    ((0.93, 0.76, 0.64), (0.62, 0.45, 0.22)),
)
_CLOTHES: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.80, 0.13, 0.12), (0.13, 0.18, 0.36)),
    ((0.13, 0.42, 0.66), (0.30, 0.27, 0.24)),
    ((0.92, 0.75, 0.22), (0.16, 0.16, 0.17)),
    ((0.24, 0.52, 0.30), (0.45, 0.38, 0.28)),
    ((0.88, 0.88, 0.86), (0.40, 0.14, 0.16)),
)


@dataclass(frozen=True, slots=True)
class Hits:
    """The hits of N rays."""

    primitive: NDArray[np.int32]
    """Index into the stage's tables, `NOTHING` without a hit, (N,)."""
    distance: Array
    """m, infinite without a hit, (N,)."""
    normal: Array | None
    """Unit normals (N, 3), if requested."""


class Stage:
    """Ground, walls, objects and walking people.

    Attributes:
        class_of: `MaskClass` of each primitive, uint8 (P + 1,); the last, at `NOTHING`, is background.
        rgb_of: colour of each primitive, float32 (P + 1, 3).
        windows_of: whether a primitive's sides have rows of windows, bool (P + 1,).
    """

    def __init__(self, scene: Scene, *, obstacles: bool, people: int) -> None:
        """Build `scene` with this many people, the first of whom is the target, all at the origin.

        Raises:
            ImportError: MuJoCo is not installed.
        """
        things = scene.everything(obstacles=obstacles)
        self._surfaces = Caster.of_surfaces(scene)
        self._people = [Caster.of_bodies(_limbs(index)) for index in range(people)]
        self._solids = self._people + [_standing(thing, scene) for thing in things]
        balls = [caster.ball() for caster in self._solids]
        self._ball_centres = np.array([centre for centre, _ in balls])
        self._ball_radii = np.array([radius for _, radius in balls])

        # A caster is one object, so its primitives are of one class, however MuJoCo numbers them.
        classes = [MaskClass.TARGET, *[MaskClass.PERSON] * (people - 1)] + [MaskClass.OBSTACLE] * len(things)
        counts = [len(caster.rgb) for caster in (self._surfaces, *self._solids)]
        self._first = np.cumsum(counts).tolist()
        self.class_of = np.repeat(
            np.array([MaskClass.BACKGROUND, *classes, MaskClass.BACKGROUND], np.uint8), [*counts, 1]
        )
        nothing = np.zeros((1, 3), np.float32)
        self.rgb_of = np.concatenate([self._surfaces.rgb, *(caster.rgb for caster in self._solids), nothing])
        self.windows_of = np.zeros(len(self.class_of), bool)
        painted = [part.windows for thing in things for part in thing.parts]
        self.windows_of[len(self.windows_of) - 1 - len(painted) : -1] = painted

    def move_person(self, index: int, foot: tuple[float, float, float], heading: float, gait: Gait) -> None:
        """Place a person's feet at a point of the scene, facing `heading` (rad)."""
        centres, pitches = posture(gait)
        cos, sin = math.cos(heading), math.sin(heading)
        turned = centres @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        # The quaternion product of a yaw by `heading` and a pitch by `pitches`.
        yaw_w, yaw_z = math.cos(heading / 2), math.sin(heading / 2)
        pitch_w, pitch_y = np.cos(pitches / 2), np.sin(pitches / 2)
        quaternion = np.stack([yaw_w * pitch_w, -yaw_z * pitch_y, yaw_w * pitch_y, yaw_z * pitch_w], axis=-1)
        person = self._people[index]
        person.place(turned + foot, quaternion)
        self._ball_centres[index], self._ball_radii[index] = person.ball()

    def solids(self, rays: Rays, *, normals: bool = False) -> Hits:
        """Return the hits on objects and people; ground and walls are left out."""
        count = len(rays)
        hits = Hits(
            np.full(count, NOTHING, np.int32),
            np.full(count, np.inf),
            np.zeros((count, 3)) if normals else None,
        )
        if count:
            for solid, near in self._near(rays):
                chosen = np.flatnonzero(near)
                self._merge(hits, self._solids[solid], self._first[solid], rays, chosen)
        return hits

    def surfaces(self, rays: Rays, hits: Hits, chosen: NDArray[np.intp]) -> None:
        """Let ground and walls occlude what is behind them along the `chosen` rays; changes `hits`."""
        self._merge(hits, self._surfaces, GROUND, rays, chosen)

    @staticmethod
    def _merge(hits: Hits, caster: Caster, first: int, rays: Rays, chosen: NDArray[np.intp]) -> None:
        """Merge the hits of `caster` along the `chosen` rays into `hits`, where they are nearer."""
        normal = None if hits.normal is None else np.zeros((len(chosen), 3))
        primitive, distance = caster.cast(rays.only(chosen), normal)
        nearer = (primitive >= 0) & (distance < hits.distance[chosen])
        where = chosen[nearer]
        hits.primitive[where] = primitive[nearer] + first
        hits.distance[where] = distance[nearer]
        if hits.normal is not None and normal is not None:
            hits.normal[where] = normal[nearer]

    def _near(self, rays: Rays) -> Iterator[tuple[int, NDArray[np.bool_]]]:
        """Yield each solid that some ray may hit, and which of the N rays those are; true when in doubt.

        Each is inside a bounding sphere; a ray can hit it only within the cone around that sphere. Solids
        whose cone does not meet the cone around all rays are skipped at once.
        """
        to_ball = self._ball_centres - rays.origin
        distance = np.maximum(np.sqrt(np.einsum("sj,sj->s", to_ball, to_ball)), 1e-9)
        sine = np.minimum(self._ball_radii / distance, 1.0)
        axes = to_ball / distance[:, None]
        middle = rays.ways.mean(axis=1)
        middle /= max(float(np.sqrt(middle @ middle)), 1e-9)
        spread = math.acos(max(-1.0, min(1.0, float(np.einsum("j,jn->n", middle, rays.ways).min()))))
        apart = np.arccos(np.clip(np.einsum("sj,j->s", axes, middle), -1.0, 1.0))
        met = np.flatnonzero((apart <= spread + np.arcsin(sine) + 1e-3) | (sine >= 1.0))
        # In single precision, hence a little wider; from inside a sphere every ray may hit its solid.
        least = np.where(sine < 1.0, np.sqrt(1.0 - sine**2) - 1e-4, -2.0).astype(np.float32)
        cosine = np.einsum("sj,jn->sn", axes[met].astype(np.float32), rays.ways.astype(np.float32))
        return zip(met.tolist(), cosine >= least[met, None], strict=True)


def _standing(thing: Thing, scene: Scene) -> Caster:
    parts = tuple(Primitive(part.shape, part.half, part.at, part.rgb) for part in thing.parts)
    caster = Caster.of_bodies((parts,))
    place = np.array([[thing.x, thing.y, scene.terrain.height(thing.x, thing.y)]])
    caster.place(place, np.array([[math.cos(thing.yaw / 2), 0.0, 0.0, math.sin(thing.yaw / 2)]]))
    return caster


def _limbs(index: int) -> tuple[tuple[Primitive, ...], ...]:
    """Return a person's limbs, each a body of its own, in the colours of the `index`-th person."""
    skin, hair = _SKIN_AND_HAIR[index % len(_SKIN_AND_HAIR)]
    shirt, trousers = _CLOTHES[index % len(_CLOTHES)]
    colours: dict[Role, Rgb] = {
        "skin": skin,
        "hair": hair,
        "shirt": shirt,
        "trousers": trousers,
        "shoes": (0.10, 0.09, 0.09),
    }
    return tuple((Primitive(limb.shape, limb.half, (0.0, 0.0, 0.0), colours[limb.role]),) for limb in LIMBS)
