"""The checksum of AgileX protocol v1."""

from __future__ import annotations


def agilex_v1(frame_id: int, data: bytes) -> int:
    """Return what a v1 frame's last byte must be: the sum of the id's bytes, the length and the other bytes.

    Source: AgileX ugv_sdk, ``CalcCanFrameChecksumV1`` in src/protocol_v1/agilex_msg_parser_v1.c (fd728d4).
    """
    return ((frame_id & 0xFF) + (frame_id >> 8) + len(data) + sum(data[:-1])) & 0xFF
