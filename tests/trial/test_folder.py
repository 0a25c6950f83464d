"""A place for logs is tried before anything moves, not guessed at."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.folder import place_for_logs


def test_a_place_that_can_be_written_is_left_as_it_was(tmp_path):
    assert place_for_logs(tmp_path / "to" / "come") == tmp_path
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def not_writable():
    """A folder that is there and that whoever runs this may read, not write."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o555)
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    yield folder
    os.seteuid(before)
    folder.rmdir()


def test_a_folder_that_is_there_and_cannot_be_written_is_refused(not_writable):
    with pytest.raises(UsageError, match=r"Permission denied.*--log-dir"):
        place_for_logs(not_writable)
    with pytest.raises(UsageError, match=r"Permission denied.*--log-dir"):
        place_for_logs(not_writable / "trials")


@pytest.mark.parametrize("place", ["a file", "a file/trials", "a link", "/proc", "/proc/trials"])
def test_where_no_folder_can_be_made_a_run_is_refused_before_it_connects(tmp_path, capsys, place):
    (tmp_path / "a file").write_text("")
    (tmp_path / "a link").symlink_to(tmp_path / "gone")
    log_dir = tmp_path / place
    with pytest.raises(UsageError, match="--log-dir"):
        place_for_logs(log_dir)
    assert main(["--platform", "wheeled", "--sitl", "--log-dir", str(log_dir)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)  # no phase was begun
    assert "choose another with --log-dir" in err
