"""Frames as pymavlink packs and signs them, for tests."""

from pymavlink.dialects.v20 import common as mavlink

KEY = bytes(range(32))


def packer(system=1, component=1, key=None, *, link=0, time=1):
    made = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    made.signing.secret_key, made.signing.sign_outgoing = key, key is not None
    made.signing.link_id, made.signing.timestamp = link, time
    return made


def heartbeat(**sender):
    return bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(packer(**sender)))
