"""Draws pictures of a scene and its people with Panda3D, and the class mask of the same pixels.

The software rasteriser is Panda3D's own ``p3tinydisplay``. One engine serves all renderers of a process.
"""

from __future__ import annotations

import functools
import importlib.util
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim.footprint import FreeSpace
from adatracker_deploy.sim.render import fog, meshes, textures
from adatracker_deploy.sim.render.figure import Figure
from adatracker_deploy.sim.render.nodes import geom, light, sky, soft_shadow, texture

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.sim.person import Gait
    from adatracker_deploy.sim.render.nodes import Daylight
    from adatracker_deploy.sim.scene import Part, Scene, Thing

_NEAR_M, _FAR_M = 0.05, 400.0
_MASK_ONLY, _PICTURE_ONLY = 1, 2
"""Bits of the two cameras: shadows and sky are for pictures alone."""
_STOOL_RGB = (0.35, 0.26, 0.18)
_CLASS_STEP = 40
"""Levels of green between two classes in the mask's buffer."""
_NUMBER_STEP = 8
_NUMBERS = 256 // _NUMBER_STEP
"""Levels of red and blue between two bodies' numbers in it: number = red * 32 + blue."""
_CLASS_OF_GREEN = ((np.arange(256) + _CLASS_STEP // 2) // _CLASS_STEP).astype(np.uint8)
_NUMBER_OF_LEVEL = np.minimum((np.arange(256) + _NUMBER_STEP // 2) // _NUMBER_STEP, _NUMBERS - 1).astype(
    np.intp
)
_QUIET = (
    "load-display p3tinydisplay",
    "audio-library-name null",
    "notify-level warning",
    "notify-level-display error",
    "textures-power-2 up",
    "sync-video false",
    "model-cache-dir",
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
        self._root.set_shader_off()
        light(self._root, daylight)
        self._sky = self._root.attach_new_node(sky(scene, daylight, seed))
        self._sky.hide(p3d.BitMask32.bit(_MASK_ONLY))
        self._bodies: list[_Body] = []
        self._build(scene, obstacles=obstacles, seed=seed)
        self._scene = scene
        self._figures = [Figure(path) for path in people]
        self._shadows = []
        self._stools: list[Any] = []
        for place, figure in enumerate(self._figures):
            figure.root.reparent_to(self._root)
            self._number(figure.root, MaskClass.PERSON if place else MaskClass.TARGET)
            self._stools.append(self._stool(figure))
            self._shadows.append(self._root.attach_new_node(soft_shadow(daylight, figure.height_m)))
            self._shadows[-1].hide(p3d.BitMask32.bit(_MASK_ONLY))
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
            self._views[size] = _View(self._root, height, width, self._bodies)
        self._sky.set_pos(camera.x, camera.y, 0.0)
        view = self._views[size]
        mask, picture = view.draw(camera, fov_rad)
        if self._daylight.fog_m:
            distance_m = fog.background_m(camera, fov_rad, height, width, self._scene)
            bodies_m = np.array([np.inf, *(self._away_m(body, camera) for body in self._bodies)], np.float32)
            distance_m = np.minimum(distance_m, bodies_m[view.numbers()])
            picture = fog.fogged(picture, distance_m, self._daylight.fog_m, self._scene.haze_rgb)
        return mask, picture

    def _number(self, node: Any, kind: MaskClass, solids: FreeSpace | None = None) -> None:
        """Give somebody or something the next number in the masks."""
        node.set_tag("class", str(len(self._bodies) + 1))
        self._bodies.append(_Body(kind, node, solids))

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
        for part in thing.parts:
            mesh = node.attach_new_node(geom(meshes.of_part(part), part.shape))
            mesh.set_texture(texture(_image_of(part, seed % 5)))


def _image_of(part: Part, seed: int) -> NDArray[np.uint8]:
    red, green, blue = part.rgb
    if part.windows:
        return textures.facade(part.rgb, seed)
    if part.shape == "ellipsoid" and green > max(red, blue):
        return textures.leaves(part.rgb, seed)
    return textures.plaster(part.rgb, seed)


class _Body(NamedTuple):
    """Somebody or something that the masks tell from the ground."""

    kind: MaskClass
    node: Any
    solids: FreeSpace | None
    """Pose of a thing; people are where their node is."""


class _View:
    """Two buffers of one size: the picture's and the mask's."""

    def __init__(self, root: Any, height: int, width: int, bodies: list[_Body]) -> None:
        from panda3d import core as p3d

        self._p3d = p3d
        self._size = height, width
        self._lens = p3d.PerspectiveLens()
        self._lens.set_near_far(_NEAR_M, _FAR_M)
        self._lens.set_film_size(width, height)
        self._buffers: list[Any] = []
        self._picture, self._camera = self._buffer(root, "picture", _PICTURE_ONLY)
        self._mask, self._mask_camera = self._buffer(root, "mask", _MASK_ONLY)
        flat = self._mask_camera.node()
        flat.set_initial_state(self._flat(MaskClass.BACKGROUND))
        flat.set_tag_state_key("class")
        for number, body in enumerate(bodies, start=1):
            flat.set_tag_state(str(number), self._flat(body.kind, number))

    def draw(self, camera: Pose, fov_rad: float) -> tuple[ClassMask, NDArray[np.uint8]]:
        height, width = self._size
        self._lens.set_focal_length(width / 2 / math.tan(fov_rad / 2))
        pose = self._p3d.LMatrix4f(*_camera_matrix(camera).reshape(-1).tolist())
        for node in (self._camera, self._mask_camera):
            node.set_mat(pose)
        for buffer in self._buffers:
            buffer.set_active(True)
        _engine()[0].render_frame()
        for buffer in self._buffers:  # other views of this process are drawn in their own turn
            buffer.set_active(False)
        green = cv2.extractChannel(_pixels(self._mask, height, width), 1)
        mask = np.asarray(cv2.LUT(green, _CLASS_OF_GREEN), np.uint8)
        return mask, cv2.cvtColor(_pixels(self._picture, height, width), cv2.COLOR_BGRA2RGB)

    def numbers(self) -> NDArray[np.intp]:
        """Return the number of the body at each pixel of the last picture, 0 for none."""
        levels = _pixels(self._mask, *self._size)
        return np.asarray(
            _NUMBER_OF_LEVEL[levels[..., 2]] * _NUMBERS + _NUMBER_OF_LEVEL[levels[..., 0]], np.intp
        )

    def _buffer(self, root: Any, name: str, bit: int) -> tuple[Any, Any]:
        p3d = self._p3d
        engine, pipe = _engine()
        height, width = self._size
        wants = p3d.FrameBufferProperties()
        wants.set_rgb_color(True)
        wants.set_depth_bits(16)
        buffer = engine.make_output(
            pipe,
            name,
            0,
            wants,
            p3d.WindowProperties.size(width, height),
            p3d.GraphicsPipe.BF_refuse_window,
        )
        if buffer is None:
            raise UsageError("panda3d cannot draw on this machine: its software rasteriser did not start")
        buffer.set_active(False)
        self._buffers.append(buffer)
        texture = p3d.Texture(name)
        buffer.add_render_texture(texture, p3d.GraphicsOutput.RTM_copy_ram)
        buffer.set_clear_color((0.0, 0.0, 0.0, 1.0))
        node = p3d.Camera(name, self._lens)
        node.set_camera_mask(p3d.BitMask32.bit(bit))
        camera = root.attach_new_node(node)
        buffer.make_display_region().set_camera(camera)
        return texture, camera

    def _flat(self, kind: MaskClass, number: int = 0) -> Any:
        p3d = self._p3d
        red, blue = divmod(number, _NUMBERS)
        levels = red * _NUMBER_STEP, int(kind) * _CLASS_STEP, blue * _NUMBER_STEP
        return p3d.RenderState.make(
            p3d.ColorAttrib.make_flat((*(level / 255.0 for level in levels), 1.0)),
            p3d.LightAttrib.make_all_off(),
            p3d.TextureAttrib.make_all_off(),
            p3d.MaterialAttrib.make_off(),
            1000,
        )


def _camera_matrix(pose: Pose) -> NDArray[np.float64]:
    """Return Panda3D's matrix of a camera, rows: right, ahead, up, position."""
    turn = pose.rotation()
    matrix = np.eye(4)
    matrix[0, :3], matrix[1, :3], matrix[2, :3] = -turn[:, 1], turn[:, 0], turn[:, 2]
    matrix[3, :3] = pose.translation()
    return matrix


def _pixels(texture: Any, height: int, width: int) -> NDArray[np.uint8]:
    """Return a buffer's pixels (height, width, 4), blue first, from the top."""
    data = np.frombuffer(texture.get_ram_image(), np.uint8)
    return data.reshape(height, width, -1)[::-1]
