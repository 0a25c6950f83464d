"""What is injected goes to its place, into the log and to the witness; what comes too late is told."""

from __future__ import annotations

import threading
from types import SimpleNamespace

from adatracker_deploy.faults.catalogue import LINK_DROP, known_faults
from adatracker_deploy.faults.injection import Injection
from adatracker_deploy.faults.schedule import parse_schedule
from adatracker_deploy.faults.witness import FILE_NAME, read_witness
from adatracker_deploy.runtime.clock import MonotonicClock


class FarEnd:
    """A simulated robot that keeps what it is ordered."""

    faults = (LINK_DROP,)

    def __init__(self):
        self.orders = []

    def order(self, line):
        self.orders.append(line)


def test_each_fault_is_ordered_or_struck_and_written_down_and_one_after_the_end_is_not(tmp_path):
    far_end, events, begun = FarEnd(), [], threading.Event()

    def event(level, message, _):
        events.append((level, message))
        begun.set()

    strikes = parse_schedule(["link_drop@0,policy_nan@3600"], known_faults(far_end.faults))
    injection = Injection(strikes, far_end, MonotonicClock())
    injection.attend(SimpleNamespace(folder=tmp_path, event=event), None)
    for _ in range(3):  # every tick
        injection.follow()
    assert begun.wait(10)
    injection.close()
    injection.close()
    assert far_end.orders == [f"witness {tmp_path / FILE_NAME}", "begin link_drop", "end link_drop"]
    assert events == [
        ("warning", "fault: link_drop begins"),
        ("warning", "fault: link_drop is over"),
        ("warning", "fault: policy_nan was not injected: the trial had ended"),
    ]
    account = read_witness((tmp_path / FILE_NAME).read_text())
    (began_ns, *begins), (over_ns, *ends) = account.faults
    assert (begins, ends) == (["link_drop", True], ["link_drop", False])
    assert over_ns - began_ns >= LINK_DROP.lasts_s * 1e9
