"""Work for a process pool that kills its process, as the kernel does when memory runs out."""

from __future__ import annotations

import os
import signal


def die(episode):
    os.kill(os.getpid(), signal.SIGKILL)
