"""A small RTSP camera: JPEG over RTP, interleaved with the control connection.

RFC 2326 (RTSP; interleaving in 10.12), RFC 3550 (RTP) and RFC 2435 (JPEG: the receiver makes the headers anew
from the tables, so only those and the coded scan are sent).
"""

from __future__ import annotations

import re
import struct
from itertools import count

from streams import serving

JPEG_TYPE = 26
"""RTP's static payload type for JPEG (RFC 3551)."""
TABLES_FOLLOW = 255
CHROMA_420 = 1
TABLE, SIZE, SCAN = 0xDB, 0xC0, 0xDA
"""JPEG's markers DQT, here with one table each as libjpeg writes them, SOF0 and SOS (ITU-T T.81)."""
PACKET_BYTES = 1400
CLOCK_HZ = 90_000
SDP = b"v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=eye\r\nt=0 0\r\nm=video 0 RTP/AVP 26\r\na=control:eye\r\n"


def rtsp_camera(jpegs, rate_hz, pause):
    """Serve `jpegs`, an endless or finite iterable, on a free port; `pause(seconds)` is called between two.

    After the last one it stays connected and silent.
    """

    def answer(connection, request):
        while request and not request.startswith(b"PLAY"):
            connection.sendall(reply(request))
            request = connection.recv(65536)
        if not request:
            return  # it only knocked
        connection.sendall(reply(request))
        numbers = count()
        for index, jpeg in enumerate(jpegs):
            for payload, last in packets(jpeg):
                header = struct.pack(
                    ">BBHII", 0x80, JPEG_TYPE | last << 7, next(numbers), round(index * CLOCK_HZ / rate_hz), 7
                )
                connection.sendall(
                    struct.pack(">cBH", b"$", 0, len(header) + len(payload)) + header + payload
                )
            pause(1 / rate_hz)

    return serving(answer)


def reply(request):
    method = request.split(b" ", 1)[0]
    number = re.search(rb"CSeq: *(\d+)", request)[1]
    head = b"RTSP/1.0 200 OK\r\nCSeq: " + number + b"\r\nSession: 7\r\n"
    if method == b"DESCRIBE":
        return head + b"Content-Type: application/sdp\r\nContent-Length: %d\r\n\r\n" % len(SDP) + SDP
    if method == b"SETUP":
        return head + b"Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n\r\n"
    return head + b"Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n\r\n"


def packets(jpeg):
    """Yield one picture's payloads, each with whether it is the last."""
    segments = list(segments_of(jpeg))
    tables = b"".join(body[1:] for marker, body in segments if marker == TABLE)
    height, width = struct.unpack_from(">HH", dict(segments)[SIZE], 1)
    scan = dict(segments)[SCAN]
    for offset in range(0, len(scan), PACKET_BYTES):
        piece = scan[offset : offset + PACKET_BYTES]
        header = struct.pack(">IBBBB", offset, CHROMA_420, TABLES_FOLLOW, width // 8, height // 8)
        if offset == 0:
            header += struct.pack(">BBH", 0, 0, len(tables)) + tables
        yield header + piece, offset + PACKET_BYTES >= len(scan)


def segments_of(jpeg):
    """Yield (marker, body); the scan's body is its coded data."""
    at = 2
    while True:
        marker, length = struct.unpack_from(">xBH", jpeg, at)
        if marker == SCAN:
            yield marker, jpeg[at + 2 + length : -2]
            return
        yield marker, jpeg[at + 4 : at + 2 + length]
        at += 2 + length
