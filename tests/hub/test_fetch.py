"""A policy is fetched from the Hub once, checked, and there without it afterwards."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from huggingface_hub import constants

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.catalogue import find_bundle, load_policy, pinned
from tests.policy.tampering import put, reseal

NAME = "hf://lab/follower"


def refusal(name):
    with pytest.raises(UsageError) as refused:
        load_policy(name)
    (line,) = str(refused.value).splitlines()
    return line


@pytest.mark.parametrize("revision", ["", "@main", "@v1", "@{commit}"])
def test_a_policy_is_loaded_by_name_and_revision(hub, bundle_files, revision):
    commit = hub.add("lab/follower", bundle_files | {"README.md": b"# Follower\n", "film.mp4": b"large"})
    hub.repos["model", "lab/follower"].refs["v1"] = commit
    policy = load_policy(NAME + revision.format(commit=commit))
    assert policy.info.name == "tiny"
    assert policy.info.source == f"{NAME}@{commit}"
    assert not [path for _, path in hub.asked if path.endswith("film.mp4")]


def test_a_branch_that_moves_is_another_policy_and_a_commit_stays(hub, bundle_files, tmp_path):
    first = hub.add("lab/follower", bundle_files)
    before = find_bundle(NAME)
    (tmp_path / "manifest.yaml").write_bytes(bundle_files["manifest.yaml"])
    reseal(tmp_path, put("name", value="newer"))
    hub.add("lab/follower", {"manifest.yaml": (tmp_path / "manifest.yaml").read_bytes()})
    assert find_bundle(NAME).manifest.name == "newer"
    assert find_bundle(f"{NAME}@{first}").manifest == before.manifest
    assert pinned(NAME) != before.source == pinned(before.source)
    assert pinned("pid") == "pid"


def test_a_commit_in_the_cache_asks_nobody(hub, bundle_files):
    commit = hub.add("lab/follower", bundle_files)
    load_policy(NAME)
    hub.asked.clear()
    load_policy(f"{NAME}@{commit}")
    assert hub.asked == []


@pytest.fixture(params=["cut", "offline", "down"])
def left(request, hub, no_network, monkeypatch):
    """A way to be without the Hub."""
    return {
        "cut": no_network,
        "offline": lambda: monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True),
        "down": lambda: setattr(hub, "down", True),
    }[request.param]


def test_what_was_fetched_is_there_without_a_network(hub, bundle_files, left):
    commit = hub.add("lab/follower", bundle_files)
    load_policy(NAME)
    left()
    for revision in ("main", commit):
        assert load_policy(f"{NAME}@{revision}").info.source == f"{NAME}@{commit}"


def test_what_was_not_is_refused(left):
    left()
    assert "is not in this machine's cache, and the Hub cannot be reached" in refusal(NAME)


def test_a_fetch_that_broke_off_is_not_taken_for_a_whole_one(hub, bundle_files, monkeypatch, cache):
    commit = hub.add("lab/follower", bundle_files)
    load_policy(NAME)
    (cache / "models--lab--follower" / "snapshots" / commit / "golden.npz").unlink()
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    assert "is not in this machine's cache" in refusal(NAME)
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
    assert load_policy(NAME).info.source == f"{NAME}@{commit}"


@pytest.mark.parametrize("name", ["manifest.yaml", "policy.onnx", "golden.npz"])
def test_a_file_that_changed_in_the_cache_is_refused(hub, bundle_files, cache, name):
    commit = hub.add("lab/follower", bundle_files)
    load_policy(NAME)
    path = cache / "models--lab--follower" / "snapshots" / commit / name
    path.write_bytes(path.read_bytes()[:-1] + b"!")
    line = refusal(f"{NAME}@{commit}")
    assert f"{name} is not what the Hub gave" in line
    assert f"delete {cache / 'models--lab--follower'} and" in line


@pytest.mark.parametrize("name", ["manifest.yaml", "policy.onnx"])
def test_a_file_that_was_damaged_on_the_way_is_refused(hub, bundle_files, name):
    hub.add("lab/follower", bundle_files)
    hub.mangled.add(name)
    assert f"{name} is not what the Hub gave" in refusal(NAME)


def test_a_file_that_is_not_the_manifests_is_refused(hub, bundle_files):
    """The Hub holds it as it is sent: only the manifest tells."""
    hub.add("lab/follower", bundle_files | {"policy.onnx": bundle_files["policy.onnx"][:-1] + b"!"})
    line = refusal(NAME)
    assert line.startswith(f"{NAME}@")
    assert "policy.onnx: has changed: SHA-256" in line


def test_without_links_in_the_cache_the_manifest_still_tells(hub, bundle_files, cache, monkeypatch):
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_SYMLINKS", True)
    commit = hub.add("lab/follower", bundle_files)
    load_policy(NAME)
    path = cache / "models--lab--follower" / "snapshots" / commit / "policy.onnx"
    assert not path.is_symlink()
    path.write_bytes(path.read_bytes()[:-1] + b"!")
    assert "policy.onnx: has changed: SHA-256" in refusal(f"{NAME}@{commit}")


def test_a_private_policy_needs_a_token(hub, bundle_files, monkeypatch):
    hub.add("lab/follower", bundle_files, private=True)
    assert "there is no such policy (model), or it is private: then come with HF_TOKEN" in refusal(NAME)
    monkeypatch.setenv("HF_TOKEN", "hf_of_a_test")
    assert load_policy(NAME).info.name == "tiny"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (f"{NAME}@v9", f"{NAME}@v9: there is no such branch, tag or commit"),
        (f"{NAME}@{'0' * 40}", "there is no such branch, tag or commit"),
        ("hf://lab/nobody", "there is no such policy"),
        ("hf://lab/empty", "is no policy bundle: it has no manifest.yaml"),
        ("hf://datasets/lab/trials", "is a dataset, and policies are models"),
    ],
)
def test_what_is_not_there_is_refused_in_a_sentence(hub, bundle_files, name, words):
    hub.add("lab/follower", bundle_files)
    hub.add("lab/empty", {"README.md": b"nothing"})
    assert words in refusal(name)


def test_an_endpoint_that_is_no_hub_is_refused(hub, monkeypatch):
    from tests.hub.server import _Handler

    monkeypatch.setattr(_Handler, "info", lambda self, **_: self.say(200, b"<html>welcome</html>"))
    assert "the answer is not that of a Hub" in refusal(NAME)


def test_the_clients_own_environment_holds(hub, bundle_files, tmp_path):
    """HF_ENDPOINT, HF_HOME and HF_HUB_OFFLINE, in processes as a user starts them."""
    commit = hub.add("lab/follower", bundle_files)
    environment = os.environ | {"HF_ENDPOINT": constants.ENDPOINT, "HF_HOME": str(tmp_path / "home")}
    assert told(environment | {"HF_HUB_OFFLINE": "1"}) == (2, "is not in this machine's cache")
    assert told(environment) == (0, commit)
    asked = len(hub.asked)
    assert told(environment | {"HF_HUB_OFFLINE": "1"}) == (0, commit)
    assert len(hub.asked) == asked


def told(environment):
    """Load the policy in a new process: its exit status, and what it says."""
    code = (
        "import sys\n"
        "from adatracker_deploy.core.errors import UsageError\n"
        "from adatracker_deploy.policy.catalogue import load_policy\n"
        "try:\n"
        f"    print(load_policy({NAME!r}).info.source.partition('@')[2])\n"
        "except UsageError as error:\n"
        "    print(error)\n"
        "    sys.exit(2)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, text=True, env=environment
    )
    (line,) = done.stdout.splitlines()
    known = "is not in this machine's cache"
    return done.returncode, known if known in line else line


@pytest.mark.parametrize(
    "command",
    [("--platform", "wheeled", "--sitl"), ("evaluate",), ("serve",)],
)
def test_the_command_refuses_in_one_line(hub, capsys, command):
    assert main([*command, "--policy", "hf://lab/nobody@v1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("adatracker-deploy: hf://lab/nobody@v1: there is no such policy")
