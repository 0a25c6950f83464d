"""The 80 object classes of COCO, which most published detectors are trained on (cocodataset.org)."""

from __future__ import annotations

_NAMES = (
    "person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, "
    "stop sign, parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, "
    "backpack, umbrella, handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite, "
    "baseball bat, baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup, fork, "
    "knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut, cake, "
    "chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote, keyboard, "
    "cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear, "
    "hair drier, toothbrush"
)
_UNUSED_IDS = {66, 68, 69, 71, 12, 45, 83, 26, 29, 30}
"""Category numbers from 1 to 90 that the 2017 annotations leave out."""

COCO80 = dict(enumerate(_NAMES.split(", ")))
"""By place in the list, as the YOLO family numbers them: person is 0."""
COCO91 = dict(
    zip((number for number in range(1, 91) if number not in _UNUSED_IDS), COCO80.values(), strict=True)
)
"""By category number, as the DETR family numbers them: person is 1; 91 outputs, of which 0 is unused."""
