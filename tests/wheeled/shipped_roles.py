"""The shipped profiles' roles and codecs, read straight from YAML, and frames by their bytes."""

import copy

import yaml

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.schema import parse
from adatracker_deploy.registry import profile_dir
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.protocol.roles import Roles

BASES = ("scout", "tracer", "hunter", "scout_v1", "odrive_diff")


def document(name):
    return yaml.safe_load((profile_dir() / f"{name}.yaml").read_text())


def roles_as_written(name="scout"):
    """A profile's roles as plain YAML, to be changed by a test."""
    return copy.deepcopy(document(name)["connection"]["roles"])


def roles_of(name):
    return parse(Roles, roles_as_written(name), where="roles")


def limits_of(name):
    return parse(Limits, document(name)["limits"], where="limits")


def codec_of(name):
    return Codec(roles_of(name))


def codec_from(written):
    return Codec(parse(Roles, written, where="profile"))


def frame(can_id, data):
    return CanFrame(can_id, bytes(data))
