"""The safety gate: the last thing a command passes before the wire. Pure functions only; no I/O, no clock.

`judge` is a function of the limits, the gate's state, the newest set-point, what the robot says of itself,
and the time. What leaves it is finite, inside the envelope, and neither accelerates nor jerks more than the
limits allow; the one exception is a stop, which is zero at once. A stop latches: only a new `GateState`, made
by an explicit engage, lets anything move again. ``docs/safety.md`` lists every limit.
"""

from adatracker_deploy.runtime.gate.judge import judge
from adatracker_deploy.runtime.gate.reasons import Kind, Reason
from adatracker_deploy.runtime.gate.state import GateState, Setpoint, Stage, Stop, Verdict
from adatracker_deploy.runtime.gate.watch import unmonitored

__all__ = ["GateState", "Kind", "Reason", "Setpoint", "Stage", "Stop", "Verdict", "judge", "unmonitored"]
