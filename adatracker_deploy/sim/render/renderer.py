"""Draws pictures of a scene and its people with Panda3D, and the class mask of the same pixels.

The software rasteriser is Panda3D's own ``p3tinydisplay``. One engine serves all renderers of a process.
Nothing is transparent but shadows, so the opacity of a pixel says whose it is, and one drawing gives both.
"""

from __future__ import annotations

import functools
import importlib.util
import math
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim.footprint import FreeSpace
from adatracker_deploy.sim.render import fog, meshes, textures
from adatracker_deploy.sim.render.figure import Figure
from adatracker_deploy.sim.render.nodes import geom, light, sky, soft_shadow, texture, white

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.sim.person import Gait
    from adatracker_deploy.sim.render.meshes import Mesh
    from adatracker_deploy.sim.render.nodes import Daylight
    from adatracker_deploy.sim.scene import Part, Rgb, Scene, Thing

    _Painter = Callable[[Rgb, int], NDArray[np.uint8]]

_NEAR_M, _FAR_M = 0.05, 400.0
_STOOL_RGB = (0.35, 0.26, 0.18)
_LEVELS = 2
"""Levels of opacity for each body: body n is drawn at 2n + 1, and comes out there or one lower. The ground,
walls and the sky are opaque."""
_MOST_BODIES = 256 // _LEVELS - 2
_QUIET = (
    "load-display p3tinydisplay",
    "audio-library-name null",
    "notify-level warning",
    "notify-level-display error",
    "textures-power-2 up",
    "sync-video false",
    "model-cache-dir",
    "garbage-collect-states false",  # which hold textures, and are collected only while something is drawn
)


def check_renderer() -> None:
    """Check that pictures can be drawn.

    Raises:
        UsageError: Panda3D or its glTF loader is not installed.
    """
    for module in ("panda3d", "gltf"):
        if importlib.util.find_spec(module) is None:
            raise UsageError(
                "pictures of the virtual world need panda3d and panda3d-gltf: "
                "pip install 'adatracker-deploy[world]'"
            )


@functools.cache
def _engine() -> tuple[Any, Any]:
    """Return Panda3D's engine and the software rasteriser's pipe.

    It draws what is opaque in the scene's order. By default that is by addresses in memory, on which then
    depends which of two surfaces is seen where their depths, of 16 bits, are equal.
    """
    from panda3d import core as p3d

    p3d.load_prc_file_data("", "\n".join(_QUIET))
    bins = p3d.CullBinManager.get_global_ptr()
    bins.set_bin_type(bins.find_bin("opaque"), p3d.CullBinManager.BT_unsorted)
    pipe = p3d.GraphicsPipeSelection.get_global_ptr().make_pipe("TinyOffscreenGraphicsPipe", "p3tinydisplay")
    return p3d.GraphicsEngine.get_global_ptr(), pipe


class Renderer:
    """Renders one scene with its people.

    Args:
        scene: what stands where.
        obstacles: whether the arena has obstacles.
        people: the file of each person, the target first.
        daylight: the hour.
        seed: of stains and clouds.

    Raises:
        UsageError: see `check_renderer`, or a person's file cannot be used.
    """

    def __init__(
        self, scene: Scene, *, obstacles: bool, people: list[Path], daylight: Daylight, seed: int
    ) -> None:
        check_renderer()
        from panda3d import core as p3d

        self._p3d = p3d
        self._daylight = daylight
        self._root = p3d.NodePath("world")
        weakref.finalize(self, self._root.clear_light)  # a lit node and its light keep each other
        self._root.set_shader_off()
        light(self._root, daylight)
        self._sky = self._root.attach_new_node(sky(scene, daylight, seed))
        self._bodies: list[_Body] = []
        self._classes = np.full(256, MaskClass.BACKGROUND, np.uint8)
        self._build(scene, obstacles=obstacles, seed=seed)
        self._scene = scene
        self._figures = [Figure(path) for path in people]
        self._shadows = []
        self._stools: list[Any] = []
        for place, figure in enumerate(self._figures):
            figure.root.reparent_to(self._root)
            self._number(figure.body, MaskClass.PERSON if place else MaskClass.TARGET)
            self._stools.append(self._stool(figure))
            self._shadows.append(self._root.attach_new_node(soft_shadow(daylight, figure.height_m)))
        self._views: dict[tuple[int, int], _View] = {}

    def place(
        self,
        index: int,
        foot: tuple[float, float, float],
        heading: float,
        gait: Gait,
        t_s: float,
    ) -> None:
        """Place a person.

        Args:
            index: who, 0 is the target.
            foot: where, m.
            heading: which way they face, rad.
            gait: how they walk.
            t_s: the world's time.
        """
        figure = self._figures[index]
        figure.pose(gait.walked_m, gait.speed_m_s, t_s, gait.seated)
        if self._stools[index] is not None:
            (self._stools[index].show if gait.seated else self._stools[index].hide)()
        figure.root.set_pos(*foot)
        figure.root.set_h(math.degrees(heading))
        self._shadows[index].set_pos(foot[0], foot[1], foot[2] + 0.012)

    def draw(
        self, camera: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and the RGB picture (height, width, 3) of the same pixels.

        Args:
            camera: its pose, x along the optical axis.
            fov_rad: horizontal field of view; pixels are square.
            height: rows, px.
            width: columns, px.
        """
        size = (height, width)
        if size not in self._views:
            self._views[size] = _View(self._root, height, width)
        self._sky.set_pos(camera.x, camera.y, 0.0)
        pixels = self._views[size].draw(camera, fov_rad)
        opacity = cv2.extractChannel(pixels, 3)
        mask = np.asarray(cv2.LUT(opacity, self._classes), np.uint8)
        picture = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGB), np.uint8)
        if self._daylight.fog_m:
            distance_m = fog.background_m(camera, fov_rad, height, width, self._scene)
            bodies_m = np.full(256 // _LEVELS, np.inf, np.float32)
            for number, body in enumerate(self._bodies):
                bodies_m[number] = self._away_m(body, camera)
            distance_m = np.minimum(distance_m, bodies_m[opacity // _LEVELS])
            picture = fog.fogged(picture, distance_m, self._daylight.fog_m, self._scene.haze_rgb)
        return mask, picture

    def _number(self, node: Any, kind: MaskClass, solids: FreeSpace | None = None) -> None:
        """Let the pixels of somebody or something say whose they are."""
        number = len(self._bodies)
        if number == _MOST_BODIES:
            raise UsageError(f"more than {_MOST_BODIES} people and things cannot be drawn")
        level = _LEVELS * number + 1
        node.set_color_scale(1.0, 1.0, 1.0, level / 255.0)
        node.set_material(white())
        self._classes[level - 1 : level + 1] = kind
        self._bodies.append(_Body(node, solids))

    def _stool(self, figure: Figure) -> Any:
        """Return what somebody sits on, which is there while they do; None if they never sit."""
        if figure.seat is None:
            return None
        ahead, high = figure.seat
        stool = figure.root.attach_new_node(geom(meshes.box((0.14, 0.19, high / 2)), "stool"))
        stool.set_pos(ahead, 0.0, high / 2)
        stool.set_texture(texture(textures.plaster(_STOOL_RGB, 0)))
        stool.hide()
        self._number(stool, MaskClass.OBSTACLE)
        return stool

    def _away_m(self, body: _Body, camera: Pose) -> float:
        """Return how far the nearest point of somebody or something is."""
        if body.solids is not None:
            return max(0.0, float(body.solids.clearance(np.array([[camera.x, camera.y]]))[0]))
        foot = body.node.get_pos(self._root)
        return math.hypot(camera.x - foot.x, camera.y - foot.y)

    def _build(self, scene: Scene, *, obstacles: bool, seed: int) -> None:
        image, repeat_m = textures.ground(scene.ground, seed)
        floor = self._root.attach_new_node(geom(meshes.ground(scene.terrain, repeat_m), "ground"))
        floor.set_texture(texture(image))
        if scene.wall_height_m:
            thick, half_x, half_y = 0.1, scene.half_x_m, scene.half_y_m
            tall = scene.wall_height_m / 2
            for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                half = (thick if x else half_x + 2 * thick, thick if y else half_y + 2 * thick, tall)
                wall = self._root.attach_new_node(geom(meshes.box(half), "wall"))
                wall.set_pos(x * (half_x + thick), y * (half_y + thick), tall)
                wall.set_texture(texture(textures.plaster(scene.wall_rgb, seed)))
        for number, thing in enumerate(scene.everything(obstacles=obstacles)):
            self._add(thing, scene, seed + number)

    def _add(self, thing: Thing, scene: Scene, seed: int) -> None:
        node = self._root.attach_new_node("thing")
        solids = thing.solids(scene.terrain.height(thing.x, thing.y))
        self._number(node, MaskClass.OBSTACLE, FreeSpace(math.inf, math.inf, list(solids), math.inf))
        node.set_pos(thing.x, thing.y, scene.terrain.height(thing.x, thing.y))
        node.set_h(math.degrees(thing.yaw))
        # A node costs as much as many triangles: one for each surface.
        surfaces: dict[tuple[_Painter, Rgb], list[Mesh]] = {}
        for part in thing.parts:
            surfaces.setdefault((_painter(part), part.rgb), []).append(meshes.of_part(part))
        for (paint, rgb), parts in surfaces.items():
            surface = node.attach_new_node(geom(meshes.joined(parts), "surface"))
            surface.set_texture(texture(paint(rgb, seed % 5)))


def _painter(part: Part) -> _Painter:
    red, green, blue = part.rgb
    if part.windows:
        return textures.facade
    return textures.leaves if part.shape == "ellipsoid" and green > max(red, blue) else textures.plaster


class _Body(NamedTuple):
    """Somebody or something that the masks tell from the ground."""

    node: Any
    solids: FreeSpace | None
    """Pose of a thing; people are where their node is."""


class _View:
    """A buffer of one size."""

    def __init__(self, root: Any, height: int, width: int) -> None:
        from panda3d import core as p3d

        self._p3d = p3d
        self._size = height, width
        self._lens = p3d.PerspectiveLens()
        self._lens.set_near_far(_NEAR_M, _FAR_M)
        self._lens.set_film_size(width, height)
        self._camera = root.attach_new_node(p3d.Camera("camera", self._lens))
        engine, pipe = _engine()
        wants = p3d.FrameBufferProperties()
        wants.set_rgb_color(True)
        wants.set_depth_bits(16)
        self._buffer = engine.make_output(
            pipe,
            "picture",
            0,
            wants,
            p3d.WindowProperties.size(width, height),
            p3d.GraphicsPipe.BF_refuse_window,
        )
        if self._buffer is None:
            raise UsageError("panda3d cannot draw on this machine: its software rasteriser did not start")
        weakref.finalize(self, _let_go, self._buffer)
        self._buffer.set_active(False)
        self._buffer.set_clear_color((0.0, 0.0, 0.0, 1.0))
        self._texture = p3d.Texture("picture")
        self._buffer.add_render_texture(self._texture, p3d.GraphicsOutput.RTM_copy_ram)
        self._buffer.make_display_region().set_camera(self._camera)

    def draw(self, camera: Pose, fov_rad: float) -> NDArray[np.uint8]:
        """Return blue, green, red and opacity of each pixel (height, width, 4), from the top."""
        height, width = self._size
        self._lens.set_focal_length(width / 2 / math.tan(fov_rad / 2))
        self._camera.set_mat(self._p3d.LMatrix4f(*_camera_matrix(camera).reshape(-1).tolist()))
        self._buffer.set_active(True)
        _engine()[0].render_frame()
        self._buffer.set_active(False)  # other views of this process are drawn in their own turn
        data = np.frombuffer(self._texture.get_ram_image(), np.uint8)
        return np.ascontiguousarray(data.reshape(height, width, 4)[::-1])


def _let_go(buffer: Any) -> None:
    """Free a buffer, which the engine would keep, and what it shows."""
    buffer.remove_all_display_regions()
    buffer.clear_render_textures()
    _engine()[0].remove_window(buffer)


def _camera_matrix(pose: Pose) -> NDArray[np.float64]:
    """Return Panda3D's matrix of a camera, rows: right, ahead, up, position."""
    turn = pose.rotation()
    matrix = np.eye(4)
    matrix[0, :3], matrix[1, :3], matrix[2, :3] = -turn[:, 1], turn[:, 0], turn[:, 2]
    matrix[3, :3] = pose.translation()
    return matrix
