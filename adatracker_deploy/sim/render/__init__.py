"""Pictures of the virtual world for real eyes: people, textures, light, and the truth mask to the pixel.

Panda3D draws them, by default with its software rasteriser, which needs no GPU, display or root. `renderer`
is the only module that talks to its engine; `figure` poses people from glTF files, `meshes` and `textures`
turn a scene into surfaces, and `lens` is the camera behind the pinhole.
"""

from adatracker_deploy.sim.render.figure import check as check_person
from adatracker_deploy.sim.render.renderer import check_renderer

__all__ = ["check_person", "check_renderer"]
