"""The files of a policy or of trials, as they are published: checked, with their card."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.bundle import CARD_NAME, MANIFEST_NAME
from adatracker_deploy.policy.catalogue import PID, find_bundle, is_remote
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from adatracker_deploy.publishing.card import as_csv, merged, policy_card, trials_card
from adatracker_deploy.scoring.index import COLUMNS, index
from adatracker_deploy.trial.folder import CONFIG_NAME, FILE_NAME, PART_NAME, SUMMARY_NAME
from adatracker_deploy.trial.marks import marks_path
from adatracker_deploy.trial.reader import find_trials, read_trial
from adatracker_deploy.trial.search import search

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from adatracker_deploy.hub.address import HubAddress
    from adatracker_deploy.trial.reader import Trial

Files = dict[str, "bytes | Path"]
"""By their path in the repository: what they hold, or which file."""
INDEX_NAME, README_NAME = "trials.csv", "README.md"


def policy_files(name_or_dir: str, address: HubAddress) -> Files:
    """Return a bundle's files and its card; it answers here as it did when it was exported.

    Raises:
        UsageError: it has no bundle, or that is refused.
    """
    if name_or_dir == PID or is_remote(name_or_dir):
        raise UsageError(f"{name_or_dir}: has no bundle to be published")
    bundle = find_bundle(name_or_dir)
    OnnxPolicy(bundle)
    card = bundle.folder / CARD_NAME
    text = card.read_text(encoding="utf-8") if card.is_file() else ""
    files: Files = {name: bundle.folder / name for name in (MANIFEST_NAME, *bundle.manifest.files)}
    return files | {README_NAME: policy_card(bundle.manifest, text, str(address)).encode()}


def trials_in(path: Path) -> bool:
    """Return whether a path is a trial's file or a folder with trials in or below it."""
    named = {FILE_NAME, PART_NAME}
    return path.name in named or bool(path.is_dir() and search(path, named.__contains__).files)


def trial_files(
    named: Sequence[Path], address: HubAddress, *, there: bytes | None, licence: str, pictures: bool
) -> Files:
    """Return the files of trials, with an index and a card that also tell of those published before.

    Args:
        named: trials, or folders of them.
        address: where they will be.
        there: the index that is there; None where there is none.
        licence: of the dataset, an SPDX identifier.
        pictures: publish pictures of real places as they were taken.

    Raises:
        UsageError: one cannot be read, is not finished, or has pictures that nobody agreed to publish; two
            have the same name; the repository's index is none.
    """
    places = [place for path in named for place in find_trials(path)]
    files: Files = {}
    rows: list[dict[str, Any]] = []
    for place in places:
        trial = read_trial(place)
        folder = trial.path.parent
        if trial.path.name != FILE_NAME:
            raise UsageError(
                f"{place}: is not finished: adatracker-deploy salvage completes what was cut short"
            )
        if not pictures and shows_people(trial):
            raise UsageError(
                f"{place}: its pictures were taken of real people and places, and everybody may come to see "
                "them: publish trials that ran with --blur or --no-frames, or agree with --with-pictures"
            )
        name = folder.resolve().name
        if any(path.startswith(f"trials/{name}/") for path in files):
            raise UsageError(f"{place}: another trial of these has the same name")
        row = next(row for row in index(folder) if row["trial"] == str(folder))
        if row["error"]:
            raise UsageError(f"{place}: {row['error']}")
        rows.append(row | {"trial": name})
        kept = (trial.path, folder / SUMMARY_NAME, folder / CONFIG_NAME, marks_path(trial.path))
        files |= {f"trials/{name}/{path.name}": path for path in kept if path.is_file()}
    try:
        table = merged(there, rows, COLUMNS)
    except (ValueError, UnicodeDecodeError) as error:
        raise UsageError(
            f"{address}: holds another {INDEX_NAME} ({error}); choose another dataset"
        ) from error
    title = address.repo.split("/")[1]
    files[INDEX_NAME] = as_csv(table, COLUMNS)
    files[README_NAME] = trials_card(table, title, licence, str(address)).encode()
    return files


def shows_people(trial: Trial) -> bool:
    """Return whether a log has pictures, unblurred, of what was not a virtual world.

    Only virtual worlds tell the truth of a tick.
    """
    virtual = any(step.target_visible is not None or step.sight is not None for step in trial.steps)
    return bool(trial.frame_seqs) and trial.frames_kept == "full" and not virtual
