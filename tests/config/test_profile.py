"""A profile is read whole and typed, or refused with file, key and reason."""

from __future__ import annotations

import re

import pytest
import yaml

from adatracker_deploy import registry
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.registry import load_profile, profile_dir, profile_names
from adatracker_deploy.testing.fake import FakePlatform

SHIPPED = (profile_dir() / "px4_quad.yaml").read_text()


def variant(tmp_path, change):
    document = yaml.safe_load(SHIPPED)
    change(document)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document))
    return str(path)


@pytest.mark.parametrize("name", profile_names())
def test_every_shipped_profile_loads(name):
    profile = load_profile(name)
    assert profile.name == name
    assert profile.limits.command_timeout_s < profile.limits.hold_after_s < profile.limits.disengage_after_s


def test_no_shipped_profile_tells_a_camera_or_a_gain_outside_sitl():
    for name in profile_names():
        document = yaml.safe_load((profile_dir() / f"{name}.yaml").read_text())
        document.pop("sitl", None)
        words = set(re.findall(r"[a-z]+", " ".join(_keys(document))))
        assert not words & {"height", "pitch", "fov", "intrinsics", "focal", "gain", "kp", "ki", "kd"}


def _keys(document):
    for key, value in document.items():
        yield key
        if isinstance(value, dict):
            yield from _keys(value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["limits"].update(forwards_m_s=1), "limits: unknown key 'forwards_m_s'; did you mean"),
        (lambda d: d["limits"].update(forward_m_s="fast"), "limits: forward_m_s: expected a number"),
        (lambda d: d["limits"].update(forward_m_s=99), "limits: forward_m_s: 99.0 is out of range"),
        (lambda d: d["connection"].update(uri="x"), "connection: unknown key 'uri'"),
        (
            lambda d: d.update(sitl={"camera": {"fov_deg": 400}}),
            "sitl: camera: fov_deg: 400.0 is out of range",
        ),
        (lambda d: d.pop("limits"), "missing key 'limits'"),
        (lambda d: d.update(platform="submarine"), "unknown platform 'submarine'"),
    ],
)
def test_what_is_wrong_is_named_with_the_file(tmp_path, change, message):
    with pytest.raises(UsageError, match=re.escape(message)) as caught:
        load_profile(variant(tmp_path, change))
    assert "mine.yaml" in str(caught.value) or "platform" in message


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(UsageError, match=r"unknown profile 'px5'.*px4_quad"):
        load_profile("px5")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1", "not valid YAML"),
        ("- 1", "expected a mapping"),
        ("!!python/object:os.system {}", "not valid YAML"),
    ],
)
def test_a_file_that_is_no_profile_is_refused(tmp_path, text, message):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message):
        load_profile(str(path))


def test_a_missing_and_an_oversized_file_are_refused(tmp_path):
    with pytest.raises(UsageError, match="no such file"):
        load_profile(str(tmp_path / "none.yaml"))
    huge = tmp_path / "huge.yaml"
    huge.write_text("#" * (2 << 20))
    with pytest.raises(UsageError, match="larger than 1024 KiB"):
        load_profile(str(huge))


FROM_OUTSIDE = """
platform: fake
description: of a robot from outside
limits: {forward_m_s: 1, backward_m_s: 1, yaw_rate_rad_s: 1, accel_m_s2: 1, yaw_accel_rad_s2: 1}
camera: {uri: "world://simple_room"}
connection: {}
sitl: {}
"""


class OutsideRobot(FakePlatform):
    """A robot whose profiles are in its own package."""


@pytest.fixture
def outside(tmp_path, monkeypatch):
    monkeypatch.setattr(OutsideRobot, "profile_dir", tmp_path)
    for name in ("outsider", "px4_quad"):
        (tmp_path / f"{name}.yaml").write_text(FROM_OUTSIDE)
    return OutsideRobot


def install(monkeypatch, **robots):
    """Let these be the installed robots; an error stands for one that cannot be loaded."""

    def load(name):
        if isinstance(robots[name], UsageError):
            raise robots[name]
        return robots[name]

    monkeypatch.setattr(registry, "platform_names", lambda: sorted(robots))
    monkeypatch.setattr(registry, "load_platform", load)


def test_a_robot_from_outside_brings_its_profiles_along(outside):
    profile = load_profile("outsider", outside)
    assert (profile.name, profile.description) == ("outsider", "of a robot from outside")


def test_a_robots_own_profile_comes_before_a_shipped_one_of_the_same_name(outside):
    assert load_profile("px4_quad", outside).platform == "fake"


def test_profiles_of_an_installed_robot_are_listed_and_found_by_name_alone(outside, monkeypatch):
    assert "outsider" not in profile_names()
    install(monkeypatch, fake=outside)
    assert {"outsider", "px4_quad"} <= set(profile_names())
    assert load_profile("outsider").platform == "fake"


def test_a_robot_that_cannot_be_loaded_hides_nobodys_profiles(outside, monkeypatch):
    install(monkeypatch, broken=UsageError("needs a library"), fake=outside)
    assert "outsider" in profile_names()


def test_another_robots_own_profile_is_not_known_to_this_one(outside, monkeypatch):
    install(monkeypatch, fake=outside)
    with pytest.raises(UsageError, match="unknown profile 'outsider'"):
        load_profile("outsider", FakePlatform)
