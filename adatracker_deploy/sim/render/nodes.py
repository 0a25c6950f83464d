"""Parts of Panda3D's scene graph: meshes, textures, the light of an hour, the sky and shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from adatracker_deploy.sim.render import meshes, textures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.sim.render.meshes import Mesh
    from adatracker_deploy.sim.scene import Rgb, Scene

_SKY_M = 300.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Daylight:
    """The sun and the sky of an hour."""

    sun_deg: float = 55.0
    """The sun's height."""
    azimuth_deg: float = 35.0
    """The sun's azimuth, from x to y."""
    sun: Rgb = (0.78, 0.75, 0.68)
    ambient: Rgb = (0.46, 0.48, 0.52)
    cloudy: float = 0.3
    """Share of the sky in cloud; a cloud over the sun is `sun` being dark."""
    fog_m: float = 0.0
    """Meteorological optical range, m; 0 is no fog."""


def geom(mesh: Mesh, name: str) -> Any:
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


def texture(image: NDArray[np.uint8]) -> Any:
    """Return a texture that repeats, of an RGB image (H, W, 3)."""
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


def white() -> Any:
    """Return a material that shows colours and opacity as they are; without one, both count twice."""
    from panda3d import core as p3d

    material = p3d.Material("white")
    material.set_diffuse((1.0, 1.0, 1.0, 1.0))
    material.set_ambient((1.0, 1.0, 1.0, 1.0))
    return material


def light(root: Any, daylight: Daylight) -> None:
    """Light everything below a NodePath by sun and sky."""
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


def sky(scene: Scene, daylight: Daylight, seed: int) -> Any:
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
    node = p3d.NodePath(geom(mesh, "sky"))
    node.set_texture(texture(textures.sky(scene.sky_rgb, scene.haze_rgb, daylight.cloudy, seed)))
    node.set_light_off()
    node.set_two_sided(True)
    node.set_bin("background", 0)
    node.set_depth_write(False)
    return node.node()


def soft_shadow(daylight: Daylight, height_m: float) -> Any:
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
    node = p3d.NodePath(geom(mesh, "shadow"))
    opacity = textures.shadow()
    texture = p3d.Texture("shadow")
    texture.setup_2d_texture(*opacity.shape, p3d.Texture.T_unsigned_byte, p3d.Texture.F_rgba)
    image = np.zeros((*opacity.shape, 4), np.uint8)
    image[..., 3] = opacity
    texture.set_ram_image(image.tobytes())
    node.set_texture(texture)
    node.set_light_off()
    node.set_two_sided(True)
    # It darkens what is below, and leaves the opacity there as it is.
    node.set_attrib(
        p3d.ColorBlendAttrib.make(
            p3d.ColorBlendAttrib.M_add,
            p3d.ColorBlendAttrib.O_incoming_alpha,
            p3d.ColorBlendAttrib.O_one_minus_incoming_alpha,
        )
    )
    channels = p3d.ColorWriteAttrib
    node.set_attrib(channels.make(channels.C_red | channels.C_green | channels.C_blue))
    node.set_bin("transparent", 0)
    node.set_depth_write(False)
    return node.node()
