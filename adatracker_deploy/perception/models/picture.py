"""Maps an image to a network's input, and coordinates back to the image. Pure functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.perception.roles import Boxes, Picture

Resize = Literal["stretch", "letterbox", "letterbox_corner"]
"""Both axes to the full size; or one scale for both, and grey around, or right and below."""
PADDING = 114
"""The grey of what is around a letterboxed picture, as the YOLO family is trained with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Preparation:
    """The normalisation that a network expects: (pixel * scale - mean) / std, channel by channel."""

    resize: Resize = "stretch"
    colour: Literal["rgb", "bgr"] = "rgb"
    scale: float = 1 / 255
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)
    layout: Literal["nchw", "nhwc"] = "nchw"
    padding: int = PADDING
    """The grey of what is around the picture."""


@dataclass(frozen=True, slots=True)
class Letterbox:
    """Position of a picture in a network's input, in px."""

    picture: tuple[int, int]
    """Rows and columns."""
    size: tuple[int, int]
    """Rows and columns of the input."""
    content: tuple[int, int]
    """Rows and columns of the input that show the picture."""
    top: int
    left: int

    def boxes_in(self, boxes: Boxes) -> Boxes:
        """Map boxes from the picture's px to the input's."""
        return np.asarray(boxes * self._gain() + self._shift(), np.float32)

    def boxes_back(self, boxes: Boxes) -> Boxes:
        """Map boxes from the input's px to the picture's; not clipped."""
        return np.asarray((boxes - self._shift()) / self._gain(), np.float32)

    def map_back(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Cut the picture out of a map over the whole input.

        Args:
            values: shape (r, c), any resolution.

        Returns:
            Shape (r', c'), over the whole picture and nothing else, at about the same resolution.
        """
        per_px = np.array(
            [values.shape[1] / self.size[1], values.shape[0] / self.size[0]]
        )  # cells a px: x, y
        shown = np.array([self.content[1], self.content[0]]) * per_px
        cells = np.maximum(1, np.rint(shown)).astype(int)
        step = shown / cells
        start = np.array([self.left, self.top]) * per_px + step / 2 - 0.5  # centres of cells
        matrix = np.array([[step[0], 0, start[0]], [0, step[1], start[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cut = cv2.warpAffine(
            values, matrix, (int(cells[0]), int(cells[1])), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(cut, np.float32)

    def _gain(self) -> NDArray[np.float64]:
        gain_y, gain_x = (inside / whole for inside, whole in zip(self.content, self.picture, strict=True))
        return np.array([gain_x, gain_y, gain_x, gain_y])

    def _shift(self) -> NDArray[np.float64]:
        return np.array([self.left, self.top, self.left, self.top], np.float64)


def fit(picture: tuple[int, int], size: tuple[int, int], resize: Resize) -> Letterbox:
    """Say where a picture of rows x columns goes in an input of rows x columns."""
    if resize == "stretch":
        return Letterbox(picture, size, size, 0, 0)
    gain = min(size[0] / picture[0], size[1] / picture[1])
    rows, columns = (
        max(1, min(whole, round(side * gain))) for side, whole in zip(picture, size, strict=True)
    )
    if resize == "letterbox_corner":
        return Letterbox(picture, size, (rows, columns), 0, 0)
    return Letterbox(picture, size, (rows, columns), (size[0] - rows) // 2, (size[1] - columns) // 2)


def prepare(
    picture: Picture, place: Letterbox, how: Preparation, dtype: str = "float32"
) -> NDArray[np.generic]:
    """Return the network's input, shape (1, 3, rows, columns) or (1, rows, columns, 3)."""
    rows, columns = place.content
    small = cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_LINEAR)
    canvas = np.full((*place.size, 3), how.padding, np.uint8)
    canvas[place.top : place.top + rows, place.left : place.left + columns] = small
    order = (2, 1, 0) if how.colour == "bgr" else (0, 1, 2)
    values = np.empty((1, 3, *place.size) if how.layout == "nchw" else (1, *place.size, 3), np.float32)
    planes = values[0] if how.layout == "nchw" else values[0].transpose(2, 0, 1)
    # Plane by plane: numpy is several times slower along a last axis of three.
    for plane, channel, mean, std in zip(planes, order, how.mean, how.std, strict=True):
        np.multiply(canvas[..., channel], np.float32(how.scale / std), out=plane)
        np.subtract(plane, np.float32(mean / std), out=plane)
    return np.asarray(values, dtype=dtype)
