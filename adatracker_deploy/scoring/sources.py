"""Finds what can be scored: trials, plain box files, and folders of either."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.scoring.box_file import ABSENT_SUFFIX, read_boxes
from adatracker_deploy.scoring.summary import summarise_boxes, summarise_log
from adatracker_deploy.trial.folder import FILE_NAME, PART_NAME
from adatracker_deploy.trial.reader import find_trials, read_scored
from adatracker_deploy.trial.search import search

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.scoring.box_file import BoxOptions
    from adatracker_deploy.scoring.metrics import Rules
    from adatracker_deploy.scoring.tally import Summary

TRIAL_SUFFIXES = (".mcap", ".part")
BOX_SUFFIXES = (".txt", ".csv")


def find_sources(path: Path) -> list[Path]:
    """Return what a path names: a file itself; of a folder the trials below it, or else its box files.

    Raises:
        UsageError: there is nothing.
    """
    if not path.is_dir():
        return [path]
    logs = search(path, {FILE_NAME, PART_NAME}.__contains__).files
    return find_trials(path) if logs else find_box_files(path)


def find_box_files(path: Path) -> list[Path]:
    """Return a file itself, or the box files in a folder and below it, sorted; flags of absence are left out.

    Raises:
        UsageError: there is none.
    """
    if not path.is_dir():
        return [path]
    found = search(path, lambda name: name.endswith(BOX_SUFFIXES) and not name.endswith(ABSENT_SUFFIX))
    files = found.files + found.refused
    if not files:
        raise UsageError(
            f"{path}: no trials in it: no folder here has a {FILE_NAME}, and no .txt or .csv holds boxes"
        )
    return files


def summarise_source(path: Path, rules: Rules, options: BoxOptions, *, boxes: bool = False) -> Summary:
    """Score a trial, by its folder or file, or a box file.

    Args:
        path: one of `find_sources`.
        rules: how to score.
        options: what a box file does not say itself.
        boxes: it is a box file, whatever its name.

    Raises:
        UsageError: it cannot be scored.
    """
    if not boxes and (path.is_dir() or path.suffix in TRIAL_SUFFIXES or not path.exists()):
        return summarise_log(read_scored(path), rules)
    return summarise_boxes(read_boxes(path, options), path, rules)
