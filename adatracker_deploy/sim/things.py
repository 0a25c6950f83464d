"""Objects of the scenes, each of a few primitives; real-life sizes in metres."""

from __future__ import annotations

from adatracker_deploy.sim.scene import Part, Rgb, Thing

_BARK = (0.33, 0.24, 0.17)
_STEEL = (0.42, 0.44, 0.46)
_TYRE = (0.08, 0.08, 0.09)
_GLASS = (0.16, 0.20, 0.25)
_SNOW = (0.93, 0.95, 0.98)


def crate(x: float, y: float, yaw: float, size: tuple[float, float, float], rgb: Rgb) -> Thing:
    """Return a box of this length, width and height."""
    half = (size[0] / 2, size[1] / 2, size[2] / 2)
    return Thing(x=x, y=y, yaw=yaw, parts=(Part(shape="box", half=half, at=(0.0, 0.0, half[2]), rgb=rgb),))


def column(x: float, y: float, radius_m: float, height_m: float, rgb: Rgb) -> Thing:
    """Return an upright cylinder."""
    return Thing(x=x, y=y, parts=(_cylinder(radius_m, 0.0, height_m, rgb),))


def car(x: float, y: float, yaw: float, rgb: Rgb) -> Thing:
    """Return a parked car, 4.3 m long, 1.8 m wide, 1.45 m high."""
    wheels = tuple(
        Part(shape="ellipsoid", half=(0.33, 0.12, 0.33), at=(ahead, side, 0.33), rgb=_TYRE)
        for ahead in (-1.35, 1.35)
        for side in (-0.84, 0.84)
    )
    hull = (
        Part(shape="box", half=(2.15, 0.88, 0.30), at=(0.0, 0.0, 0.58), rgb=rgb),
        Part(shape="box", half=(1.10, 0.78, 0.20), at=(-0.15, 0.0, 1.08), rgb=_GLASS),
        Part(shape="box", half=(0.95, 0.74, 0.08), at=(-0.15, 0.0, 1.36), rgb=rgb),
    )
    return Thing(x=x, y=y, yaw=yaw, parts=hull + wheels)


def lamp_post(x: float, y: float) -> Thing:
    """Return a street lamp, 5 m high."""
    head = Part(shape="ellipsoid", half=(0.35, 0.35, 0.16), at=(0.0, 0.0, 5.0), rgb=(0.95, 0.93, 0.80))
    return Thing(x=x, y=y, parts=(_cylinder(0.09, 0.0, 5.0, _STEEL), _cylinder(0.17, 0.0, 0.5, _STEEL), head))


def tree(x: float, y: float, size: float, green: Rgb) -> Thing:
    """Return a broad-leaved tree, `size` times 5 m high, its crown above head height."""
    crown = (
        Part(
            shape="ellipsoid", half=(1.4 * size,) * 2 + (1.25 * size,), at=(0.0, 0.0, 3.7 * size), rgb=green
        ),
        Part(
            shape="ellipsoid",
            half=(0.9 * size,) * 3,
            at=(0.6 * size, 0.5 * size, 3.4 * size),
            rgb=(green[0] * 0.85, green[1] * 0.85, green[2] * 0.85),
        ),
    )
    return Thing(x=x, y=y, parts=(_cylinder(0.16 * size, 0.0, 3.0 * size, _BARK), *crown))


def fir(x: float, y: float, size: float) -> Thing:
    """Return a fir with snow on it, `size` times 4.3 m high, its trunk rooted 0.3 m deep."""
    needles, tip = (0.16, 0.32, 0.24), _SNOW
    tiers = tuple(
        Part(shape="ellipsoid", half=(r * size, r * size, 0.62 * size), at=(0.0, 0.0, z * size), rgb=rgb)
        for r, z, rgb in ((1.1, 1.3, needles), (0.85, 2.1, needles), (0.6, 2.9, needles), (0.35, 3.7, tip))
    )
    return Thing(x=x, y=y, parts=(_cylinder(0.14 * size, -0.3, 1.2 * size, _BARK), *tiers))


def house(
    x: float, y: float, size: tuple[float, float, float], rgb: Rgb, roof: Rgb = (0.40, 0.25, 0.22)
) -> Thing:
    """Return a house of this length, width and height with windows and a flat roof."""
    half_x, half_y, half_z = size[0] / 2, size[1] / 2, size[2] / 2
    walls = Part(shape="box", half=(half_x, half_y, half_z), at=(0.0, 0.0, half_z), rgb=rgb, windows=True)
    eaves = Part(shape="box", half=(half_x + 0.2, half_y + 0.2, 0.2), at=(0.0, 0.0, size[2] + 0.2), rgb=roof)
    return Thing(x=x, y=y, parts=(walls, eaves))


def hut(x: float, y: float, yaw: float, rgb: Rgb) -> Thing:
    """Return a wooden hut, 3.6 m by 3 m, under a heap of snow; its walls go half a metre into the ground."""
    parts = (
        Part(shape="box", half=(1.8, 1.5, 1.4), at=(0.0, 0.0, 0.9), rgb=rgb),
        Part(shape="ellipsoid", half=(2.3, 2.0, 0.75), at=(0.0, 0.0, 2.35), rgb=_SNOW),
        Part(shape="box", half=(0.05, 0.42, 0.95), at=(1.8, 0.0, 0.95), rgb=_BARK),
    )
    return Thing(x=x, y=y, yaw=yaw, parts=parts)


def _cylinder(radius_m: float, bottom_m: float, top_m: float, rgb: Rgb) -> Part:
    half = (top_m - bottom_m) / 2
    return Part(shape="cylinder", half=(radius_m, radius_m, half), at=(0.0, 0.0, bottom_m + half), rgb=rgb)
