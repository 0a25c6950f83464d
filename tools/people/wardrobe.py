"""Dresses a body: skin, hair, clothes, shoes and a bag, as one coloured mesh with skinning weights. Pure.

MakeHuman's base mesh has helper surfaces for this: a suit around the body, a skirt to the ankles and long
hair. A garment is a part of them, pushed outwards. Colours are sRGB, 0 to 1; folds, stripes and checks are
painted on the vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from people.base_mesh import Body, Indices
from people.mesh import Array, Mesh, joined, piece, rounded_box, triangles, vertex_normals

Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Paint:
    """The colours of a garment."""

    rgb: Rgb
    other: Rgb | None = None
    """The pattern's second colour."""
    pattern: Literal["plain", "stripes", "checks", "yoke", "front"] = "plain"
    """Pattern of the garment; a `front` has a strip of the other colour at the chest, like an open jacket."""
    size_m: float = 0.09
    """A stripe and its gap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outfit:
    """The clothes of one person."""

    skin: Rgb
    hair: Rgb
    hair_style: Literal["short", "long", "bald", "cap", "hood"] = "short"
    top: Paint
    sleeves: Literal["none", "short", "long"] = "long"
    loose_m: float = 0.012
    """Distance of the top from the body."""
    legs: Paint
    legs_to: Literal["ankle", "knee", "bare"] = "ankle"
    skirt: Paint | None = None
    skirt_to: float = 0.5
    """The hem's height as a share of the hip's: 0.5 is the knee's."""
    coat: Paint | None = None
    """Over the top, with long sleeves."""
    coat_to: float = 0.62
    shoes: Rgb = (0.10, 0.09, 0.09)
    bag: Rgb | None = None
    """A backpack's colour."""


@dataclass(frozen=True, slots=True)
class _Regions:
    """The regions of the body."""

    body: Body

    @property
    def hip_m(self) -> float:
        return float(self.body.bone("thigh_l").head[1])

    @property
    def belt_m(self) -> float:
        return float(self.body.bone("spine_01").head[1])

    def under_m(self, outfit: Outfit) -> float:
        """Return the height above which a skirt or a coat hides the legs, m; without either infinite."""
        hems = [outfit.skirt_to] if outfit.skirt else []
        hems += [outfit.coat_to] if outfit.coat else []
        return min(hems) * self.hip_m + 0.10 if hems else np.inf

    def main(self, of: Indices) -> list[str]:
        """Return the name of the bone that moves each vertex most."""
        return [self.body.bones[at].name for at in self.body.weights[of].argmax(axis=1)]

    def along(self, of: Indices, first: str, second: str) -> Array:
        """Return how far each vertex is along a limb: 0 to 1 on its first bone, 1 to 2 on its second."""
        points = self.body.vertices[of]
        result = np.full(len(of), np.nan)
        for at, bone in enumerate(self.main(of)):
            stem = bone[:-2]
            if stem not in {first, second}:
                continue
            this = self.body.bone(bone)
            way = this.tail - this.head
            share = float((points[at] - this.head) @ way / (way @ way))
            result[at] = (0.0 if stem == first else 1.0) + share
        return result


def dressed(body: Body, outfit: Outfit, *, seed: int) -> Mesh:
    """Return the whole mesh of somebody.

    Args:
        body: whose.
        outfit: what they wear.
        seed: of the folds.
    """
    regions = _Regions(body)
    parts = [_head_and_hands(body, regions, outfit)]
    parts += _clothes(body, regions, outfit, np.random.default_rng(seed))
    parts += [_shoes(body, regions, outfit)]
    parts += _hair(body, regions, outfit)
    if outfit.bag is not None:
        parts.append(_backpack(body, outfit.bag))
    return joined(parts)


def _head_and_hands(body: Body, regions: _Regions, outfit: Outfit) -> Mesh:
    """Return everything bare, with a face."""
    quads = body.quads["body"]
    middle = quads[:, 0]
    mains = regions.main(middle)
    arm = regions.along(middle, "upperarm", "lowerarm")
    leg = regions.along(middle, "thigh", "calf")
    sleeve_ends = {"none": -1.0, "short": 0.55, "long": 1.85}["long" if outfit.coat else outfit.sleeves]
    trousers_end = {"ankle": 1.9, "knee": 0.85, "bare": 0.1}[outfit.legs_to]
    collar = body.bone("neck_01").head[1] - 0.02
    bare = np.array(
        [
            name == "head"
            or name.startswith("hand")
            or (name in {"neck_01", "spine_03"} and body.vertices[at, 1] > collar)
            or bool(a > sleeve_ends)
            or bool(b > trousers_end)
            for name, at, a, b in zip(mains, middle, arm.tolist(), leg.tolist(), strict=True)
        ]
    )
    bare &= np.isnan(leg) | (body.vertices[middle, 1] < regions.under_m(outfit))
    hidden = np.array([name.startswith(("foot", "ball")) for name in mains])
    head = np.array([name == "head" for name in mains]) & bare
    rest = bare & ~hidden & ~head
    skin = np.array(outfit.skin)
    parts = [
        piece(body, quads[head], lambda points: _face(body, points, outfit), keep=1500),
        piece(body, quads[rest], lambda points: np.tile(skin, (len(points), 1)), keep=900),
    ]
    eyes = np.concatenate([body.quads["helper-l-eye"], body.quads["helper-r-eye"]])
    parts.append(piece(body, eyes, lambda points: np.full((len(points), 3), 0.16), keep=60))
    return joined(parts)


def _face(body: Body, points: Array, outfit: Outfit) -> Array:
    """Return the colours of a face: brows, lips, cheeks, and the shaven side of a head."""
    skin, hair = np.array(outfit.skin), np.array(outfit.hair)
    colours = np.tile(skin, (len(points), 1))
    eye = body.vertices[np.unique(body.quads["helper-l-eye"])].mean(axis=0)
    mouth = body.vertices[np.unique(body.quads["helper-upper-teeth"])].mean(axis=0)
    side, up = np.abs(points[:, 0]) - eye[0], points[:, 1] - eye[1]
    front = points[:, 2] > eye[2] - 0.035
    sockets = front & (np.hypot(side, up * 1.3) < 0.017)
    brows = front & (np.abs(side) < 0.022) & (np.abs(up - 0.021) < 0.006)
    lips = front & (np.abs(points[:, 0]) < 0.024) & (np.abs(points[:, 1] - mouth[1] + 0.006) < 0.011)
    colours[sockets] = 0.72 * skin
    colours[brows] = 0.35 * skin + 0.65 * hair
    colours[lips] = 0.7 * skin + 0.3 * np.array([0.65, 0.25, 0.25])
    return colours


def _clothes(body: Body, regions: _Regions, outfit: Outfit, rng: np.random.Generator) -> list[Mesh]:
    """Return the top, what covers the legs, and what hangs over both."""
    suit = body.quads["helper-tights"]
    middle = suit[:, 0]
    mains = regions.main(middle)
    arm = regions.along(middle, "upperarm", "lowerarm")
    leg = regions.along(middle, "thigh", "calf")
    height = body.vertices[middle, 1]
    trunk = np.array([name.startswith(("spine", "clavicle", "neck", "pelvis")) for name in mains])
    on_leg = ~np.isnan(leg)
    hem = regions.hip_m - 0.02
    collar = body.bone("neck_01").head[1] + 0.03
    sleeve = {"none": 0.02, "short": 0.62, "long": 2.0}[outfit.sleeves]
    top = (trunk & (height > hem) & (height < collar)) | (arm < sleeve) | (on_leg & (height > hem))
    pieces = []
    ends = {"ankle": 2.0, "knee": 0.95, "bare": 0.12}[outfit.legs_to]
    trousers = (on_leg & (leg < ends)) | (trunk & (height < regions.belt_m + 0.01))
    trousers &= height < regions.under_m(outfit)
    feet = np.array([name.startswith("foot") for name in mains]) & (height > 0.06)
    if outfit.legs_to == "ankle":
        trousers |= feet
    pieces.append(_garment(body, suit[trousers], outfit.legs, rng, out_m=_leg_room(regions)))
    pieces.append(_garment(body, suit[top], outfit.top, rng, out_m=outfit.loose_m))
    if outfit.skirt is not None:
        pieces.append(_hanging(body, regions, outfit.skirt, outfit.skirt_to, rng, out_m=0.012))
    if outfit.coat is not None:
        over = (trunk & (height > hem) & (height < collar)) | (arm < 1.95) | (on_leg & (height > hem))
        pieces.append(_garment(body, suit[over], outfit.coat, rng, out_m=outfit.loose_m + 0.018))
        pieces.append(_hanging(body, regions, outfit.coat, outfit.coat_to, rng, out_m=0.03))
    return pieces


def _leg_room(regions: _Regions) -> Callable[[Indices], Array]:
    """Return how far trousers stand off: more below the knee, where they hang."""

    def out_m(of: Indices) -> Array:
        share = np.nan_to_num(regions.along(of, "thigh", "calf"), nan=0.0)
        return 0.007 + 0.014 * np.clip(share - 0.5, 0.0, 1.2)

    return out_m


def _hanging(
    body: Body, regions: _Regions, paint: Paint, to: float, rng: np.random.Generator, *, out_m: float
) -> Mesh:
    """Return the part of the skirt above a hem."""
    quads = body.quads["helper-skirt"]
    above = body.vertices[quads].mean(axis=1)[:, 1] > to * regions.hip_m
    return _garment(body, quads[above], paint, rng, out_m=out_m)


def _garment(
    body: Body,
    quads: Indices,
    paint: Paint,
    rng: np.random.Generator,
    *,
    out_m: float | Callable[[Indices], Array],
) -> Mesh:
    """Return a part of a surface, pushed outwards and painted."""
    used, faces = triangles(quads)
    points = body.vertices[used]
    normals = vertex_normals(points, faces)
    away = out_m if isinstance(out_m, float) else out_m(used)[:, None]
    folds = 0.006 * _smooth_noise(points, rng, 0.12)
    placed = points + normals * (away + folds[:, None])
    colours = _painted(paint, points) * (1.0 + 0.10 * _smooth_noise(points, rng, 0.07))[:, None]
    return Mesh(placed, faces, np.clip(colours, 0.0, 1.0), body.weights[used])


def _painted(paint: Paint, points: Array) -> Array:
    """Return the colour of each vertex, (N, 3)."""
    first = np.array(paint.rgb)
    second = first if paint.other is None else np.array(paint.other)
    x, y, z = points.T
    if paint.pattern == "stripes":
        share = (y / paint.size_m) % 1.0 < 0.5
    elif paint.pattern == "checks":
        around = np.arctan2(x, z) * 0.16
        share = ((y / paint.size_m) % 1.0 < 0.5) ^ ((around / paint.size_m) % 1.0 < 0.5)
    elif paint.pattern == "yoke":
        share = y < float(np.quantile(y, 0.6))
    elif paint.pattern == "front":
        share = ~((np.abs(x) < 0.055) & (z > 0.0))
    else:
        share = np.ones(len(points), bool)
    return np.where(share[:, None], first, second)


def _shoes(body: Body, regions: _Regions, outfit: Outfit) -> Mesh:
    """Return the feet, a little larger, with a sole."""
    quads = body.quads["body"]
    mains = regions.main(quads[:, 0])
    feet = np.array([name.startswith(("foot", "ball")) for name in mains])
    low = body.vertices[quads].mean(axis=1)[:, 1] < body.bone("foot_l").head[1] + 0.03
    mesh = piece(body, quads[feet & low], lambda points: np.tile(outfit.shoes, (len(points), 1)), keep=700)
    mesh.points = mesh.points + 0.007 * mesh.normals()
    mesh.points[:, 1] = np.maximum(mesh.points[:, 1], 0.0)
    mesh.colours[mesh.points[:, 1] < 0.018] = 0.75 * np.array(outfit.shoes) + 0.10
    return mesh


def _hair(body: Body, regions: _Regions, outfit: Outfit) -> list[Mesh]:
    """Return the hair, a cap, or a hood; nothing on a bald head."""
    if outfit.hair_style == "bald":
        return []
    eye = body.vertices[np.unique(body.quads["helper-l-eye"])].mean(axis=0)
    pieces = []
    quads = body.quads["body"]
    mains = regions.main(quads[:, 0])
    middle = body.vertices[quads].mean(axis=1)
    top = float(body.vertices[quads, 1].max())
    # The hairline falls from the forehead to the nape.
    head_depth = eye[2] - float(body.bone("head").head[2])
    back = (eye[2] - middle[:, 2]) / max(head_depth, 0.05)
    line = np.interp(
        back, [0.0, 0.35, 1.0, 1.8], [eye[1] + 0.055, eye[1] + 0.045, eye[1] - 0.015, eye[1] - 0.06]
    )
    scalp = np.array([name == "head" for name in mains]) & (middle[:, 1] > line)
    thick = {"short": 0.014, "long": 0.020, "cap": 0.016, "hood": 0.026}[outfit.hair_style]
    colour = outfit.hair if outfit.hair_style in {"short", "long"} else outfit.top.rgb
    mesh = piece(body, quads[scalp], lambda points: np.tile(colour, (len(points), 1)), keep=500)
    crown = np.clip((mesh.points[:, 1] - eye[1]) / (top - eye[1]), 0.0, 1.0)
    mesh.points = mesh.points + mesh.normals() * (thick * (0.4 + 0.6 * crown))[:, None]
    pieces.append(mesh)
    if outfit.hair_style == "long":
        long = body.quads["helper-hair"]
        used, faces = triangles(long)
        down = body.vertices[used]
        centre = down[faces].mean(axis=1)
        before_face = (centre[:, 2] > eye[2] - 0.06) & (centre[:, 1] < eye[1] + 0.04)
        keep = (centre[:, 1] > body.bone("spine_03").head[1] + 0.05) & ~before_face
        pieces.append(
            Mesh(down, faces[keep], np.tile(np.array(outfit.hair), (len(used), 1)), body.weights[used])
        )
    return pieces


def _backpack(body: Body, rgb: Rgb) -> Mesh:
    """Return a rounded box on the back, with straps."""
    spine = body.bone("spine_03").head
    suit = body.vertices[np.unique(body.quads["helper-tights"])]
    near = suit[np.abs(suit[:, 1] - spine[1]) < 0.15]
    back, front = float(near[:, 2].min()), float(near[:, 2].max())
    colour = np.array(rgb)
    bag = (np.array([0.15, 0.22, 0.075]), np.array([0.0, spine[1] + 0.04, back - 0.09]), colour)
    straps = [
        (
            np.array([0.022, 0.20, 0.006]),
            np.array([side * 0.10, spine[1] + 0.06, 0.9 * front + 0.03]),
            0.7 * colour,
        )
        for side in (-1.0, 1.0)
    ]
    pieces = []
    for half, at, painted in (bag, *straps):
        points, faces = rounded_box(half, 7)
        weights = np.zeros((len(points), len(body.bones)))
        weights[:, body.place["spine_03"]] = 1.0
        shade = 0.85 + 0.15 * (points[:, 1:2] > 0)
        pieces.append(Mesh(points + at, faces, painted * shade, weights))
    return joined(pieces)


def _smooth_noise(points: Array, rng: np.random.Generator, size_m: float) -> Array:
    """Return noise of about unit size that varies over `size_m`: a few random waves."""
    waves = rng.normal(size=(6, 3)) * (2 * np.pi / size_m) * 0.5
    phases = rng.uniform(0, 2 * np.pi, 6)
    noise: Array = np.sin(points @ waves.T + phases).mean(axis=1) * 1.7
    return noise
