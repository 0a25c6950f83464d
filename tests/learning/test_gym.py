"""Gymnasium finds the environments by name in a process that has imported nothing of this package."""

from __future__ import annotations

import subprocess
import sys

import pytest


def made(what: str) -> subprocess.CompletedProcess[str]:
    code = f"import gymnasium; {what}; import sys; print('torch' in sys.modules)"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["AdaTracker-v0", "AdaTrackerClean-v0", "AdaTrackerHard-v0"])
def test_a_name_with_its_module_is_made_without_an_import(name):
    done = made(f"gymnasium.make('adatracker_deploy.gym:{name}').reset(seed=3)")
    assert (done.returncode, done.stdout) == (0, "False\n"), done.stderr


def test_importing_the_module_registers_them_all():
    done = made(
        "import adatracker_deploy.gym; [gymnasium.spec(f'AdaTracker{n}-v0') for n in ('', 'Clean', 'Field')]"
    )
    assert done.returncode == 0, done.stderr
