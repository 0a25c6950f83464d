"""Chooses the adapter for a model file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.models.grounding_dino import GroundingDino
from adatracker_deploy.perception.models.metadata import read_metadata
from adatracker_deploy.perception.models.model_file import ModelFile, read_model_file
from adatracker_deploy.perception.models.rf_detr import OUTPUTS as RF_DETR_OUTPUTS
from adatracker_deploy.perception.models.rf_detr import RfDetrDetector
from adatracker_deploy.perception.models.sam2 import Sam2Propagator
from adatracker_deploy.perception.models.sam2_graphs import GRAPHS
from adatracker_deploy.perception.models.sidecar import Sidecar, beside, read_sidecar
from adatracker_deploy.perception.models.yolo_seg import YoloDetector
from adatracker_deploy.perception.roles import Picture

Model = YoloDetector | RfDetrDetector | GroundingDino | Sam2Propagator
"""A `Detector`, or, of SAM2, a `Propagator`; its `networks` say in a line each what runs where."""

KINDS = "yolo, rf_detr, grounding_dino, sam2"
_YAML = (".yaml", ".yml")


def open_model(
    path: Path, words: Sequence[str] = (), providers: Sequence[str] | None = None, threads: int = 1
) -> Model:
    """Open a strong model, check it and run it once.

    Args:
        path: MODEL.onnx, with MODEL.yaml beside it if the file's metadata are not enough; or the MODEL.yaml.
        words: what to look for; none: everything it knows. SAM2 follows a mask, whatever they say.
        providers: where to run it, by preference; None: as the sidecar says, else on the processor.
        threads: for the processor's share of the work.

    Raises:
        UsageError: one line that names the file, what was found and what was expected.
    """
    path = Path(path)
    sidecar_path = path if path.suffix in _YAML else beside(path)
    sidecar = None if sidecar_path is None else read_sidecar(sidecar_path)
    if sidecar is not None and sidecar.kind == "sam2":
        model = _open_sam2(path, sidecar, providers, threads)
    else:
        model = _open_detector(_model_beside(path), sidecar, words, providers, threads)
    _warm_up(model, path)
    return model


def _open_sam2(path: Path, sidecar: Sidecar, providers: Sequence[str] | None, threads: int) -> Model:
    if sorted(sidecar.graphs) != sorted(GRAPHS):
        raise UsageError(
            f"{path}: graphs: expected {', '.join(GRAPHS)}, got {', '.join(sidecar.graphs) or 'none'}"
        )
    files = {graph: _read(path.parent / sidecar.graphs[graph], sidecar) for graph in GRAPHS}
    return Sam2Propagator(files, sidecar, providers or sidecar.providers, threads)


def _open_detector(
    path: Path, sidecar: Sidecar | None, words: Sequence[str], providers: Sequence[str] | None, threads: int
) -> Model:
    file = _read(path, sidecar) if sidecar is not None else read_model_file(path)
    sidecar = sidecar or _guess(file)
    where = providers or sidecar.providers
    if sidecar.kind == "yolo":
        return YoloDetector(file, sidecar, words, where, threads)
    if sidecar.kind == "rf_detr":
        return RfDetrDetector(file, sidecar, words, where, threads)
    if sidecar.vocabulary is None:
        raise UsageError(f"{path}: name the text encoder's vocab.txt under `vocabulary` in the sidecar")
    return GroundingDino(file, sidecar, words, where, threads, vocabulary=path.parent / sidecar.vocabulary)


def _read(path: Path, sidecar: Sidecar) -> ModelFile:
    """Read a model file with a sidecar; if that lists digests, every file that would run must match."""
    file = read_model_file(path, external_data=sidecar.external_data)
    for name, digest in file.sha256 if sidecar.sha256 else ():
        pinned = sidecar.sha256.get(name, "none").lower()
        if digest != pinned:
            raise UsageError(
                f"{path.parent / name}: its SHA-256 is {digest}, but the sidecar's sha256 says {pinned}"
            )
    return file


def _guess(file: ModelFile) -> Sidecar:
    """Identify a file without a sidecar by its metadata or signature."""
    if read_metadata(file.metadata, where=str(file.path)) is not None:
        return Sidecar(kind="yolo")
    wanted = {name for role in ("boxes", "logits") for name in RF_DETR_OUTPUTS[role].names}
    if wanted <= file.outputs.keys():
        return Sidecar(kind="rf_detr")
    saw = "; ".join(
        f"{side} {', '.join(map(str, tensors.values()))}"
        for side, tensors in (("inputs", file.inputs), ("outputs", file.outputs))
    )
    raise UsageError(
        f"{file.path}: matches no known family by its metadata or outputs ({saw}): write "
        f"{file.path.with_suffix('.yaml').name} beside it, beginning with `kind:` and one of {KINDS}"
    )


def _model_beside(path: Path) -> Path:
    return path.with_suffix(".onnx") if path.suffix in _YAML else path


def _warm_up(model: Model, path: Path) -> None:
    """Run it on a dummy image; its outputs must at least be finite."""
    ramp = np.add.outer(np.arange(240), np.arange(320)) % 240
    picture: Picture = np.repeat(ramp[..., None], 3, axis=2).astype(np.uint8)
    try:
        if isinstance(model, Sam2Propagator):
            mask = np.zeros((240, 320), bool)
            mask[80:160, 120:200] = True
            model.start(picture, mask)
            model.step(picture)
            model.forget()
            return
        if isinstance(model, RfDetrDetector):
            model.check(picture)
        model(picture)
    except PlatformError as error:
        raise UsageError(f"{path}: on a first picture it {_said(error)}") from error


def _said(error: PlatformError) -> str:
    """Return an error's text without the leading model name."""
    return str(error).partition(": ")[2] or str(error)
