"""CDR written out by hand from the specification, to check the package's own encoder against.

XCDR1 (OMG RTPS 2.5, 10.2; DDS-XTypes 1.3, 7.4.3): after a 4-byte encapsulation header every primitive lies
at a multiple of its own size, counted from behind that header. A string is a uint32 length that counts the
closing zero, and the bytes; a sequence is a uint32 count and the elements. What lies between is padding, of
any value.
"""

import struct
from itertools import zip_longest

HEADER = {"<": b"\0\1\0\0", ">": b"\0\0\0\0"}
_CODES = {
    "bool": "?",
    "uint8": "B",
    "int8": "b",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "float32": "f",
    "float64": "d",
}

TIME = ["int32", "uint32"]
HEAD = [*TIME, "string"]
VECTOR = ["float64"] * 3
UNITREE_IMU = [*["float32"] * 13, "int8"]
TWIST = VECTOR * 2
LAYOUTS = {
    "Twist": TWIST,
    "TwistStamped": HEAD + TWIST,
    "Odometry": [
        *HEAD,
        "string",
        *VECTOR,
        *["float64"] * 4,
        *["float64"] * 36,
        *TWIST,
        *["float64"] * 36,
    ],
    "Imu": [*HEAD, *["float64"] * (4 + 9 + 3 + 9 + 3 + 9)],
    "BatteryState": [
        *HEAD,
        *["float32"] * 7,
        *["uint8"] * 3,
        "bool",
        "float32[]",
        "float32[]",
        "string",
        "string",
    ],
    "CompressedImage": [*HEAD, "string", "bytes"],
    "SportModeState": [
        *TIME,
        "uint32",
        *UNITREE_IMU,
        "uint8",
        "float32",
        "uint8",
        *["float32"] * 13,
        *["int16"] * 4,
        *["float32"] * 24,
    ],
    "LowState": [
        *["uint8"] * 4,
        *["uint32"] * 4,
        "uint16",
        *UNITREE_IMU,
        *["uint8", *["float32"] * 7, "int8", *["uint32"] * 3] * 20,
        *["uint8"] * 4,
        "int32",
        "uint16",
        *["int8"] * 4,
        *["uint16"] * 15,
        *["int16"] * 8,
        "uint32",
        *["uint8"] * 41,
        "float32",
        *["int8"] * 2,
        *["float32"] * 2,
        *["uint16"] * 4,
        *["uint32"] * 2,
    ],
    "Request": ["int64", "int64", "int64", "int32", "bool", "string", "bytes"],
}
"""Each message's primitives in order, as its .msg file and those that it includes list them."""


def encode(layout, values, order="<", padding=0):
    """Return the CDR of `values`, one for each primitive of `layout`, with this value in the padding."""
    out = bytearray()

    def put(code, *items):
        size = struct.calcsize(order + code)
        out.extend([padding] * (-len(out) % size))
        for item in items:
            out.extend(struct.pack(order + code, item))

    for kind, value in zip_longest(layout, values):
        if kind in ("string", "bytes"):
            body = value.encode() + b"\0" if kind == "string" else bytes(value)
            put("I", len(body))
            out.extend(body)
        elif kind.endswith("[]"):
            put("I", len(value))
            put(_CODES[kind[:-2]], *value) if value else None
        else:
            put(_CODES[kind], value)
    return HEADER[order] + bytes(out)


def decode(layout, payload, order="<"):
    """Return the values in a CDR payload; what is left over may only pad it to a multiple of 4."""
    assert payload[:4] == HEADER[order]
    body, at = payload[4:], 0

    def take(code):
        nonlocal at
        size = struct.calcsize(order + code)
        at += -at % size
        (value,) = struct.unpack_from(order + code, body, at)
        at += size
        return value

    values = []
    for kind in layout:
        if kind in ("string", "bytes"):
            length = take("I")
            chunk = body[at : at + length]
            assert len(chunk) == length
            at += length
            if kind == "string":
                assert chunk.endswith(b"\0")
            values.append(chunk[:-1].decode() if kind == "string" else chunk)
        elif kind.endswith("[]"):
            values.append([take(_CODES[kind[:-2]]) for _ in range(take("I"))])
        else:
            values.append(take(_CODES[kind]))
    assert len(body) - at < 4
    return values


def mask_padding(layout, payload):
    """Return a payload with zeros wherever its layout has padding, so that two encoders can be compared."""
    order = "<" if payload[1] else ">"
    return encode(layout, decode(layout, payload, order), order)
