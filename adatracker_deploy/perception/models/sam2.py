"""SAM2, and EdgeTAM if exported likewise: tracks one object by its mask.

In the first image the object's box is the prompt, and its mask is stored in memory, as SAM2 itself does with
a mask prompt (`use_mask_input_as_output_without_sam`). Frames in which the object is out of sight are not
stored, so that the occluder is not learnt. For a model without an object score, `sight.Sight` decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.found import sigmoid
from adatracker_deploy.perception.models.image_input import image_input
from adatracker_deploy.perception.models.memory_bank import MemoryBank, Remembered
from adatracker_deploy.perception.models.model_file import ModelFile
from adatracker_deploy.perception.models.picture import Letterbox
from adatracker_deploy.perception.models.rf_detr import IMAGENET
from adatracker_deploy.perception.models.sam2_graphs import GRAPHS, INPUTS, OUTPUTS, names_by_graph
from adatracker_deploy.perception.models.session import Feed, Network, Values
from adatracker_deploy.perception.models.sidecar import Sidecar
from adatracker_deploy.perception.models.signature import bind
from adatracker_deploy.perception.roles import Picture, Propagated

SMALLEST, LARGEST = 2e-4, 0.8
"""Shares of the picture: less is noise, more is the full-picture mask that a lost SAM2 likes to give."""
MOST_GROWTH = 4.0
"""Largest factor by which a thing may have grown or shrunk since it was last seen."""
FARTHEST = 1.5
"""Farthest move of its centre between two pictures, in diagonals of its last box; so much again for each that
it was out of sight. Chosen, not measured."""


class Sight:
    """Checks a mask against the last one in which the object was seen."""

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        """Begin with its mask, shape (h, w)."""
        self._shape = _measure(mask)
        self._missed = 0

    def sees(self, mask: NDArray[np.bool_]) -> bool:
        """Tell whether this mask, shape (h, w), shows it; remembers it if so."""
        share = float(mask.mean())
        last, now = self._shape, _measure(mask)
        seen = SMALLEST <= share <= LARGEST and last is not None and now is not None
        if seen and last is not None and now is not None:
            growth = now[2] / last[2]
            moved = float(np.hypot(now[0] - last[0], now[1] - last[1])) / last[3]
            patience = 1 + self._missed
            seen = 1 / (MOST_GROWTH * patience) <= growth <= MOST_GROWTH * patience
            seen = seen and moved <= FARTHEST * patience
        self._missed = 0 if seen else self._missed + 1
        if seen:
            self._shape = now
        return seen


def _measure(mask: NDArray[np.bool_]) -> tuple[float, float, float, float] | None:
    """Return centre x, centre y, area and the box's diagonal, as shares of the picture; None of nothing."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return None
    height, width = mask.shape
    sides = (np.ptp(columns) + 1) / width, (np.ptp(rows) + 1) / height
    return (
        float(columns.mean() / width),
        float(rows.mean() / height),
        float(mask.mean()),
        float(np.hypot(*sides)),
    )


_INSIDE, _OUTSIDE = 10.0, -10.0
"""Logits of a certain mask for the memory encoder: sigmoid x 20 - 10 (`sigmoid_scale_for_mem_enc`)."""
_POINT, _TOP_LEFT, _BOTTOM_RIGHT, _NO_POINT = 1, 2, 3, -1
"""Labels of prompt points (`sam2/modeling/sam/prompt_encoder.py`)."""

Bool = NDArray[np.bool_]


class Sam2Propagator:
    """Implements `Propagator`."""

    def __init__(
        self, files: Mapping[str, ModelFile], sidecar: Sidecar, providers: Sequence[str], threads: int
    ) -> None:
        """Start the four graphs.

        Raises:
            UsageError: a graph is not what an export of this family gives.
        """
        names = names_by_graph(sidecar.tensors, where=str(files[GRAPHS[0]].path))
        bound = {graph: bind(files[graph], INPUTS[graph], OUTPUTS[graph], names[graph]) for graph in GRAPHS}
        self._fed = {graph: fed for graph, (fed, _) in bound.items()}
        self._given = {graph: given for graph, (_, given) in bound.items()}
        encoder = files["image_encoder"]
        self._input = image_input(encoder, self._fed["image_encoder"]["picture"], sidecar, IMAGENET)
        self._mask_size = self._size_of_mask(files["memory_encoder"])
        self.networks = tuple(Network(files[graph], providers, threads) for graph in GRAPHS)
        self._by_name = dict(zip(GRAPHS, self.networks, strict=True))
        self._bank: MemoryBank | None = None

    def start(self, picture: Picture, mask: Bool) -> None:
        """Begin with the thing's mask over this picture, of any resolution; forgets what came before.

        Raises:
            UsageError: the mask is empty.
            PlatformError: the model gave what no such model gives.
        """
        if not mask.any():
            raise UsageError("nothing to follow: the mask is empty")
        feeds, place = self._input.feed(picture)
        seen = self._run("image_encoder", feeds)
        given = _laid(mask, place)
        decoded = self._decode(seen, seen["features"], self._prompt(given))
        best = _likest(decoded["mask"], given)
        at_size = cv2.resize(given.astype(np.uint8), self._mask_size[::-1], interpolation=cv2.INTER_NEAREST)
        values = np.where(at_size > 0, _INSIDE, _OUTSIDE)[None, None]
        memory, temporal = self._remember(seen, values, _pointer(decoded, best))
        self._bank = MemoryBank(memory, temporal)
        self._mask: Bool = _one(decoded["mask"], best)[0, 0] > 0
        self._sight = Sight(place.map_back(given.astype(np.float32)) > 0.5)

    def step(self, picture: Picture) -> Propagated:
        """Return where it is in the next picture; raises PlatformError for what no such model gives.

        Raises:
            RuntimeError: it was not started.
        """
        if self._bank is None:
            raise RuntimeError("step before start")
        feeds, place = self._input.feed(picture)
        seen = self._run("image_encoder", feeds)
        memory, pointers, positions = self._bank.recall()
        recalled = {
            "features": seen["features"],
            "positions": seen["positions"],
            "pointers": pointers,
            "memory": memory,
            "memory_positions": positions,
        }
        features = self._run("memory_attention", self._named("memory_attention", recalled))["features"]
        decoded = self._decode(seen, features, self._prompt(None))
        best = (
            int(decoded["quality"][0].argmax())
            if "quality" in decoded
            else _likest(decoded["mask"], self._mask)
        )
        logits = _one(decoded["mask"], best)[0, 0]
        over = place.map_back(logits)
        mask = over > 0
        score = float(sigmoid(decoded["in_sight"])[0, 0]) if "in_sight" in decoded else _certainty(over)
        plausible = self._sight.sees(mask)
        in_sight = score > 0.5 and bool(mask.any()) if "in_sight" in decoded else plausible
        if not in_sight:
            return Propagated(np.zeros_like(mask), min(score, 0.5) if "in_sight" in decoded else 0.0)
        remembered, _ = self._remember(seen, _one(decoded["mask_for_memory"], best), _pointer(decoded, best))
        self._bank.add(remembered)
        self._mask = logits > 0
        return Propagated(mask, score)

    def forget(self) -> None:
        """Forget everything; `start` begins anew."""
        self._bank = None

    def _run(self, graph: str, feeds: Mapping[str, Feed]) -> dict[str, Values]:
        given = self._given[graph]
        return dict(zip(given, self._by_name[graph].run(feeds, tuple(given.values())), strict=True))

    def _named(self, graph: str, values: Mapping[str, Any]) -> dict[str, Feed]:
        """Return feeds by the file's names, as its types."""
        return {
            tensor.name: np.ascontiguousarray(values[role], dtype=tensor.dtype)
            for role, tensor in self._fed[graph].items()
        }

    def _decode(
        self, seen: Mapping[str, Values], features: Values, prompt: dict[str, Feed]
    ) -> dict[str, Values]:
        values = {"features": features, "fine_0": seen["fine_0"], "fine_1": seen["fine_1"]} | prompt
        return self._run("image_decoder", self._named("image_decoder", values))

    def _remember(self, seen: Mapping[str, Values], mask: Feed, pointer: Values) -> tuple[Remembered, Values]:
        values = {"mask": mask, "pix_feat": seen["pix_feat"], "from_points": np.zeros((1, 1))}
        memory = self._run("memory_encoder", self._named("memory_encoder", values))
        return Remembered(memory["features"], memory["positions"], pointer), memory["temporal"]

    def _prompt(self, mask: Bool | None) -> dict[str, Feed]:
        """Return points for a mask over the input: its box, or where one point is all, its innermost."""
        places = self._fed["image_decoder"]["point_labels"].shape[1]
        points = (
            [] if mask is None else _box_points(mask) if places is None or places > 1 else _innermost(mask)
        )
        points += [(0.0, 0.0, _NO_POINT)] * ((places or max(1, len(points))) - len(points))
        table = np.array(points, np.float32)[None]
        return {"point_coords": table[..., :2], "point_labels": table[..., 2]}

    def _size_of_mask(self, file: ModelFile) -> tuple[int, int]:
        rows, columns = self._fed["memory_encoder"]["mask"].shape[2:]
        if rows is None or columns is None:
            rows, columns = self._input.size
        if (rows, columns) < (8, 8):
            raise UsageError(
                f"{file.path}: takes a mask of {rows} x {columns}; expected the size of the picture"
            )
        return rows, columns


def _laid(mask: Bool, place: Letterbox) -> Bool:
    """Lay a mask over the picture into the input, shape (rows, columns)."""
    rows, columns = place.content
    laid = np.zeros(place.size, bool)
    small = cv2.resize(mask.astype(np.float32), (columns, rows), interpolation=cv2.INTER_LINEAR) > 0.5
    laid[place.top : place.top + rows, place.left : place.left + columns] = small
    if not laid.any():
        raise UsageError("nothing to follow: the mask is too small for this model")
    return laid


def _box_points(mask: Bool) -> list[tuple[float, float, int]]:
    rows, columns = np.nonzero(mask)
    first = float(columns.min()), float(rows.min()), _TOP_LEFT
    return [first, (float(columns.max() + 1), float(rows.max() + 1), _BOTTOM_RIGHT)]


def _innermost(mask: Bool) -> list[tuple[float, float, int]]:
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    return [(float(column) + 0.5, float(row) + 0.5, _POINT)]


def _likest(candidates: Values, mask: Bool) -> int:
    """Return the index of the mask in (1, k, r, c) with the highest IoU to this one."""
    size = candidates.shape[3], candidates.shape[2]
    wanted = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    shares = [(one & wanted).sum() / max(1, (one | wanted).sum()) for one in candidates[0] > 0]
    return int(np.argmax(shares))


def _one(values: Values, place: int) -> Values:
    """Return the candidate at a place of (1, k, ...), as (1, 1, ...); the only one, if there is but one."""
    at = place if values.shape[1] > 1 else 0
    return values[:, at : at + 1]


def _pointer(decoded: Mapping[str, Values], place: int) -> Values:
    pointer = decoded["pointer"]
    return pointer if pointer.ndim == 2 else _one(pointer, place)[:, 0]


def _certainty(logits: Values) -> float:
    """Return how far from undecided the mask is where it is, 0.5 to 1; 0 where it is nowhere."""
    return float(sigmoid(logits[logits > 0]).mean()) if (logits > 0).any() else 0.0
