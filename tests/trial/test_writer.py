"""The log's writer syncs its file and folders to the disk in time, and outlives a broken live view."""

from __future__ import annotations

import contextlib
import os
import threading

import pytest

from adatracker_deploy.trial import writer
from adatracker_deploy.trial.ipc import LogLine, PictureSlots, Post, Ready, Start

METADATA = {"trial": {"step_format": "1"}, "config": {"yaml": "{}"}}


@pytest.fixture
def writing(tmp_path, monkeypatch):
    """Run a writer in a thread; give its post, its folder, what it has synced, and a condition to wait on."""
    synced, changed = [], threading.Condition()

    def note(what):
        with changed:
            synced.append(what)
            changed.notify_all()

    class Noted(writer.WholeTicks):
        def sync(self):
            super().sync()
            note(self.tell())

    monkeypatch.setattr(writer, "WholeTicks", Noted)
    monkeypatch.setattr(writer, "SYNC_INTERVAL_S", 0.01)
    monkeypatch.setattr(
        writer, "sync_folder", lambda folder: note((folder, sorted(file.name for file in folder.iterdir())))
    )
    folder = tmp_path / "trial"
    folder.mkdir()
    with started(folder) as post:
        yield post, folder, synced, changed


@contextlib.contextmanager
def started(folder, live_port=None):
    """Start a writer in a thread; give its post once it is ready."""
    near, far = Post.pair()
    memory = PictureSlots.allocate()
    thread = threading.Thread(target=writer.TrialWriter(Post(far), PictureSlots(memory)).run)
    thread.start()
    post = Post(near)
    post.send(Start(str(folder / "trial.mcap.part"), str(folder / "trial.mcap"), METADATA, live_port), 10)
    assert isinstance(post.receive(10), Ready)
    yield post
    post.finish()
    thread.join(10)
    post.close()
    os.close(memory)


def test_before_it_says_ready_the_new_file_and_its_folders_would_outlive_a_power_cut(writing):
    _, folder, synced, _ = writing
    size = (folder / "trial.mcap.part").stat().st_size
    assert synced == [size, (folder, ["trial.mcap.part"]), (folder.parent, ["trial"])]


def test_what_was_written_is_synced_soon_though_nothing_more_comes(writing):
    post, folder, synced, changed = writing
    before = (folder / "trial.mcap.part").stat().st_size
    post.send(LogLine(1, "info", "the wind freshens"), 10)
    with changed:
        assert changed.wait_for(lambda: isinstance(synced[-1], int) and synced[-1] > before, 10)
        assert synced[-1] == (folder / "trial.mcap.part").stat().st_size


def test_at_the_end_the_file_is_synced_then_named_then_its_folder_is_synced(writing):
    post, folder, synced, changed = writing
    post.finish()
    with changed:
        assert changed.wait_for(lambda: synced[-1] == (folder, ["trial.mcap"]), 10)
        assert synced[-2] == (folder / "trial.mcap").stat().st_size


class TornView:
    """A live view that fails at the first message."""

    closed = 0

    def __init__(self, port):
        """Listen nowhere."""

    def show(self, messages):
        raise RuntimeError("the line is torn")

    def close(self):
        TornView.closed += 1


def test_a_live_view_that_fails_ends_and_the_log_goes_on_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "LiveView", TornView)
    with started(tmp_path, live_port=1) as post:
        for number in range(3):
            post.send(LogLine(number, "info", f"event {number}"), 10)
    trial = (tmp_path / "trial.mcap").read_bytes()
    assert [trial.count(f"event {number}".encode()) for number in range(3)] == [1, 1, 1]
    assert trial.count(b"the live view has ended: the line is torn") == 1
    assert TornView.closed == 1
