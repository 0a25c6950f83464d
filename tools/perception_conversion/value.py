"""Tensors while they are translated: their shapes, and how both frameworks see their axes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

NHWC_OF_NCHW = (0, 2, 3, 1)
"""Order of a picture that ONNX has as NCHW and TensorFlow sees as NHWC."""


class Value(NamedTuple):
    """An ONNX tensor; TensorFlow's axis i is its axis `order[i]`."""

    name: str
    shape: tuple[int, ...]
    order: tuple[int, ...]

    @property
    def seen(self) -> tuple[int, ...]:
        """The shape that TensorFlow sees."""
        return tuple(self.shape[axis] for axis in self.order)


def replaced(shape: tuple[int, ...], axis: int, size: int) -> tuple[int, ...]:
    """Return the shape with another size along `axis`."""
    return (*shape[:axis], size, *shape[axis + 1 :])


def window(sizes: Any, kernel: Any, strides: Any, padding: str) -> tuple[list[int], tuple[int, ...]]:
    """Return pads as ONNX wants them (all beginnings, all ends) and the sizes that come out of sliding.

    Raises:
        ValueError: a padding other than TensorFlow's SAME and VALID.
    """
    begins, ends, results = [], [], []
    for size, length, stride in zip(sizes, kernel, strides, strict=True):
        if padding == "SAME":  # the odd one goes to the end
            result = math.ceil(size / stride)
            total = max((result - 1) * stride + length - size, 0)
        elif padding == "VALID":
            result, total = (size - length) // stride + 1, 0
        else:
            raise ValueError(f"padding {padding} is not translated here")
        begins.append(total // 2)
        ends.append(total - total // 2)
        results.append(result)
    return begins + ends, tuple(results)
