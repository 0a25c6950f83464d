"""Writes the bag, in a folder that appears when complete."""

from __future__ import annotations

import contextlib
import os
import shutil
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.trial.reader import Trial

_ROOT = "/adatracker"
_VERSION = 8
"""Version of ``metadata.yaml``: Iron's, which Humble reads, too; from 9 on (Jazzy) it cannot."""


def write_bag(trial: Trial, out: Path) -> int:
    """Write a trial as a rosbag2 bag; return the number of messages.

    Args:
        trial: with at least one tick.
        out: the folder; it must not be there.

    Raises:
        UsageError: the `rosbag2` extra is not installed, the trial has no ticks, or the folder is there or
            cannot be written.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
    except ImportError as error:
        told = "a bag for ROS 2 needs rosbags: pip install 'adatracker-deploy[rosbag2]'"
        raise UsageError(told) from error
    from adatracker_deploy.report.rosbag2.entries import entries
    from adatracker_deploy.report.rosbag2.messages import STORE

    if not trial.steps:
        raise UsageError(f"{trial.path}: no ticks in it, so there is nothing to write")
    if out.exists():
        raise UsageError(f"--rosbag2 {out}: is there already; name a new folder")
    unfinished = out.with_name(f".{out.name}.{os.getpid()}")
    bag = unfinished / out.name  # rosbags names the file by its folder
    topics: dict[str, Any] = {}
    count = 0
    try:
        unfinished.mkdir()
        with contextlib.ExitStack() as undo:
            undo.callback(shutil.rmtree, unfinished)
            with Writer(bag, version=_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
                for wall_ns, (topic, type_name, message) in entries(trial):
                    if topic not in topics:
                        topics[topic] = writer.add_connection(f"{_ROOT}/{topic}", type_name, typestore=STORE)
                    writer.write(topics[topic], wall_ns, STORE.serialize_cdr(message, type_name))
                    count += 1
            bag.replace(out)
    except OSError as error:
        raise UsageError(f"--rosbag2 {out}: cannot be written: {error.strerror}") from error
    return count
