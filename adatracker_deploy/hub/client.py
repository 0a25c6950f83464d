"""Fetches from the Hub and publishes to it, by its own client; what was fetched stays in the client's cache.

``HF_ENDPOINT``, ``HF_TOKEN``, ``HF_HOME`` and ``HF_HUB_OFFLINE`` hold here as everywhere.
"""

from __future__ import annotations

import contextlib
import logging
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.hub.address import HubAddress
from adatracker_deploy.hub.blob import is_whole

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from huggingface_hub import HfApi
    from huggingface_hub.errors import HfHubHTTPError

    from adatracker_deploy.hub.address import Kind

_LOGIN = "with HF_TOKEN, or after 'hf auth login'"


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """Files of a repository at one commit, in the cache of this machine."""

    address: HubAddress
    """Names the commit."""
    folder: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Published:
    """Result of publishing."""

    address: HubAddress
    """Names the commit that was made."""
    url: str
    private: bool


def fetch(address: HubAddress, patterns: Sequence[str] | None = None) -> Snapshot:
    """Fetch a repository's files into the cache, unless they are there.

    A commit that is in the cache is taken from there without a word to the Hub. A branch or tag is asked for
    at each call; where the Hub cannot be reached, it is what it was the last time, and a warning says so.

    Args:
        address: where they are.
        patterns: of the files' names, as in a shell; all of them by default.

    Raises:
        UsageError: there is no such repository or revision; it is neither in the cache nor to be had; a file
            in the cache is not what the Hub gave.
    """
    api = _api()
    from huggingface_hub import snapshot_download

    with _told(address):
        commit = api.resolve_revision(
            address.repo, repo_type=address.kind, revision=address.revision
        ).resolved
        folder = snapshot_download(
            address.repo,
            repo_type=address.kind,
            revision=commit,
            allow_patterns=None if patterns is None else list(patterns),
        )
    snapshot = Snapshot(address=address.at(commit), folder=Path(folder))
    for path in sorted(snapshot.folder.rglob("*")):
        if path.is_file() and not is_whole(path):
            raise UsageError(
                f"{snapshot.address}: {path} is not what the Hub gave: damaged or changed; delete "
                f"{snapshot.folder.parents[1]} and fetch it again"
            )
    return snapshot


def publish(
    address: HubAddress, files: Mapping[str, bytes | Path], *, message: str, public: bool
) -> Published:
    """Make one commit of files; the repository is made where there is none.

    Args:
        address: the repository and a branch of it.
        files: by their path in the repository: what they hold, or which file.
        message: the commit's.
        public: a repository that is made can be seen by everybody; one that exists stays as it is.

    Raises:
        UsageError: the Hub cannot be reached, or refuses.
    """
    api = _api()
    from huggingface_hub import CommitOperationAdd

    with _told(address):
        api.create_repo(address.repo, repo_type=address.kind, private=not public, exist_ok=True)
        made = api.create_commit(
            address.repo,
            [CommitOperationAdd(path, held) for path, held in files.items()],
            repo_type=address.kind,
            revision=address.revision,
            commit_message=message,
        )
        about = api.repo_info(address.repo, repo_type=address.kind)
        return Published(address=address.at(made.oid), url=made.commit_url, private=bool(about.private))


def read_file(address: HubAddress, name: str) -> bytes | None:
    """Return one file as it now is on the Hub; None where repository, branch or file is not there.

    Raises:
        UsageError: the Hub cannot be reached, or refuses.
    """
    api = _api()
    from huggingface_hub.errors import (
        RemoteEntryNotFoundError,
        RepositoryNotFoundError,
        RevisionNotFoundError,
    )

    with _told(address):
        try:
            path = api.hf_hub_download(address.repo, name, repo_type=address.kind, revision=address.revision)
        except (RemoteEntryNotFoundError, RepositoryNotFoundError, RevisionNotFoundError):
            return None
    return Path(path).read_bytes()


def _api() -> HfApi:
    try:
        from huggingface_hub import HfApi
        from huggingface_hub.utils.tqdm import disable_progress_bars
    except ImportError as error:
        raise UsageError("the Hub needs huggingface_hub: pip install 'adatracker-deploy[hub]'") from error
    if not sys.stderr.isatty():
        disable_progress_bars()
    # That none of the wanted files is there is said by whoever wants them.
    logging.getLogger("huggingface_hub._snapshot_download").setLevel(logging.ERROR)
    return HfApi(library_name="adatracker-deploy")


@contextlib.contextmanager
def _told(address: HubAddress) -> Iterator[None]:
    """Turn what the client raises into one line."""
    from httpx2 import HTTPError  # the client's own library
    from huggingface_hub import errors

    try:
        yield
    except errors.GatedRepoError as error:
        raise UsageError(
            f"{address}: is gated: ask for access on its page, and come back {_LOGIN}"
        ) from error
    except errors.RepositoryNotFoundError as error:
        raise UsageError(
            f"{address}: there is no such {_kind(address.kind)}, or it is private: then come {_LOGIN}"
        ) from error
    except errors.RevisionNotFoundError as error:
        raise UsageError(f"{address}: there is no such branch, tag or commit") from error
    except (errors.LocalEntryNotFoundError, errors.RevisionResolutionError) as error:
        raise UsageError(
            f"{address}: is not in this machine's cache, and the Hub cannot be reached ({_reason(error)})"
        ) from error
    except errors.HfHubHTTPError as error:
        known = f"; come with a token that may do that, {_LOGIN}" if _is_about_rights(error) else ""
        raise UsageError(f"{address}: the Hub refused: {_reason(error)}{known}") from error
    except errors.OfflineModeIsEnabled as error:
        raise UsageError(f"{address}: the Hub is not asked, because HF_HUB_OFFLINE is set") from error
    except HTTPError as error:
        raise UsageError(f"{address}: the Hub cannot be reached ({_reason(error)})") from error
    except OSError as error:  # the cache cannot be written, the disk is full, less came than was announced
        raise UsageError(f"{address}: cannot be fetched or sent: {_reason(error)}") from error
    except (AssertionError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{address}: the answer is not that of a Hub: {_reason(error)}") from error


def _is_about_rights(error: HfHubHTTPError) -> bool:
    return error.response.status_code in (401, 403)


def _kind(kind: Kind) -> str:
    return "policy (model)" if kind == "model" else "dataset"


def _reason(error: BaseException) -> str:
    """Return the innermost reason in one line."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0].rstrip(".") if lines else type(error).__name__
