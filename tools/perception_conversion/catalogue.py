"""The models that are made: what TensorFlow's names become, and what somebody who runs them has to know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from perception_conversion.calibration import MEAN_BGR, STD_BGR, STRIDE

# The 80 classes of COCO (Lin et al. 2014) in the order of their numbers there.
COCO = """person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant,
stop sign, parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe,
backpack, umbrella, handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat,
baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl,
banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut, cake, chair, couch, potted plant,
bed, dining table, toilet, tv, laptop, mouse, remote, keyboard, cell phone, microwave, oven, toaster, sink,
refrigerator, book, clock, vase, scissors, teddy bear, hair drier, toothbrush"""
VOCABULARY = COCO.replace("\n", " ").split(", ")


@dataclass(frozen=True, slots=True)
class Source:
    """One model of the package."""

    name: str
    """Name of its files in the package, and of its entry."""
    inputs: dict[str, str]
    """TensorFlow's names to readable ones."""
    outputs: dict[str, str]
    free: dict[str, dict[int, str]]
    """Axes of any length: readable name of the tensor -> axis -> what the length is called."""
    about: dict[str, Any]
    """As it is written to the index."""


NANODET = Source(
    name="nanodet",
    inputs={"input_1": "image"},
    outputs={
        "Identity": "cls8",
        "Identity_1": "cls16",
        "Identity_2": "cls32",
        "Identity_3": "reg8",
        "Identity_4": "reg16",
        "Identity_5": "reg32",
    },
    free={"image": {2: "height", 3: "width"}}
    | {f"{kind}{stride}": {1: f"cells{stride}"} for kind in ("cls", "reg") for stride in (8, 16, 32)},
    about={
        "what": "NanoDet-g, 416, 80 classes of COCO: boxes and scores",
        "upstream": "https://github.com/RangiLyu/nanodet",
        "licence": "Apache-2.0",
        "preprocessing": {
            "colour": "BGR",
            "values": "0 to 255, less mean, divided by std",
            "mean": list(MEAN_BGR),
            "std": list(STD_BGR),
            "multiple_of": STRIDE,
            "size": "416 wide, aspect kept, black below and to the right up to the multiple",
        },
        "decoding": (
            "For each stride s: cell k is row k // (width / s), column k % (width / s), its centre "
            "((column + 0.5) s, (row + 0.5) s). cls: a score for each class, 0 to 1, the sigmoid is "
            "applied. reg: for each of left, top, right, bottom 11 logits; softmax, then the expectation "
            "of 0 to 10, times s, is that side's distance from the centre. Non-maximum suppression is the "
            "caller's."
        ),
        "classes": VOCABULARY,
    },
)

SELFIE = Source(
    name="selfie",
    inputs={"input_1": "image"},
    outputs={"activation_10": "mask"},
    free={},
    about={
        "what": "MediaPipe selfie segmentation, general: which pixels are people",
        "upstream": "https://github.com/google-ai-edge/mediapipe",
        "licence": "Apache-2.0",
        "preprocessing": {"colour": "RGB", "values": "0 to 1"},
        "decoding": "The probability that a pixel is a person's, 0 to 1; people are not told apart.",
    },
)

POSE = Source(
    name="blazepose-lite",
    inputs={"input_1": "image"},
    outputs={"Identity_1": "mask", "Identity_3": "flag"},
    free={},
    about={
        "what": "MediaPipe pose landmarks, lite: which pixels are those of the one person in the middle",
        "upstream": "https://github.com/google-ai-edge/mediapipe",
        "licence": "Apache-2.0",
        "preprocessing": {"colour": "RGB", "values": "0 to 1"},
        "decoding": (
            "mask: the probability that a pixel is the person's, 0 to 1; flag: that there is a person. The "
            "landmarks, which the toolkit does not use, are left out."
        ),
    },
)
