"""Network interfaces by the kernel's own calls, so that no ``iproute2`` is needed; wants CAP_NET_ADMIN.

Messages are those of rtnetlink(7), flags and ioctls those of netdevice(7).
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct

RTM_NEWLINK, RTM_DELLINK = 16, 17
NLM_F_REQUEST, NLM_F_ACK, NLM_F_EXCL, NLM_F_CREATE = 0x1, 0x4, 0x200, 0x400
NLMSG_ERROR = 2
IFLA_IFNAME, IFLA_LINKINFO, IFLA_INFO_KIND = 3, 18, 1
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 0x1

_HEADER = struct.Struct("=LHHLL")
"""nlmsghdr: length, type, flags, sequence number, port."""
_IFINFO = struct.Struct("=BxHiII")
"""ifinfomsg: family, type, index, flags, change."""


def add_vcan(name: str) -> None:
    """Make a virtual CAN interface, down.

    Raises:
        OSError: it exists (EEXIST), the kernel has no vcan (EOPNOTSUPP), or this process may not (EPERM).
    """
    kind = _attribute(IFLA_LINKINFO, _attribute(IFLA_INFO_KIND, b"vcan"))
    body = _IFINFO.pack(0, 0, 0, 0, 0) + _attribute(IFLA_IFNAME, name.encode() + b"\0") + kind
    _request(RTM_NEWLINK, NLM_F_CREATE | NLM_F_EXCL, body)


def remove(name: str) -> None:
    """Take an interface out of the kernel, as when its adapter is unplugged.

    Raises:
        OSError: there is no such interface, or this process may not.
    """
    _request(RTM_DELLINK, 0, _IFINFO.pack(0, 0, socket.if_nametoindex(name), 0, 0))


def set_up(name: str, up: bool = True) -> None:
    """Take an interface up, or down.

    Raises:
        OSError: there is no such interface, or this process may not.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = struct.pack("16sH14x", name.encode(), 0)
        flags = struct.unpack_from("16xH", fcntl.ioctl(control, SIOCGIFFLAGS, request))[0]
        flags = flags | IFF_UP if up else flags & ~IFF_UP
        fcntl.ioctl(control, SIOCSIFFLAGS, struct.pack("16sH14x", name.encode(), flags))


def _attribute(kind: int, value: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(value), kind) + value + bytes(-len(value) % 4)


def _request(kind: int, flags: int, body: bytes) -> None:
    """Ask the kernel, and raise its refusal."""
    flags |= NLM_F_REQUEST | NLM_F_ACK
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
        kernel.send(_HEADER.pack(_HEADER.size + len(body), kind, flags, 1, 0) + body)
        answer = kernel.recv(4096)
    assert _HEADER.unpack_from(answer)[1] == NLMSG_ERROR, "an acknowledged request is answered by NLMSG_ERROR"
    if error := -struct.unpack_from("=i", answer, _HEADER.size)[0]:
        raise OSError(error, os.strerror(error))
