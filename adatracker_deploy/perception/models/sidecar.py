"""`MODEL.yaml` beside `MODEL.onnx`: what a file cannot say of itself. All but `kind` has a default."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from adatracker_deploy.config.schema import Range, parse
from adatracker_deploy.config.yaml_text import read_yaml
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.coco import COCO80, COCO91
from adatracker_deploy.perception.models.picture import Preparation, Resize

Kind = Literal["yolo", "rf_detr", "grounding_dino", "sam2"]
Triple = tuple[float, float, float]
Side = Annotated[int, Range(8, 4096)]

FROM_METADATA = "metadata"
_CAP_BYTES = 256 << 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Sidecar:
    """Declarations about one model; None stands for its family's default."""

    kind: Kind
    size: tuple[Side, Side] | None = None
    """Rows and columns of the input; needed only where the file leaves them free."""
    stride: Annotated[int, Range(1, 256)] = 1
    """Rows and columns are multiples of this."""
    resize: Resize | None = None
    colour: Literal["rgb", "bgr"] | None = None
    scale: Annotated[float, Range(1e-6, 1)] | None = None
    mean: Triple | None = None
    """Mean of the scaled values, in the network's channel order, as is `std`."""
    std: Triple | None = None
    layout: Literal["nchw", "nhwc"] | None = None
    names: Literal["metadata", "coco80", "coco91"] | tuple[str, ...] | dict[str, str] | None = None
    """The classes: a list, or by index where some indices mean nothing, or where to find them."""
    synonyms: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Words that stand for one or several classes, for example obstacle: [chair, bench]."""
    tensors: dict[str, str] = field(default_factory=dict)
    """From the adapter's name of an input or output to the file's; for sam2, GRAPH.NAME."""
    masks: Literal["logits", "probabilities"] = "logits"
    """The values of an RF-DETR file's masks."""
    score: Annotated[float, Range(0.001, 0.999)] | None = None
    """Instances below this are dropped."""
    nms_iou: Annotated[float, Range(0.05, 1)] | None = None
    """IoU threshold of non-maximum suppression within a class; 1 keeps all."""
    limit: Annotated[int, Range(1, 300)] = 100
    """Instances at most, best first."""
    vocabulary: str | None = None
    """For grounding_dino: the text encoder's vocab.txt, beside the sidecar."""
    graphs: dict[str, str] = field(default_factory=dict)
    """For sam2: the four files, beside the sidecar."""
    external_data: bool = False
    """Whether the file may keep weights in other files beside it."""
    sha256: dict[str, str] = field(default_factory=dict)
    """Digests by file name; where there are any, no file that is not listed, or has another, is run."""
    providers: tuple[str, ...] = ("cpu",)

    def preparation(self, family: Preparation) -> Preparation:
        """Return how pictures are prepared: the family's way, where nothing else is declared."""
        if self.std is not None and min(self.std) <= 0:
            raise UsageError(f"std: expected three numbers above 0, got {self.std}")
        return Preparation(
            resize=self.resize or family.resize,
            colour=self.colour or family.colour,
            scale=self.scale or family.scale,
            mean=self.mean or family.mean,
            std=self.std or family.std,
            layout=self.layout or family.layout,
        )


def beside(model: Path) -> Path | None:
    """Return the sidecar of a model file, if there is one."""
    path = model.with_suffix(".yaml")
    return path if path.is_file() else None


def read_sidecar(path: Path) -> Sidecar:
    """Read and check a sidecar.

    Raises:
        UsageError: one line that names the file, the key and the reason.
    """
    document = read_yaml(path, cap_bytes=_CAP_BYTES)
    sidecar = parse(Sidecar, _with_text_keys(document), where=str(path))
    try:
        sidecar.preparation(Preparation())
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    return sidecar


def class_names(
    sidecar: Sidecar, own: dict[int, str] | None, classes: int | None, *, where: str
) -> dict[int, str]:
    """Return the names of a model's classes by index; an index without a name is never reported.

    Args:
        sidecar: what is declared.
        own: what the file's metadata say, if they say anything.
        classes: how many the graph scores; None where its shape does not tell.
        where: the model's path, for errors.

    Raises:
        UsageError: no names are known, or not as many as the graph scores.
    """
    declared: Any = sidecar.names or FROM_METADATA
    if declared == "coco80":
        names, whole = COCO80, True
    elif declared == "coco91":
        names, whole = COCO91, classes != 91
    elif declared == FROM_METADATA:
        if own is None:
            raise UsageError(f"{where}: its metadata name no classes: list them under `names` in the sidecar")
        names, whole = own, True
    elif isinstance(declared, dict):
        names, whole = _by_index(declared, where), False
    else:
        names, whole = dict(enumerate(declared)), True
    if classes is None:
        return dict(names)
    if (whole and len(names) != classes) or (names and max(names) >= classes):
        raise UsageError(f"{where}: {len(names)} class names for {classes} classes that the graph scores")
    return dict(names)


def _by_index(names: dict[str, str], where: str) -> dict[int, str]:
    if bad := [key for key in names if not key.isdecimal()]:
        raise UsageError(f"{where}: names: expected a class's number, got {bad[0]!r}")
    return {int(key): name for key, name in names.items()}


def _with_text_keys(document: Any) -> Any:
    """Turn the numbers that YAML reads as keys of `names` into text, which is what settings have."""
    if isinstance(document, dict) and isinstance(document.get("names"), dict):
        return document | {"names": {str(key): name for key, name in document["names"].items()}}
    return document
