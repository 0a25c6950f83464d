"""SAM2's four graphs, and their tensor names in the known exports.

The plain names are those of the exporters that came first, the prefixed ones (img_encoder_, mem_atten_, ...)
of those that followed; a third kind is reached by the sidecar's `tensors`, written GRAPH.NAME.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.image_input import picture_port
from adatracker_deploy.perception.models.signature import REAL, WHOLE, Port

GRAPHS = ("image_encoder", "memory_attention", "image_decoder", "memory_encoder")
_MAP = (1, None, None, None)


def _port(*names: str, shape: tuple[int | None, ...], **rest: Any) -> Port:
    return Port(names=names, shapes=(shape,), **rest)


INPUTS: Mapping[str, Mapping[str, Port]] = {
    "image_encoder": {"picture": picture_port("image", "images", "input", "img_encoder_image")},
    "memory_attention": {
        "features": _port("current_vision_feat", "mem_atten_current_vision_feat", shape=_MAP),
        "positions": _port(
            "current_vision_pos_embed", "mem_atten_current_vision_pos_embed", shape=(None, 1, None)
        ),
        "pointers": _port("memory_0", "mem_atten_memory_0", shape=(None, None)),
        "memory": Port(
            names=("memory_1", "mem_atten_memory_1"), shapes=((None, None, None, None), (None, None, None))
        ),
        "memory_positions": _port("memory_pos_embed", "mem_atten_memory_pos_embed", shape=(None, None, None)),
    },
    "image_decoder": {
        "point_coords": _port("point_coords", "img_decoder_point_coords", shape=(1, None, 2)),
        "point_labels": _port(
            "point_labels", "img_decoder_point_labels", shape=(1, None), dtypes=(*REAL, *WHOLE)
        ),
        "features": _port("image_embed", "pix_feat_with_mem", "img_decoder_pix_feat_with_mem", shape=_MAP),
        "fine_0": _port("high_res_feats_0", "img_decoder_high_res_feats_0", shape=_MAP),
        "fine_1": _port("high_res_feats_1", "img_decoder_high_res_feats_1", shape=_MAP),
    },
    "memory_encoder": {
        "mask": _port("mask_for_mem", "mem_encoder_mask_for_mem", shape=(1, 1, None, None)),
        "pix_feat": _port("pix_feat", "mem_encoder_pix_feat", shape=_MAP),
        "from_points": _port(
            "mask_from_pts", "mem_encoder_mask_from_pts", shape=(1, 1), dtypes=(*REAL, "bool"), optional=True
        ),
    },
}
OUTPUTS: Mapping[str, Mapping[str, Port]] = {
    "image_encoder": {
        "pix_feat": _port("pix_feat", "img_encoder_pix_feat", shape=_MAP),
        "fine_0": _port("high_res_feat0", "high_res_feats_0", "img_encoder_high_res_feat0", shape=_MAP),
        "fine_1": _port("high_res_feat1", "high_res_feats_1", "img_encoder_high_res_feat1", shape=_MAP),
        "features": _port("vision_feats", "current_vision_feat", "img_encoder_vision_feats", shape=_MAP),
        "positions": _port(
            "vision_pos_embed",
            "current_vision_pos_embed",
            "img_encoder_vision_pos_embed",
            shape=(None, 1, None),
        ),
    },
    "memory_attention": {
        "features": _port(
            "image_embed", "pix_feat_with_mem", "fused_feat", "mem_atten_pix_feat_with_mem", shape=_MAP
        )
    },
    "image_decoder": {
        "pointer": Port(names=("obj_ptr", "img_decoder_obj_ptr"), shapes=((1, None), (1, None, None))),
        "mask_for_memory": _port("mask_for_mem", "img_decoder_mask_for_mem", shape=_MAP),
        "mask": _port("pred_mask", "img_decoder_pred_mask", shape=_MAP),
        "in_sight": _port(
            "object_score_logits", "img_decoder_object_score_logits", shape=(1, 1), optional=True
        ),
        "quality": _port("iou", "ious", "iou_predictions", shape=(1, None), optional=True),
    },
    "memory_encoder": {
        "features": Port(
            names=("maskmem_features", "mem_encoder_maskmem_features"), shapes=(_MAP, (1, None, None))
        ),
        "positions": _port("maskmem_pos_enc", "mem_encoder_maskmem_pos_enc", shape=(None, 1, None)),
        "temporal": Port(
            names=("temporal_code", "mem_encoder_temporal_code"),
            shapes=((None, 1, 1, None), (None, 1, None), (None, None)),
        ),
    },
}


def names_by_graph(tensors: Mapping[str, str], *, where: str) -> dict[str, dict[str, str]]:
    """Split a sidecar's name map by graph.

    Raises:
        UsageError: a name has no graph in front of it.
    """
    split: dict[str, dict[str, str]] = {graph: {} for graph in GRAPHS}
    for role, name in tensors.items():
        graph, _, rest = role.partition(".")
        if graph not in split or not rest:
            raise UsageError(
                f"{where}: tensors: {role!r}: expected GRAPH.NAME, GRAPH one of {', '.join(GRAPHS)}"
            )
        split[graph][rest] = name
    return split
