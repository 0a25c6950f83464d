"""A graph's image input: its size, and the array it is fed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.picture import Letterbox, Preparation, fit, prepare
from adatracker_deploy.perception.models.signature import Port

if TYPE_CHECKING:
    from adatracker_deploy.perception.models.model_file import ModelFile, Tensor
    from adatracker_deploy.perception.models.session import Feed
    from adatracker_deploy.perception.models.sidecar import Sidecar
    from adatracker_deploy.perception.roles import Picture


def picture_port(*names: str) -> Port:
    """Return the port of a picture that exports call by these names."""
    return Port(names=names, shapes=((1, 3, None, None), (1, None, None, 3)))


@dataclass(frozen=True, slots=True)
class ImageInput:
    """The preparation of a picture for a graph's input."""

    tensor: Tensor
    size: tuple[int, int]
    """Rows and columns."""
    preparation: Preparation

    def feed(self, picture: Picture) -> tuple[dict[str, Feed], Letterbox]:
        """Return what the graph is fed, and where the picture lies in it."""
        rows, columns = picture.shape[:2]
        place = fit((rows, columns), self.size, self.preparation.resize)
        return {self.tensor.name: prepare(picture, place, self.preparation, self.tensor.dtype)}, place


def image_input(
    file: ModelFile,
    tensor: Tensor,
    sidecar: Sidecar,
    family: Preparation,
    *,
    size: tuple[int, int] | None = None,
    stride: int = 1,
) -> ImageInput:
    """Settle a graph's picture input.

    Args:
        file: the model.
        tensor: its picture input.
        sidecar: what is declared; goes before what the family does.
        family: how the family prepares pictures.
        size: what the file's metadata say of rows and columns.
        stride: what rows and columns must be multiples of.

    Raises:
        UsageError: the layout or the size is not the graph's, or no one says the size.
    """
    how = sidecar.preparation(family)
    channels = tensor.shape[1 if how.layout == "nchw" else 3]
    if channels not in (3, None):
        raise UsageError(f"{file.path}: layout is {how.layout}, but the picture input is {tensor}")
    declared = tensor.shape[2:] if how.layout == "nchw" else tensor.shape[1:3]
    wanted = sidecar.size or size
    sides = [own or (wanted[axis] if wanted else None) for axis, own in enumerate(declared)]
    if sides[0] is None or sides[1] is None:
        raise UsageError(
            f"{file.path}: does not fix its picture's size ({tensor}): write `size: [rows, columns]` "
            "in the sidecar"
        )
    settled = (sides[0], sides[1])
    if sidecar.size is not None and sidecar.size != settled:
        raise UsageError(f"{file.path}: size is {list(sidecar.size)}, but the picture input is {tensor}")
    multiple = max(stride, sidecar.stride)
    if settled[0] % multiple or settled[1] % multiple:
        raise UsageError(
            f"{file.path}: rows and columns {list(settled)} are no multiples of the stride {multiple}"
        )
    return ImageInput(tensor, settled, how)


def in_boxes(masks: np.ndarray, boxes: np.ndarray, picture: tuple[int, int]) -> np.ndarray:
    """Clear each mask outside its box.

    Args:
        masks: bool, shape (n, r, c), each over the whole picture.
        boxes: shape (n, 4), in the picture's px.
        picture: its rows and columns.
    """
    rows = (np.arange(masks.shape[1]) + 0.5) * picture[0] / masks.shape[1]
    columns = (np.arange(masks.shape[2]) + 0.5) * picture[1] / masks.shape[2]
    left, top, right, bottom = boxes.T[:, :, None]
    inside_x = (columns >= left) & (columns < right)
    inside_y = (rows >= top) & (rows < bottom)
    return np.asarray(masks & inside_y[:, :, None] & inside_x[:, None, :])
