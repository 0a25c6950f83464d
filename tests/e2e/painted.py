"""Somebody painted, and a detector in a real ONNX file that finds them: dry runs that need no footage.

The picture is dark noise, as no two pictures of a camera are the same, with one bright red block in it.
"""

from __future__ import annotations

import numpy as np

from tests.perception.models import graphs
from tests.perception.streams import film

ROWS, COLUMNS = 64, 96
RATE_HZ = 20.0


def painted(number: int, size: tuple[int, int] = (ROWS, COLUMNS), *, somebody: bool = True) -> np.ndarray:
    """Picture `number`, RGB: they go to and fro once in four seconds."""
    rows, columns = size
    picture = np.random.default_rng(number).integers(0, 60, (rows, columns, 3)).astype(np.uint8)
    if somebody:
        left = round(columns * (0.35 + 0.2 * np.sin(2 * np.pi * number / 80)))
        picture[rows // 4 : rows - 4, left : left + columns // 6] = (255, 0, 0)
    return picture


def painted_film(path, seconds: float, until_s: float = np.inf):
    """A film of them; from `until_s` on nobody is in it. Returns its path."""
    shown = (
        painted(number, somebody=number < until_s * RATE_HZ) for number in range(round(seconds * RATE_HZ))
    )
    return film(path, list(shown), RATE_HZ)


def red_detector(path):
    """A YOLO file for pictures of any size that gives no finite score where nothing is bright; its path."""
    text = f"""
    yolo (float[1,3,64,64] images) => (float[1,7,2] output0) {{
        {graphs.WHERE.replace("picture", "images")}
        one_or_nan = Div(there, there)
        certain = Mul(scores_all, one_or_nan)
        sure = Mul(certain, nine)
        unsure = Mul(certain, eight)
        a = Concat<axis = 1>(centre, size, sure)
        b = Concat<axis = 1>(centre, size, unsure)
        a2 = Unsqueeze(a, axis2)
        b2 = Unsqueeze(b, axis2)
        output0 = Concat<axis = 2>(a2, b2)
    }}"""
    graphs.save(path, text, graphs.YOLO_CONSTANTS, graphs.metadata(task="detect"))
    return path
