"""SocketCAN's tests run in namespaces of this kernel, else in user-mode Linux, else not at all."""

from __future__ import annotations

import shlex
import sys

import pytest

from tests.tiers import EXHAUSTIVE
from tests.wheeled.uml import launcher
from tests.wheeled.uml.choice import NoRoomError, find_room
from tests.wheeled.uml.interfaces import IFF_UP

PYTHON = shlex.quote(sys.executable)
TAKE_DOWN = 'from tests.wheeled.uml.interfaces import set_up; set_up("vcan0", False); exit(5)'


def test_a_machine_with_neither_is_told_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(NoRoomError, match=r"unshare is not installed.*apt-get install user-mode-linux"):
        find_room()


@EXHAUSTIVE
@pytest.mark.skipif(
    launcher.kernel() is None, reason="user-mode Linux is not installed, or cannot run on this processor"
)
def test_a_kernel_with_vcan_lends_a_bus_of_its_own_and_keeps_its_other_interfaces_from_it():
    script = (
        f"{PYTHON} -m tests.wheeled.uml {PYTHON} -c '{TAKE_DOWN}'; echo $?; cat /sys/class/net/vcan0/flags"
    )
    ended = launcher.run(["sh", "-c", script], limit_s=60.0)
    status, flags = ended.output.split()
    assert status == "5"
    assert int(flags, 16) & IFF_UP
