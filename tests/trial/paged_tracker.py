"""A tracker whose trial has a page: it logs ticks until it is stopped, and says what it is told.

The second argument says whether it answers a stop; without an answer it is to be killed.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

from adatracker_deploy.page.address import Address, free_port
from adatracker_deploy.runtime.operator_stop import StopRequest
from adatracker_deploy.runtime.running import Announcement
from adatracker_deploy.trial.ipc import PageStart
from tests.trial.records import START_NS, a_frame, a_log, a_step, an_observation

announcement = Announcement("wheeled")
stop = StopRequest(announcement.stopping)
address = Address(free_port(0, "the page", "--page"))
page = PageStart(address, {"title": "wheeled", "stop": True}, os.getpid())
log = a_log(Path(sys.argv[1]), page=page)
print(address.port, address.token, log.folder, flush=True)
with stop.listening():
    if sys.argv[2] == "deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        for look in range(20):  # as before the first tick
            log.look(a_frame(look), an_observation(look), START_NS)
            time.sleep(0.02)
        for number in range(20, 1 << 20):
            log.step(a_step(number), a_frame(number), an_observation(number))
            for click in log.clicks():
                print(*click, flush=True)
                log.event("warning", f"click {click.number}", START_NS)
            time.sleep(0.02)
    except KeyboardInterrupt:
        print("stopped", flush=True)
log.close({"outcome": "interrupted"})
announcement.close()
