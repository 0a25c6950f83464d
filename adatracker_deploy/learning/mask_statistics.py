"""Statistics of a mask: for each class where it is, how large, and what it covers.

They are fixed, so they are computed once for each step of a data set, and an update of training costs a
fraction of one that looks through convolutions. ONNX has every operator that is used.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

STRIPS = 16
"""Columns and rows of a profile: 4 pixels each at the default size."""
CELLS = 4
"""Cells on a side of the grid."""
PER_CHANNEL = 2 * STRIPS + CELLS**2 + 6
_THERE = 0.5
"""A pixel belongs to a class from here on: bundles may draw edges that are in between."""


def mask_statistics(mask: Tensor) -> Tensor:
    """Return (N, C x `PER_CHANNEL`) in [0, 1], of masks (N, C, S, S) in [0, 1], S a multiple of 16.

    For each channel: the share of it in each strip of columns, each strip of rows, each cell of the grid and
    the whole, as square roots, since a person far away covers a hundredth; whether there is any; its box as
    left, top, right, bottom, from 0 to 1 across the picture, zeros without any.
    """
    side = mask.shape[-1]
    strip = functional.avg_pool2d(mask, side // STRIPS)
    columns, rows = strip.mean(-2), strip.mean(-1)
    grid = functional.avg_pool2d(strip, STRIPS // CELLS).flatten(2)
    there = (mask > _THERE).to(mask.dtype)
    across, down = there.amax(-2), there.amax(-1)
    seen = across.amax(-1, keepdim=True)
    place = torch.arange(side, dtype=mask.dtype, device=mask.device)
    low, high = 1.0 - place / side, (place + 1.0) / side
    box = [
        seen - (across * low).amax(-1, keepdim=True),
        seen - (down * low).amax(-1, keepdim=True),
        (across * high).amax(-1, keepdim=True),
        (down * high).amax(-1, keepdim=True),
    ]
    area = grid.mean(-1, keepdim=True)
    shares = torch.cat((columns, rows, grid, area), dim=-1).sqrt()
    return torch.cat((shares, seen, *box), dim=-1).flatten(1)
