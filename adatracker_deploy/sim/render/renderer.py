"""Draws pictures of a scene and its people with Panda3D, and the class mask of the same pixels.

The software rasteriser is Panda3D's own ``p3tinydisplay``. One engine serves all renderers of a process.
"""

from __future__ import annotations

import functools
import importlib.util
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim.render import meshes, textures
from adatracker_deploy.sim.render.figure import Figure

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.sim.person import Gait
    from adatracker_deploy.sim.render.meshes import Mesh
    from adatracker_deploy.sim.scene import Part, Rgb, Scene, Thing

_NEAR_M, _FAR_M = 0.05, 400.0
_SKY_M = 300.0
_MASK_ONLY, _PICTURE_ONLY = 1, 2
"""Bits of the two cameras: shadows and sky are for pictures alone."""
_CLASS_STEP = 40
"""Grey levels between two classes in the mask's buffer."""
_CLASS_OF_GREY = ((np.arange(256) + _CLASS_STEP // 2) // _CLASS_STEP).astype(np.uint8)
_QUIET = (
    "load-display p3tinydisplay",
    "audio-library-name null",
    "notify-level warning",
    "notify-level-display error",
    "textures-power-2 up",
    "sync-video false",
    "model-cache-dir",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Daylight:
    """The sun and the sky of an hour."""

    sun_deg: float = 55.0
    """The sun's height."""
    azimuth_deg: float = 35.0
    """Where it stands, from x to y."""
    sun: Rgb = (0.78, 0.75, 0.68)
    ambient: Rgb = (0.46, 0.48, 0.52)
    cloudy: float = 0.3
    """Share of the sky in cloud; a cloud over the sun is `sun` being dark."""


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
    """Return Panda3D's engine and the software rasteriser's pipe."""
    from panda3d import core as p3d

    p3d.load_prc_file_data("", "\n".join(_QUIET))
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
        _light(self._root, daylight)
        self._sky = self._root.attach_new_node(_sky(scene, daylight, seed))
        self._sky.hide(p3d.BitMask32.bit(_MASK_ONLY))
        self._build(scene, obstacles=obstacles, seed=seed)
        self._figures = [Figure(path) for path in people]
        self._shadows = []
        for place, figure in enumerate(self._figures):
            figure.root.reparent_to(self._root)
            figure.root.set_tag("class", "target" if place == 0 else "person")
            self._shadows.append(self._root.attach_new_node(_soft_shadow(daylight, figure.height_m)))
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
        figure.pose(gait.walked_m, gait.speed_m_s, t_s)
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
        return self._views[size].draw(camera, fov_rad)

    def _build(self, scene: Scene, *, obstacles: bool, seed: int) -> None:
        image, repeat_m = textures.ground(scene.ground, seed)
        floor = self._root.attach_new_node(_geom(meshes.ground(scene.terrain, repeat_m), "ground"))
        floor.set_texture(_texture(image))
        if scene.wall_height_m:
            thick, half_x, half_y = 0.1, scene.half_x_m, scene.half_y_m
            tall = scene.wall_height_m / 2
            for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                half = (thick if x else half_x + 2 * thick, thick if y else half_y + 2 * thick, tall)
                wall = self._root.attach_new_node(_geom(meshes.box(half), "wall"))
                wall.set_pos(x * (half_x + thick), y * (half_y + thick), tall)
                wall.set_texture(_texture(textures.plaster(scene.wall_rgb, seed)))
        for number, thing in enumerate(scene.everything(obstacles=obstacles)):
            self._add(thing, scene, seed + number)

    def _add(self, thing: Thing, scene: Scene, seed: int) -> None:
        node = self._root.attach_new_node("thing")
        node.set_tag("class", "obstacle")
        node.set_pos(thing.x, thing.y, scene.terrain.height(thing.x, thing.y))
        node.set_h(math.degrees(thing.yaw))
        for part in thing.parts:
            mesh = node.attach_new_node(_geom(meshes.of_part(part), part.shape))
            mesh.set_texture(_texture(_image_of(part, seed % 5)))


def _image_of(part: Part, seed: int) -> NDArray[np.uint8]:
    red, green, blue = part.rgb
    if part.windows:
        return textures.facade(part.rgb, seed)
    if part.shape == "ellipsoid" and green > max(red, blue):
        return textures.leaves(part.rgb, seed)
    return textures.plaster(part.rgb, seed)


class _View:
    """Two buffers of one size: the picture's and the mask's."""

    def __init__(self, root: Any, height: int, width: int) -> None:
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
        for kind in (MaskClass.TARGET, MaskClass.PERSON, MaskClass.OBSTACLE):
            flat.set_tag_state(kind.name.lower(), self._flat(kind))

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
        grey = cv2.extractChannel(_pixels(self._mask, height, width), 1)
        mask = np.asarray(cv2.LUT(grey, _CLASS_OF_GREY), np.uint8)
        return mask, cv2.cvtColor(_pixels(self._picture, height, width), cv2.COLOR_BGRA2RGB)

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

    def _flat(self, kind: MaskClass) -> Any:
        p3d = self._p3d
        grey = int(kind) * _CLASS_STEP / 255.0
        return p3d.RenderState.make(
            p3d.ColorAttrib.make_flat((grey, grey, grey, 1.0)),
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


def _geom(mesh: Mesh, name: str) -> Any:
    """Return a node with a mesh."""
    from panda3d import core as p3d

    data = p3d.GeomVertexData(name, p3d.GeomVertexFormat.get_v3n3t2(), p3d.Geom.UH_static)
    data.unclean_set_num_rows(len(mesh.points))
    rows = np.concatenate([mesh.points, mesh.normals, mesh.uv], axis=1).astype(np.float32)
    memoryview(data.modify_array(0)).cast("B").cast("f")[:] = rows.reshape(-1).data
    triangles = p3d.GeomTriangles(p3d.Geom.UH_static)
    triangles.set_index_type(p3d.Geom.NT_uint32)
    corners = np.ascontiguousarray(mesh.faces.reshape(-1), np.uint32)
    handle = triangles.modify_vertices()
    handle.unclean_set_num_rows(len(corners))
    memoryview(handle).cast("B").cast("I")[:] = corners.data
    geom = p3d.Geom(data)
    geom.add_primitive(triangles)
    node = p3d.GeomNode(name)
    node.add_geom(geom)
    return node


def _texture(image: NDArray[np.uint8]) -> Any:
    from panda3d import core as p3d

    height, width = image.shape[:2]
    texture = p3d.Texture("surface")
    texture.setup_2d_texture(width, height, p3d.Texture.T_unsigned_byte, p3d.Texture.F_rgb)
    texture.set_ram_image(np.ascontiguousarray(image[::-1, :, ::-1]).tobytes())
    texture.set_wrap_u(p3d.SamplerState.WM_repeat)
    texture.set_wrap_v(p3d.SamplerState.WM_repeat)
    texture.set_minfilter(p3d.SamplerState.FT_linear_mipmap_linear)
    texture.set_magfilter(p3d.SamplerState.FT_linear)
    return texture


def _light(root: Any, daylight: Daylight) -> None:
    from panda3d import core as p3d

    ambient = p3d.AmbientLight("sky")
    ambient.set_color((*daylight.ambient, 1.0))
    root.set_light(root.attach_new_node(ambient))
    sun = p3d.DirectionalLight("sun")
    sun.set_color((*daylight.sun, 1.0))
    height, azimuth = math.radians(daylight.sun_deg), math.radians(daylight.azimuth_deg)
    flat = math.cos(height)
    sun.set_direction((-flat * math.cos(azimuth), -flat * math.sin(azimuth), -math.sin(height)))
    root.set_light(root.attach_new_node(sun))


def _sky(scene: Scene, daylight: Daylight, seed: int) -> Any:
    """Return a dome around the camera."""
    from panda3d import core as p3d

    rows, columns = 9, 25
    v, u = np.meshgrid(np.linspace(1.0, -0.2, rows), np.linspace(0, 1, columns), indexing="ij")
    ring = np.sqrt(np.clip(1 - v**2, 0, 1))
    points = _SKY_M * np.stack([ring * np.cos(2 * np.pi * u), ring * np.sin(2 * np.pi * u), v], axis=-1)
    uv = np.stack([u * 2, 1 - (1.0 - v) / 1.2], axis=-1).reshape(-1, 2)
    faces = []
    for i in range(rows - 1):
        for j in range(columns - 1):
            a, b = i * columns + j, i * columns + j + 1
            faces += [(a, b, b + columns), (a, b + columns, a + columns)]
    flat = points.reshape(-1, 3)
    mesh = meshes.Mesh(flat, -flat / _SKY_M, uv, np.array(faces))
    node = p3d.NodePath(_geom(mesh, "sky"))
    node.set_texture(_texture(textures.sky(scene.sky_rgb, scene.haze_rgb, daylight.cloudy, seed)))
    node.set_light_off()
    node.set_two_sided(True)
    node.set_bin("background", 0)
    node.set_depth_write(False)
    return node.node()


def _soft_shadow(daylight: Daylight, height_m: float) -> Any:
    """Return a person's shadow: a soft spot, stretched away from the sun."""
    from panda3d import core as p3d

    long_m = min(3.0, 0.35 * height_m / math.tan(math.radians(max(daylight.sun_deg, 10.0))))
    azimuth = math.radians(daylight.azimuth_deg)
    away = np.array([-math.cos(azimuth), -math.sin(azimuth)])
    side = np.array([-away[1], away[0]])
    corners = np.array([(-0.32, -0.32), (0.32 + long_m, -0.32), (0.32 + long_m, 0.32), (-0.32, 0.32)])
    points = np.zeros((4, 3))
    points[:, :2] = corners[:, :1] * away + corners[:, 1:] * side
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    mesh = meshes.Mesh(points, np.tile((0.0, 0.0, 1.0), (4, 1)), uv, np.array([(0, 1, 2), (0, 2, 3)]))
    node = p3d.NodePath(_geom(mesh, "shadow"))
    opacity = textures.shadow()
    texture = p3d.Texture("shadow")
    texture.setup_2d_texture(*opacity.shape, p3d.Texture.T_unsigned_byte, p3d.Texture.F_rgba)
    image = np.zeros((*opacity.shape, 4), np.uint8)
    image[..., 3] = opacity
    texture.set_ram_image(image.tobytes())
    node.set_texture(texture)
    node.set_light_off()
    node.set_two_sided(True)
    node.set_transparency(p3d.TransparencyAttrib.M_alpha)
    node.set_depth_write(False)
    return node.node()
