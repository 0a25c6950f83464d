"""A tracker that logs as fast as the writer takes it and tells what it handed over, until it is killed."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.trial.records import a_frame, a_log, a_step, an_observation

log = a_log(Path(sys.argv[1]))
print(log.folder, log.writer_pid, flush=True)
step = 0
while True:
    dropped = log.dropped
    log.step(a_step(step), a_frame(step), an_observation(step))
    if log.dropped == dropped:
        print(step, flush=True)
        step += 1
