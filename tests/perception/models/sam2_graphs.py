"""Four graphs with SAM2's signatures that follow a colour, in any export's names.

What is remembered of a frame is the colour under its mask; attention weighs the picture's colours by the
remembered ones; the decoder's mask is where the sum of what is left is large. So a red thing is followed past
a blue one. The pointer is the prompt's last point: without a prompt on the first picture nothing is found.
"""

from __future__ import annotations

import numpy as np

from tests.perception.models.graphs import save

PLAIN = {
    "image": "image",
    "pix_feat": "pix_feat",
    "fine_0": "high_res_feat0",
    "fine_1": "high_res_feat1",
    "features": "vision_feats",
    "positions": "vision_pos_embed",
    "a_features": "current_vision_feat",
    "a_positions": "current_vision_pos_embed",
    "a_pointers": "memory_0",
    "a_memory": "memory_1",
    "a_memory_positions": "memory_pos_embed",
    "a_out": "image_embed",
    "coords": "point_coords",
    "labels": "point_labels",
    "d_features": "image_embed",
    "d_fine_0": "high_res_feats_0",
    "d_fine_1": "high_res_feats_1",
    "pointer": "obj_ptr",
    "mask_for_memory": "mask_for_mem",
    "mask": "pred_mask",
    "in_sight": "object_score_logits",
    "e_mask": "mask_for_mem",
    "e_pix_feat": "pix_feat",
    "e_features": "maskmem_features",
    "e_positions": "maskmem_pos_enc",
    "temporal": "temporal_code",
}
PREFIXED = PLAIN | {
    "image": "img_encoder_image",
    "pix_feat": "img_encoder_pix_feat",
    "fine_0": "img_encoder_high_res_feat0",
    "fine_1": "img_encoder_high_res_feat1",
    "features": "img_encoder_vision_feats",
    "positions": "img_encoder_vision_pos_embed",
    "a_features": "mem_atten_current_vision_feat",
    "a_positions": "mem_atten_current_vision_pos_embed",
    "a_pointers": "mem_atten_memory_0",
    "a_memory": "mem_atten_memory_1",
    "a_memory_positions": "mem_atten_memory_pos_embed",
    "a_out": "mem_atten_pix_feat_with_mem",
    "coords": "img_decoder_point_coords",
    "labels": "img_decoder_point_labels",
    "d_features": "img_decoder_pix_feat_with_mem",
    "d_fine_0": "img_decoder_high_res_feats_0",
    "d_fine_1": "img_decoder_high_res_feats_1",
    "pointer": "img_decoder_obj_ptr",
    "mask_for_memory": "img_decoder_mask_for_mem",
    "mask": "img_decoder_pred_mask",
    "e_mask": "mem_encoder_mask_for_mem",
    "e_pix_feat": "mem_encoder_pix_feat",
    "e_features": "mem_encoder_maskmem_features",
    "e_positions": "mem_encoder_maskmem_pos_enc",
    "temporal": "mem_encoder_temporal_code",
    "from_points": "mem_encoder_mask_from_pts",
}

ENCODER = """
encoder (float[1,3,64,64] {image}) => (float[1,4,8,8] {pix_feat}, float[1,4,16,16] {fine_0},
    float[1,4,8,8] {fine_1}, float[1,4,8,8] {features}, float[64,1,4] {positions}) {{
    lit = Relu({image})
    four = Conv(lit, spread)
    {fine_0} = AveragePool<kernel_shape = [4, 4], strides = [4, 4]>(four)
    {pix_feat} = AveragePool<kernel_shape = [8, 8], strides = [8, 8]>(four)
    {fine_1} = Identity({pix_feat})
    {features} = Identity({pix_feat})
    {positions} = Identity(places)
}}"""
ATTENTION = """
attention (float[1,4,8,8] {a_features}, float[64,1,4] {a_positions}, float[m,4] {a_pointers},
    float[n,4,8,8] {a_memory}, float[t,1,4] {a_memory_positions}) => (float[1,4,8,8] {a_out}) {{
    sums = ReduceSum({a_memory}, axes)
    loudest = ReduceMax<keepdims = 1>(sums)
    colour = Div(sums, loudest)
    pointed = ReduceMax<keepdims = 1>({a_pointers})
    some = Greater(pointed, nought)
    prompted = Cast<to = 1>(some)
    prompted1 = Reshape(prompted, unit)
    far = ReduceMin<keepdims = 1>({a_memory_positions})
    near = ReduceMax<keepdims = 1>({a_positions})
    both = Mul(far, near)
    none = Mul(both, nought)
    none1 = Reshape(none, unit)
    weighed = Mul({a_features}, colour)
    heard = Mul(weighed, prompted1)
    {a_out} = Add(heard, none1)
}}"""
DECODER = """
decoder (float[1,{points},2] {coords}, float[1,{points}] {labels}, float[1,4,8,8] {d_features},
    float[1,4,16,16] {d_fine_0}, float[1,4,8,8] {d_fine_1}) => (float[1,4] {pointer},
    float[1,1,64,64] {mask_for_memory}, float[1,1,16,16] {mask}{score_out}) {{
    sum = ReduceSum({d_features}, channel)
    strong = Mul(sum, gain)
    logits = Sub(strong, threshold)
    fine = ReduceSum({d_fine_0}, channel)
    fine1 = ReduceSum({d_fine_1}, channel)
    fine_none = Mul(fine, nought)
    fine1_none = Mul(fine1, nought)
    logits1 = Add(logits, fine1_none)
    wide = Resize<mode = "nearest">(logits1, roi, two)
    {mask} = Add(wide, fine_none)
    sure = Sigmoid({mask})
    large = Resize<mode = "nearest">(sure, roi, quadruple)
    scaled = Mul(large, twenty)
    {mask_for_memory} = Sub(scaled, ten)
    counted = Unsqueeze({labels}, last_axis)
    real = Greater(counted, nought)
    real_f = Cast<to = 1>(real)
    said = Mul({coords}, real_f)
    end = ReduceMax<axes = [1], keepdims = 0>(said)
    {pointer} = Concat<axis = 1>(end, end)
    {score}
}}"""
MEMORY = """
memory (float[1,1,64,64] {e_mask}, float[1,4,8,8] {e_pix_feat}{from_points_in}) => (
    float[1,4,8,8] {e_features}, float[64,1,4] {e_positions}, float[7,1,1,4] {temporal}) {{
    share = Div({e_mask}, ten)
    kept = Relu(share)
    small = AveragePool<kernel_shape = [8, 8], strides = [8, 8]>(kept)
    {from_points}
    {e_features} = Mul({e_pix_feat}, small1)
    {e_positions} = Identity(places)
    {temporal} = Identity(codes)
}}"""

CONSTANTS = {
    "spread": np.eye(4, 3, dtype=np.float32).reshape(4, 3, 1, 1),
    "places": np.ones((64, 1, 4), np.float32),
    "codes": np.ones((7, 1, 1, 4), np.float32),
    "axes": np.array([0, 2, 3]),
    "channel": np.array([1]),
    "last_axis": np.array([2]),
    "nought": np.float32(0),
    "unit": np.array([1, 1, 1, 1]),
    "gain": np.float32(4),
    "threshold": np.float32(4),
    "roi": np.empty(0, np.float32),
    "two": np.array([1, 1, 2, 2], np.float32),
    "quadruple": np.array([1, 1, 4, 4], np.float32),
    "twenty": np.float32(20),
    "ten": np.float32(10),
}


def write(folder, names=PLAIN, scored=True, points="p"):
    """Write the four graphs; return what a sidecar says of them."""
    score = {"score_out": "", "score": ""}
    if scored:
        score = {
            "score_out": f", float[1,1] {names['in_sight']}",
            "score": f"{names['in_sight']} = ReduceMax<axes = [2, 3], keepdims = 0>({names['mask']})",
        }
    told = {"from_points_in": "", "from_points": "small1 = Identity(small)"}
    if "from_points" in names:
        name = names["from_points"]
        told = {
            "from_points_in": f", float[1,1] {name}",
            "from_points": f"off = Mul({name}, nought)  small1 = Add(small, off)",
        }
    texts = {
        "image_encoder": ENCODER,
        "memory_attention": ATTENTION,
        "image_decoder": DECODER,
        "memory_encoder": MEMORY,
    }
    for graph, text in texts.items():
        save(folder / f"{graph}.onnx", text.format(points=points, **(names | score | told)), CONSTANTS)
    return {"kind": "sam2", "graphs": {graph: f"{graph}.onnx" for graph in texts}}
