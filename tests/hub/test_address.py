"""An address on the Hub names a repository and a revision, or is refused."""

from __future__ import annotations

import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.hub.address import is_hub, parse_address


@pytest.mark.parametrize(
    ("text", "kind", "repo", "revision", "written"),
    [
        ("hf://lab/follower", "model", "lab/follower", "main", "hf://lab/follower@main"),
        ("hf://models/lab/follower@v1.2", "model", "lab/follower", "v1.2", "hf://lab/follower@v1.2"),
        ("hf://lab/a.b_c-d@refs/pr/3", "model", "lab/a.b_c-d", "refs/pr/3", "hf://lab/a.b_c-d@refs/pr/3"),
        ("hf://datasets/lab/t@x", "dataset", "lab/t", "x", "hf://datasets/lab/t@x"),
    ],
)
def test_its_parts_are_read(text, kind, repo, revision, written):
    address = parse_address(text)
    assert (address.kind, address.repo, address.revision, address.commit) == (kind, repo, revision, None)
    assert str(address) == written
    assert parse_address(written) == address


def test_a_whole_commit_is_known_as_one():
    commit = "0123456789abcdef0123456789abcdef01234567"
    assert parse_address(f"hf://lab/follower@{commit}").commit == commit
    assert parse_address(f"hf://lab/follower@{commit[:12]}").commit is None


@pytest.mark.parametrize(
    "text",
    [
        "hf://", "hf://lab", "hf:///follower", "hf://lab/follower/policy.onnx", "hf://lab/follower@",
        "hf://lab/follower@../../../etc/passwd", "hf://lab/follower@/etc/passwd", "hf://../follower",
        "hf://lab/a..b", "hf://lab/a--b", "hf://lab/.hidden", "hf://lab/follower@a b", "hf://lab/fol\nlower",
        "hf://spaces/lab/follower", "hf://lab/follower@v1\x1b[2J", "hf://láb/follower",
    ],
)  # fmt: skip
def test_anything_else_is_refused_in_one_line(text):
    assert is_hub(text)
    with pytest.raises(UsageError, match="is no address on the Hub: expected hf://OWNER/NAME") as refused:
        parse_address(text)
    assert str(refused.value).isprintable()
