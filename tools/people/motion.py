"""Motion of a body that walks, stands or sits: rotations of its bones over one cycle. Pure.

The angles of hip, knee and ankle over a walking cycle follow the normative curves at natural cadence in
D. A. Winter, "Biomechanics and Motor Control of Human Movement" (appendix), read off at a dozen points. Arms
swing against the legs and the trunk turns against the pelvis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from people.base_mesh import Body

Array = NDArray[np.float64]

KEYS = 24
"""Key frames of a walking cycle."""
_CYCLE = np.array([0, 7, 15, 25, 40, 50, 60, 72, 80, 90, 97]) / 100
"""Share of the cycle, from one heel's contact to its next."""
_HIP = np.array([30, 28, 24, 14, -3, -10, -6, 15, 26, 32, 31])
_KNEE = np.array([5, 13, 18, 14, 6, 12, 37, 62, 50, 18, 4])
_ANKLE = np.array([0, -6, -1, 5, 10, 7, -17, -6, 0, 1, 0])
"""Flexion at these shares, degrees; of the ankle, toes up."""
_ARM_HANGS_DEG = 9.0
"""From the body's side."""
_DOWN = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Key frames of one animation.

    Attributes:
        seconds: the time of each, (K,).
        turns: of each bone against its parent's, unit quaternions (K, B, 4), x, y, z, w.
        shift: of the root bone, m, (K, 3).
    """

    seconds: Array
    turns: Array
    shift: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pose:
    """Angles of one moment, degrees; pairs are left and right."""

    hip: tuple[float, float] = (2.0, 2.0)
    knee: tuple[float, float] = (4.0, 4.0)
    ankle: tuple[float, float] = (2.0, 2.0)
    arm: tuple[float, float] = (0.0, 0.0)
    """Forward swing of the upper arm."""
    elbow: tuple[float, float] = (14.0, 14.0)
    pelvis_yaw: float = 0.0
    """To the left."""
    pelvis_roll: float = 0.0
    """The left side higher."""
    lean: float = 2.0
    """Lean of the trunk, forward."""


def walk(body: Body, *, arms: float = 1.0, stoop: float = 2.0) -> Motion:
    """Return a cycle of two steps, which begins with the left heel's contact, in one second.

    Args:
        body: whose.
        arms: how far they swing, times the usual.
        stoop: the trunk's lean, degrees.
    """
    poses = []
    for share in np.arange(KEYS + 1) / KEYS:
        both = share % 1.0, (share + 0.5) % 1.0
        hip, knee, ankle = ([_at(curve, one) for one in both] for curve in (_HIP, _KNEE, _ANKLE))
        swing = np.cos(2 * np.pi * share)
        poses.append(
            _Pose(
                hip=(hip[0], hip[1]),
                knee=(knee[0], knee[1]),
                ankle=(ankle[0], ankle[1]),
                arm=(-22.0 * arms * swing + 3.0, 22.0 * arms * swing + 3.0),
                elbow=(20.0 - 9.0 * arms * swing, 20.0 + 9.0 * arms * swing),
                pelvis_yaw=-5.0 * swing,  # the left hip goes ahead with the left leg
                pelvis_roll=3.0 * float(np.sin(2 * np.pi * (share + 0.05))),
                lean=stoop,
            )
        )
    return _motion(body, poses, np.arange(KEYS + 1) / KEYS)


def stand(body: Body, *, stoop: float = 1.0) -> Motion:
    """Return breathing and a little sway, four seconds long."""
    seconds = np.linspace(0.0, 4.0, 9)
    sway = np.sin(2 * np.pi * seconds / 4.0)
    poses = [
        _Pose(lean=stoop + 0.6 * one, arm=(1.0 + one, 2.0 - one), pelvis_roll=0.8 * one)
        for one in sway.tolist()
    ]
    return _motion(body, poses, seconds)


def sit(body: Body) -> Motion:
    """Return how somebody sits down on a low seat, within 1.6 seconds, and stays."""
    seconds = np.linspace(0.0, 1.6, 13)
    poses = []
    for done in (0.5 - 0.5 * np.cos(np.pi * seconds / 1.6)).tolist():
        bow = 30.0 * float(np.sin(np.pi * done))
        hip, knee = 2.0 + 86.0 * done, 4.0 + 86.0 * done
        poses.append(
            _Pose(
                hip=(hip, hip),
                knee=(knee, knee),
                ankle=(2.0, 2.0),
                arm=(25.0 * done, 25.0 * done),
                elbow=(14.0 + 50.0 * done, 14.0 + 50.0 * done),
                lean=2.0 + bow,
            )
        )
    return _motion(body, poses, seconds)


def _at(curve: Array, share: float) -> float:
    """Return a periodic curve's value: a Catmull-Rom spline through its points."""
    count = len(_CYCLE)
    times = np.concatenate([_CYCLE - 1.0, _CYCLE, _CYCLE + 1.0])
    values = np.tile(curve, 3).astype(float)
    k = int(np.searchsorted(times, share, side="right")) - 1
    k = min(max(k, count - 1), 2 * count)
    t0, t1 = times[k], times[k + 1]
    u = (share - t0) / (t1 - t0)
    m0 = (values[k + 1] - values[k - 1]) / (times[k + 1] - times[k - 1]) * (t1 - t0)
    m1 = (values[k + 2] - values[k]) / (times[k + 2] - times[k]) * (t1 - t0)
    a, b = values[k], values[k + 1]
    return float(
        (2 * u**3 - 3 * u**2 + 1) * a
        + (u**3 - 2 * u**2 + u) * m0
        + (-2 * u**3 + 3 * u**2) * b
        + (u**3 - u**2) * m1
    )


def _motion(body: Body, poses: list[_Pose], seconds: Array) -> Motion:
    turned = [_world_turns(body, pose) for pose in poses]
    parents = [body.place.get(bone.parent, -1) for bone in body.bones]
    turns = np.empty((len(poses), len(body.bones), 4))
    shift = np.zeros((len(poses), 3))
    for k, world in enumerate(turned):
        for at, parent in enumerate(parents):
            turns[k, at] = _quaternion(world[at] if parent < 0 else world[parent].T @ world[at])
        shift[k, 1] = -_lowest(body, world)
    for k in range(1, len(poses)):  # neighbours on the same side of the sphere, for interpolation
        flips = np.einsum("bq,bq->b", turns[k], turns[k - 1]) < 0
        turns[k, flips] *= -1
    return Motion(seconds=seconds, turns=turns, shift=shift)


def _world_turns(body: Body, pose: _Pose) -> list[Array]:
    """Return each bone's rotation against the body's frame at rest, (3, 3) each."""
    world: dict[str, Array] = {}
    pelvis = _about_y(pose.pelvis_yaw) @ _about_z(pose.pelvis_roll)
    against = _about_x(pose.lean) @ _about_y(-pose.pelvis_yaw)
    half = _about_x(pose.lean / 2)
    fixed = {
        "Root": np.eye(3),
        "pelvis": pelvis,
        "spine_01": half,
        "spine_02": _about_x(pose.lean) @ _about_y(-pose.pelvis_yaw / 2),
        "spine_03": against,
        "neck_01": _about_x(pose.lean / 2),
        "head": np.eye(3),
        "clavicle_l": against,
        "clavicle_r": against,
    }
    for bone in body.bones:
        name, side = bone.name[:-2], int(bone.name.endswith("_r"))
        ahead = pose.hip[side]
        outward = -1.0 if side else 1.0
        if bone.name in fixed:
            turn = fixed[bone.name]
        elif name == "thigh":
            turn = pelvis @ _about_x(-ahead) @ _to(bone.tail - bone.head, _DOWN)
        elif name == "calf":
            turn = pelvis @ _about_x(-(ahead - pose.knee[side])) @ _to(bone.tail - bone.head, _DOWN)
        elif name in {"foot", "ball"}:
            pitch = ahead - pose.knee[side] + pose.ankle[side]
            bent = 0.0 if name == "foot" else min(30.0, max(0.0, -pitch))  # toes stay flat at push-off
            splay = 7.0 * outward
            turn = _about_y(splay) @ _about_x(-(pitch + bent)) @ _straight_ahead(body, bone.name[-2:])
        elif name == "upperarm":
            hangs = _about_z(_ARM_HANGS_DEG * outward) @ _DOWN
            turn = against @ _about_x(-pose.arm[side]) @ _to(bone.tail - bone.head, hangs)
        elif name == "lowerarm":
            hangs = _about_z(0.4 * _ARM_HANGS_DEG * outward) @ _DOWN
            ahead = pose.arm[side] + pose.elbow[side]
            turn = against @ _about_x(-ahead) @ _to(bone.tail - bone.head, hangs)
        else:  # hands go with their forearms
            turn = world[bone.parent]
        world[bone.name] = turn
    return [world[bone.name] for bone in body.bones]


def _straight_ahead(body: Body, side: str) -> Array:
    """Return the turn about the vertical that points a foot ahead, without splay."""
    way = body.bone(f"foot{side}").tail - body.bone(f"foot{side}").head
    return _about_y(-np.degrees(np.arctan2(way[0], way[2])))


def _lowest(body: Body, world: list[Array]) -> float:
    """Return how low the soles are, m, when the root is where it is at rest."""
    heads: dict[str, Array] = {}
    low = np.inf
    for at, bone in enumerate(body.bones):
        if not bone.parent:
            heads[bone.name] = bone.head
        else:
            rest = bone.head - body.bone(bone.parent).head
            heads[bone.name] = heads[bone.parent] + world[body.place[bone.parent]] @ rest
        if bone.name.startswith(("foot", "ball")):
            sole = _sole(body, at)
            if len(sole):
                placed = heads[bone.name] + (sole - bone.head) @ world[at].T
                low = min(low, float(placed[:, 1].min()))
    return low


def _sole(body: Body, bone: int) -> Array:
    """Return the vertices under a foot that go with one of its bones, (N, 3)."""
    skin = np.unique(body.quads["body"])
    own = skin[(body.weights[skin, bone] > 0.6) & (body.vertices[skin, 1] < 0.03)]
    sole: Array = body.vertices[own]
    return sole


def _about_x(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _about_y(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _about_z(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _to(way: Array, wanted: Array) -> Array:
    """Return the smallest rotation that takes one direction to another (Rodrigues' formula)."""
    a, b = way / np.linalg.norm(way), wanted / np.linalg.norm(wanted)
    x, y, z = np.cross(a, b)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: Array = np.eye(3) + cross + cross @ cross / (1.0 + float(a @ b))
    return rotation


def _quaternion(turn: Array) -> Array:
    """Return a rotation's unit quaternion, x, y, z, w (Shepperd's method)."""
    trace = float(np.trace(turn))
    squares = np.array([turn[0, 0], turn[1, 1], turn[2, 2], trace])
    largest = int(squares.argmax())
    q = np.empty(4)
    if largest == 3:
        q[:3] = (turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
        q[3] = 1 + trace
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i] = 1 - trace + 2 * turn[i, i]
        q[j], q[k] = turn[j, i] + turn[i, j], turn[k, i] + turn[i, k]
        q[3] = turn[k, j] - turn[j, k]
    return q / np.linalg.norm(q)
