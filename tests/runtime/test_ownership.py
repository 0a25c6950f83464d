import os
import subprocess
import sys
import uuid

import pytest

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.runtime.ownership import Claim

HOLD = """
import sys
from adatracker_deploy.runtime.ownership import Claim
claim = Claim(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def robot():
    return f"test:{uuid.uuid4()}"


def test_a_robot_has_one_owner(robot):
    claim = Claim(robot)
    with pytest.raises(PlatformError, match=rf"process {os.getpid()}\): end that one first"):
        Claim(robot)
    claim.close()
    claim.close()
    Claim(robot).close()


def test_whatever_ends_the_owner_frees_the_robot(robot):
    owner = subprocess.Popen(
        [sys.executable, "-c", HOLD, robot], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert owner.stdout.readline() == "held\n"
    with pytest.raises(PlatformError, match=f"process {owner.pid}"):
        Claim(robot)
    owner.kill()
    owner.wait()
    Claim(robot).close()
