"""ONNX files of the families' true signatures, computed by hand: each looks for the bright block.

A picture is black but for one block of a pure colour. "Where" finds its first and last bright row and column.
"""

from __future__ import annotations

import numpy as np
import onnx
from onnx import numpy_helper, parser

SIDE = 64
OPSET = 17

# corners [1,4] in px of the input, there [1,1] (1 where anything is bright), bright [1,1,64,64]
WHERE = """
    grey = ReduceMax<axes = [1], keepdims = 0>(picture)
    lit = Greater(grey, level)
    flat = Cast<to = 1>(lit)
    columns = ReduceMax<axes = [1], keepdims = 0>(flat)
    rows = ReduceMax<axes = [2], keepdims = 0>(flat)
    there = ReduceMax<axes = [1], keepdims = 1>(rows)
    left_i = ArgMax<axis = 1>(columns)
    right_i = ArgMax<axis = 1, select_last_index = 1>(columns)
    top_i = ArgMax<axis = 1>(rows)
    bottom_i = ArgMax<axis = 1, select_last_index = 1>(rows)
    first_i = Concat<axis = 1>(left_i, top_i)
    last_i = Concat<axis = 1>(right_i, bottom_i)
    first = Cast<to = 1>(first_i)
    last_px = Cast<to = 1>(last_i)
    last = Add(last_px, one)
    twice = Add(first, last)
    centre = Mul(twice, half)
    size = Sub(last, first)
    bright = Unsqueeze(flat, axis1)
    small = AveragePool<kernel_shape = [4, 4], strides = [4, 4]>(bright)
    strongest = ReduceMax<axes = [2, 3], keepdims = 0>(picture)
    scores_all = Mul(strongest, there)
"""
CONSTANTS = {
    "one": np.float32(1),
    "half": np.float32(0.5),
    "axis1": np.array([1]),
    "axis2": np.array([2]),
    "side": np.float32(SIDE),
}


def save(path, text, constants=None, metadata=None, opset=OPSET):
    """Write the graph of this text, with the constants that it names inside; return the model."""
    graph = parser.parse_graph(text)
    used = {name for node in graph.node for name in node.input}
    every = CONSTANTS | {"level": np.float32(0.9)} | (constants or {})
    graph.initializer.extend(
        numpy_helper.from_array(np.asarray(value), name) for name, value in every.items() if name in used
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", opset)], ir_version=8)
    for key, value in (metadata or {}).items():
        model.metadata_props.add(key=key, value=value)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return model


def picture(block, colour=(255, 0, 0), size=(48, 96)):
    """A black picture, rows x columns, with a block (left, top, right, bottom) of this RGB colour."""
    made = np.zeros((*size, 3), np.uint8)
    left, top, right, bottom = block
    made[top:bottom, left:right] = colour
    return made


NAMES = {0: "person", 1: "chair", 2: "dog"}


def metadata(task="segment", **more):
    entries = {"task": task, "names": str(NAMES), "imgsz": f"[{SIDE}, {SIDE}]", "stride": "32"}
    return entries | {key: str(value) for key, value in more.items()}


def yolo_raw(path, masks=True, **options):
    """Two anchors on the block, the second a px aside and less sure; classes are red, green and blue."""
    outputs = "float[1,39,2] output0, float[1,32,16,16] output1" if masks else "float[1,7,2] output0"
    weights = "logits = Sub(small, half)  output1 = Concat<axis = 1>(logits, noise)" if masks else ""
    parts = "centre, size, sure, coefficients" if masks else "centre, size, sure"
    again = "aside, size, unsure, coefficients" if masks else "aside, size, unsure"
    text = f"""
    yolo (float[1,3,64,64] picture) => ({outputs}) {{
        {WHERE}
        sure = Mul(scores_all, nine)
        unsure = Mul(scores_all, eight)
        aside = Add(centre, one)
        a = Concat<axis = 1>({parts})
        b = Concat<axis = 1>({again})
        a2 = Unsqueeze(a, axis2)
        b2 = Unsqueeze(b, axis2)
        output0 = Concat<axis = 2>(a2, b2)
        {weights}
    }}"""
    return save(path, text.replace("picture", "images"), YOLO_CONSTANTS, **options)


def yolo_finished(path, masks=True, index=0.0, **options):
    """Corners, score, class and coefficients; then rows of nothing, as an export with nms pads them."""
    width = 38 if masks else 6
    outputs = f"float[1,2,{width}] output0" + (", float[1,32,16,16] output1" if masks else "")
    weights = "logits = Sub(small, half)  output1 = Concat<axis = 1>(logits, noise)" if masks else ""
    parts = "first, last, sure, class" + (", coefficients" if masks else "")
    text = f"""
    yolo (float[1,3,64,64] images) => ({outputs}) {{
        {WHERE.replace("picture", "images")}
        sure = Mul(there, nine)
        a = Concat<axis = 1>({parts})
        a2 = Unsqueeze(a, axis1)
        b2 = Mul(a2, nought)
        output0 = Concat<axis = 1>(a2, b2)
        {weights}
    }}"""
    constants = YOLO_CONSTANTS | {"class": np.full((1, 1), index, np.float32)}
    return save(path, text, constants, **options)


YOLO_CONSTANTS = {
    "nine": np.float32(0.9),
    "eight": np.float32(0.8),
    "nought": np.float32(0),
    "coefficients": np.eye(1, 32, dtype=np.float32),
    "noise": np.full((1, 31, 16, 16), 7, np.float32),
}


def rf_detr(path, masks=True, classes=91, index=1, **options):
    """Three queries; the second is the block, its class fixed."""
    outputs = f"float[1,3,4] dets, float[1,3,{classes}] labels" + (
        ", float[1,3,16,16] masks" if masks else ""
    )
    weights = (
        "drawn = Mul(small, twenty)  logits = Sub(drawn, ten)  masks = Concat<axis = 1>(empty, logits, empty)"
    )
    surest = np.full((1, 1, classes), -12, np.float32)
    surest[..., index] = 16
    text = f"""
    rf_detr (float[1,3,64,64] input) => ({outputs}) {{
        {WHERE.replace("picture", "input")}
        px = Concat<axis = 1>(centre, size)
        share = Div(px, side)
        share2 = Unsqueeze(share, axis1)
        dets = Concat<axis = 1>(elsewhere, share2, elsewhere)
        risen = Mul(surest, there)
        spoken = Add(risen, low)
        labels = Concat<axis = 1>(low, spoken, low)
        {weights if masks else ""}
    }}"""
    constants = {
        "level": np.float32(1.5),  # after ImageNet's normalisation
        "elsewhere": np.full((1, 1, 4), 0.25, np.float32),
        "low": np.full((1, 1, classes), -6, np.float32),
        "surest": np.where(surest > 0, 10, 0).astype(np.float32),
        "empty": np.full((1, 1, 16, 16), -10, np.float32),
        "twenty": np.float32(options.pop("contrast", 20)),
        "ten": np.float32(options.pop("below", 10)),
    }
    return save(path, text, constants, **options)


def grounding_dino(path, person, hf=False):
    """The first of two queries is the block; it scores on the tokens whose number is `person`."""
    image, boxes = ("pixel_values", "pred_boxes") if hf else ("img", "boxes")
    inputs = "int64[1,T] input_ids, int64[1,T] token_type_ids, "
    inputs += (
        "int64[1,T] attention_mask, int64[1,64,64] pixel_mask"
        if hf
        else "bool[1,T] attention_mask, int64[1,T] position_ids, bool[1,T,T] text_token_mask"
    )
    text = f"""
    dino (float[1,3,64,64] {image}, {inputs}) => (float[1,2,256] logits, float[1,2,4] {boxes}) {{
        {WHERE.replace("picture", image)}
        px = Concat<axis = 1>(centre, size)
        share = Div(px, side)
        share2 = Unsqueeze(share, axis1)
        {boxes} = Concat<axis = 1>(share2, share2)
        same = Equal(input_ids, person)
        match = Cast<to = 1>(same)
        seen = Mul(match, there)
        high = Mul(seen, eight)
        token_logits = Sub(high, four)
        length = Shape<start = 1>(input_ids)
        rest = Sub(whole, length)
        pads = Concat<axis = 0>(zeros, rest)
        wide = Pad(token_logits, pads, absent)
        wide2 = Unsqueeze(wide, axis1)
        none = Sub(wide2, eight)
        logits = Concat<axis = 1>(wide2, none)
    }}"""
    constants = {
        "level": np.float32(1.5),
        "person": np.array(person),
        "eight": np.float32(8),
        "four": np.float32(4),
        "whole": np.array([256]),
        "zeros": np.array([0, 0, 0]),
        "absent": np.float32(-np.inf),
    }
    return save(path, text, constants)
