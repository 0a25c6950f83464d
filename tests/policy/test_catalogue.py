"""Policies are found by name or by folder, or refused with what there is."""

from __future__ import annotations

import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy import catalogue
from adatracker_deploy.policy.catalogue import describe_policies, load_policy
from tests.policy import tiny


def test_pid_is_always_there():
    assert load_policy("pid").info.name == "pid"
    assert "baseline" in describe_policies()["pid"]


def test_every_policy_in_the_list_loads():
    for name in describe_policies():
        assert load_policy(name).info.rate_hz > 0


@pytest.mark.parametrize("name", ["mine", "./mine", "{absolute}/mine"])
def test_a_bundle_is_loaded_from_its_folder(tmp_path, monkeypatch, name):
    tiny.Parts().write(tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    assert load_policy(name.format(absolute=tmp_path)).info.name == "tiny"


def test_a_shipped_bundle_is_found_and_described_by_name(tmp_path, monkeypatch):
    tiny.Parts().write(tmp_path / "bundles" / "small")
    monkeypatch.setattr(catalogue, "__file__", str(tmp_path / "catalogue.py"))
    assert describe_policies()["small"] == "random weights, 10 Hz"
    assert load_policy("small").info.name == "tiny"
    with pytest.raises(UsageError, match="known are pid, small; or"):
        load_policy("genius")


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(
        UsageError, match=r"unknown policy 'genius': known are pid.*; or give a bundle's folder"
    ):
        load_policy("genius")


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(UsageError, match=f"{tmp_path}/gone: is not a policy bundle: no such folder"):
        load_policy(f"{tmp_path}/gone")
