"""A person from a glTF file: loaded and checked, then posed by how fast they walk.

The animation ``walk`` is one cycle. Whatever its skeleton, what it covers on the ground is measured on the
mesh itself: the lowest vertex stands still while the body passes over it, so that feet do not slide at any
speed.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.sim.render.motion import FPS, Flesh, Passage, Skin, cycles
from adatracker_deploy.sim.render.nodes import white

if TYPE_CHECKING:
    from numpy.typing import NDArray

PEOPLE = Path(__file__).parent.parent / "people"
"""Folder of the shipped people."""
LARGEST_BYTES = 8 << 20
MOST_TRIANGLES = 100_000
WALK, STAND, SIT = "walk", "stand", "sit"
_MOMENTS = {WALK: 30, STAND: 12, SIT: 12}
"""Moments of each motion: a walk's frames are 1/30 s apart; somebody who stands moves less."""
_PHASES = np.linspace(0.0, 1.0, 48, endpoint=False)
_SHARES = (0.0, 0.5, 1.0)
"""Shares of the walk's cycle, and of walking against standing, at which a body is measured."""
_SEAT_HALF_M = 0.12
"""Half of how far a seat reaches ahead."""
_TO_SITTING = 0.2
"""Share of sitting down in which the posture of standing is left."""
_SLOWEST_M_S = 0.25
"""At this speed and below somebody stands rather than walks."""
_STRIDES_M_S = 0.7
"""At this speed and above the walk is whole."""
_LEAST_CYCLE_M = 0.1
"""Two steps of anybody cover more."""


def shipped_people() -> tuple[Path, ...]:
    """Return the files of the people that ship, in a fixed order."""
    return tuple(sorted(PEOPLE.glob("*.glb")))


def check(path: Path) -> None:
    """Check that a file is a person that can walk.

    Raises:
        UsageError: it cannot be read, is too large, is not binary glTF 2.0, refers to other files, or has no
            skin or no animation called ``walk``.
    """
    try:
        data = path.read_bytes() if path.stat().st_size <= LARGEST_BYTES else None
    except OSError as error:
        raise UsageError(f"person {path}: {error.strerror}") from error
    if data is None:
        raise UsageError(f"person {path}: larger than {LARGEST_BYTES >> 20} MB")
    try:
        document = _header(data)
        trouble = _trouble(document)
    except (
        ValueError,
        struct.error,
        KeyError,
        TypeError,
        AttributeError,
        IndexError,
        RecursionError,
    ) as error:
        raise UsageError(f"person {path}: not a binary glTF 2.0 file") from error
    if trouble:
        raise UsageError(f"person {path}: {trouble}")


def _header(data: bytes) -> dict[str, Any]:
    magic, version, whole, length, kind = struct.unpack_from("<4sIII4s", data)
    if magic != b"glTF" or version != 2 or whole != len(data) or kind != b"JSON" or 20 + length > whole:
        raise ValueError
    document: dict[str, Any] = json.loads(data[20 : 20 + length])
    return document


def _trouble(document: dict[str, Any]) -> str:
    parts = [*document.get("buffers", []), *document.get("images", [])]
    if any("uri" in part and not part["uri"].startswith("data:") for part in parts):
        return "refers to other files: export it as one .glb"
    if not document.get("skins"):
        return "has no skeleton (a skin), so it cannot walk"
    names = [animation.get("name", "") for animation in document.get("animations", [])]
    if WALK not in names:
        found = f"has {', '.join(map(repr, names))}" if names else "has none"
        return f"needs an animation called {WALK!r}, one cycle of two steps: {found}"
    accessors = document["accessors"]
    corners = sum(
        accessors[primitive["indices"]]["count"]
        for mesh in document["meshes"]
        for primitive in mesh["primitives"]
        if "indices" in primitive
    )
    if corners > 3 * MOST_TRIANGLES:
        return f"has {corners // 3} triangles, more than {MOST_TRIANGLES}"
    return ""


@dataclass(frozen=True, slots=True)
class Stride:
    """The ground covered by one cycle of a walk.

    Attributes:
        covered_m: how far the body has moved at each moment of the cycle, rising from 0, (M + 1,).
    """

    covered_m: NDArray[np.float64]

    @property
    def cycle_m(self) -> float:
        """Return the length of two steps."""
        return float(self.covered_m[-1])

    def phase(self, walked_m: float) -> float:
        """Return the share of the cycle, 0 to 1, after walking so far."""
        shares = np.linspace(0.0, 1.0, len(self.covered_m))
        return float(np.interp(walked_m % self.cycle_m, self.covered_m, shares))


def stride_of(moments: NDArray[np.float64]) -> Stride:
    """Measure a walk by its vertices: (M, V, 3), m, x ahead, z up, without the body's own motion. Pure.

    Between two moments the body moves ahead by as much as its lowest vertex moves back.
    """
    count = len(moments)
    lowest = moments[:, :, 2].argmin(axis=1)
    here = moments[np.arange(count), lowest, 0]
    later = np.roll(moments, -1, axis=0)[np.arange(count), lowest, 0]
    steps = np.maximum(here - later, 1e-4)
    return Stride(np.concatenate([[0.0], np.cumsum(steps)]))


def seat_of(points: NDArray[np.float64] | NDArray[np.float32]) -> tuple[float, float]:
    """Return the middle of the seat under somebody who sits (V, 3): how far ahead, and how high.

    It is under the lowest point of their back, where no leg and no foot is.
    """
    back = float(points[:, 0].min())
    behind = points[points[:, 0] < back + 2 * _SEAT_HALF_M]
    return back + _SEAT_HALF_M, float(behind[:, 2].min() - points[:, 2].min())


class Figure:
    """Somebody in a scene graph; made once for each person in it.

    Attributes:
        root: a Panda3D NodePath, x ahead, z up, standing on the origin.
        body: what of it is the person.
        height_m: from the sole to the top of the head.
        stride: what one cycle of the walk covers.
        seat: how far ahead and how high the middle of the seat is on which they sit, m; None if they cannot.
    """

    def __init__(self, path: Path) -> None:
        """Load a person.

        Raises:
            UsageError: see `check`; or its parts do not fit together, or its walk moves nobody.
        """
        check(path)
        from panda3d import core as p3d

        try:
            model = p3d.NodePath(_load(path))
        except (Exception, SystemExit) as error:  # the library raises whatever comes
            raise UsageError(f"person {path}: cannot be loaded: {type(error).__name__}") from error
        self.root = p3d.NodePath("figure")
        model.reparent_to(self.root)
        model.set_h(90.0)  # glTF's ahead is Panda's -y
        _mended(model)
        flesh = Flesh(model, self.root)
        self.height_m = float(np.ptp(flesh.vertices()[:, 2]))
        motions = cycles(model, flesh, _MOMENTS)
        self._walk, self._stand = motions[WALK], motions.get(STAND)
        self._sit = Passage(motions[SIT].moments) if SIT in motions else None
        reach_m = max(float(np.abs(motion.moments[..., :3]).max()) for motion in motions.values())
        self.body = self.root.attach_new_node("body")
        self._skin = Skin(model, self.body, 2.0 * reach_m)
        model.remove_node()
        moments = [[self._mixed(float(phase), share, 0.0)[:, :3] for phase in _PHASES] for share in _SHARES]
        self.stride = stride_of(np.array(moments[-1]))
        if self.stride.cycle_m < _LEAST_CYCLE_M:
            raise UsageError(
                f"person {path}: animation {WALK!r} does not move the feet: is the mesh skinned?"
            )
        self._raised_m = np.array([[-float(points[:, 2].min()) for points in row] for row in moments])
        self.seat = None if self._sit is None else seat_of(self._sit.at(1.0)[:, :3])
        self.pose(0.0, 0.0, 0.0)

    def pose(self, walked_m: float, speed_m_s: float, seconds: float, seated: float = 0.0) -> None:
        """Pose them.

        Args:
            walked_m: how far they have walked in all.
            speed_m_s: how fast they walk now.
            seconds: time, for what a standing body does.
            seated: share of the time that sitting down takes, 0 to 1; ignored without an animation ``sit``.
        """
        share = (speed_m_s - _SLOWEST_M_S) / (_STRIDES_M_S - _SLOWEST_M_S)
        phase = self.stride.phase(walked_m)
        self._vertices = self._mixed(phase, share, seconds)
        if self._sit is not None and seated > 0.0:
            part = np.float32(min(1.0, seated / _TO_SITTING))
            self._vertices = self._vertices + part * (self._sit.at(seated) - self._vertices)
            self._skin.move(self._vertices)
            self.body.set_z(-float(self._vertices[:, 2].min()))
            return
        self._skin.move(self._vertices)
        # Between two steps, a mixture of walking and standing is lower than either.
        heights = [np.interp(phase, _PHASES, raised, period=1.0) for raised in self._raised_m]
        self.body.set_z(float(np.interp(share, _SHARES, heights)))

    def points(self) -> NDArray[np.float64]:
        """Return all vertices as they are posed, (V, 3), m, x ahead, z up from the ground."""
        return np.asarray(self._vertices[:, :3] + np.array([0.0, 0.0, self.body.get_z()]), np.float64)

    def _mixed(self, phase: float, share: float, seconds: float) -> NDArray[np.float32]:
        """Return who walks with a share of the limbs' motion, and stands with the rest, (V, 6)."""
        if self._stand is None or share >= 1.0:
            return self._walk.at(phase)
        still = self._stand.at(seconds / self._stand.lasts_s)
        if share <= 0.0:
            return still
        return np.asarray(still + np.float32(share) * (self._walk.at(phase) - still), np.float32)


def _mended(model: Any) -> None:
    """Let glTF's linear colours show as sRGB, and nothing be transparent."""
    from panda3d import core as p3d

    for texture in model.find_all_textures():
        image = p3d.PNMImage()
        if texture.get_num_components() in {2, 4} and texture.store(image):
            image.remove_alpha()
            texture.load(image)
    for node in model.find_all_matches("**/+GeomNode"):
        geoms = node.node()
        for index, geom in enumerate(geoms.modify_geoms()):
            data = geom.modify_vertex_data()
            geoms.set_geom_state(index, _opaque(geoms.get_geom_state(index), data.has_column("color")))
            if not data.has_column("color"):
                continue
            rewriter = p3d.GeomVertexRewriter(data, "color")
            while not rewriter.is_at_end():
                red, green, blue, _ = rewriter.get_data4()
                rewriter.set_data4(_srgb(red), _srgb(green), _srgb(blue), 1.0)
        node.set_material(white(), 1)
        node.set_attrib(p3d.ColorAttrib.make_vertex())


def _opaque(state: Any, coloured: bool) -> Any:
    """Return a surface's state without transparency; its material's colour stands in for the vertices'."""
    from panda3d import core as p3d

    material = state.get_attrib(p3d.MaterialAttrib)
    for transparent in (p3d.TransparencyAttrib, p3d.AlphaTestAttrib):
        state = state.remove_attrib(transparent)
    if coloured or material is None or material.get_material() is None:
        return state
    red, green, blue, _ = material.get_material().get_base_color()
    return state.set_attrib(p3d.ColorAttrib.make_flat((_srgb(red), _srgb(green), _srgb(blue), 1.0)))


def _srgb(linear: float) -> float:
    """Return the sRGB value of linear light (IEC 61966-2-1)."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def _load(path: Path) -> Any:
    import gltf

    return gltf.load_model(str(path), gltf.GltfSettings(no_srgb=True, animation_fps=FPS))
