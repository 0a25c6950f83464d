"""The safety gate, which every command passes before it is sent. Pure functions only; no I/O, no clock.

`judge` is a function of the limits, the gate's state, the newest set-point, the robot's state, and the time.
Its output is finite, inside the envelope, and within the acceleration and jerk limits; the one exception is a
stop, which is zero at once. A stop latches: only a new `GateState`, made by an explicit engage, allows motion
again. ``docs/safety.md`` lists every limit.
"""

from adatracker_deploy.runtime.gate.judge import judge
from adatracker_deploy.runtime.gate.monitor import unmonitored
from adatracker_deploy.runtime.gate.reasons import Kind, Reason
from adatracker_deploy.runtime.gate.state import GateState, Setpoint, Stage, Stop, Verdict

__all__ = ["GateState", "Kind", "Reason", "Setpoint", "Stage", "Stop", "Verdict", "judge", "unmonitored"]
