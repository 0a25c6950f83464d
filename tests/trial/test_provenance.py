"""A log says with what it was made."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import Distribution

from adatracker_deploy.trial import provenance
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import a_step, a_trial


def git(folder, *arguments):
    name = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    done = subprocess.run(("git", "-C", str(folder), *name, *arguments), check=True, capture_output=True)
    return done.stdout.decode().strip()


def test_the_commit_of_a_clone_is_told_and_whether_it_was_changed(tmp_path):
    git(tmp_path, "init")
    (tmp_path / "file").write_text("one")
    git(tmp_path, "add", "file")
    git(tmp_path, "commit", "-m", "first")
    git(tmp_path, "tag", "-a", "v1", "-m", "a tag is no commit")
    head = git(tmp_path, "rev-parse", "HEAD")
    assert provenance.commit(tmp_path) == head
    (tmp_path / "file").write_text("two")
    assert provenance.commit(tmp_path) == f"{head}-dirty"


def test_a_clone_that_git_cannot_read_has_none(tmp_path):
    (tmp_path / ".git").write_text("gitdir: nowhere")
    assert provenance.commit(tmp_path) == ""


def test_the_commit_of_what_pip_installed_from_a_repository_is_told(tmp_path, monkeypatch):
    def read_text(_, name):
        assert name == "direct_url.json"
        origin = {"vcs": "git", "commit_id": "c0ffee"}
        return json.dumps({"url": "https://example.org/a.git", "vcs_info": origin})

    monkeypatch.setattr(type(Distribution.from_name("adatracker-deploy")), "read_text", read_text)
    assert provenance.commit(tmp_path) == "c0ffee"


def test_what_came_from_an_index_has_no_commit_and_says_none(tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(type(Distribution.from_name("adatracker-deploy")), "read_text", lambda *_: None)
        assert provenance.commit(tmp_path) == ""
    monkeypatch.setattr(provenance, "commit", lambda _: "")
    assert "commit" not in provenance.surroundings()


def test_a_log_has_the_command_as_it_was_typed_without_a_cameras_password(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["adatracker-deploy", "--camera", "http://me:secret@10.0.0.3/a b"])
    trial = read_trial(a_trial(tmp_path, [a_step(0)]))
    assert trial.about["command"] == "adatracker-deploy --camera 'http://10.0.0.3/a b'"
    assert b"secret" not in trial.path.read_bytes()
