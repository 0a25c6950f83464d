"""What is ordered of a simulator over its stdin: faults that begin and end, and a witness."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.sim.process import FaultCommands, SimulatorProcess


def test_faults_begin_and_end_and_every_listener_hears_of_it():
    orders, heard = FaultCommands(), []
    orders.listen(heard.append)
    for line in ("begin camera_gone\n", "begin link_drop", "end camera_gone", "end battery_low"):
        orders.handle(line)
    assert orders.faults == {"link_drop"}
    assert heard == [{"camera_gone"}, {"camera_gone", "link_drop"}, {"link_drop"}, {"link_drop"}]


def test_a_witness_writes_where_it_is_told(tmp_path):
    orders = FaultCommands()
    orders.witness.command(Twist(1.0))  # to nobody
    path = tmp_path / "with a space.txt"
    orders.handle(f"witness {path}\n")
    orders.witness.command(Twist(0.5))
    assert path.read_text().endswith(" command 0.5 0 0 0\n")
    orders.handle(f"witness {tmp_path}/no/such/folder\n")
    orders.witness.off()
    assert path.read_text().endswith(" off\n")


@given(st.text().filter(lambda text: not text.lstrip().startswith(("begin", "witness"))))
def test_other_orders_mean_nothing(line):
    orders = FaultCommands()
    orders.handle(line)
    assert orders.faults == frozenset()


def test_a_process_that_is_not_there_is_not_told():
    SimulatorProcess("no.such.module", "simulated nothing").order("begin link_drop")
