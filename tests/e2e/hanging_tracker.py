"""The command, with a policy whose 100th answer never comes: a tracker whose Python thread hangs."""

from __future__ import annotations

import sys
import threading

from adatracker_deploy.cli import main
from adatracker_deploy.policy.pid import PidPolicy

ANSWERS = 100


class HangingPolicy(PidPolicy):
    """The baseline, until it hangs."""

    answered = 0

    def act(self, observation):
        self.answered += 1
        if self.answered > ANSWERS:
            print("hung", flush=True)
            threading.Event().wait()
        return super().act(observation)


if __name__ == "__main__":
    import adatracker_deploy.policy.pid as module

    module.PidPolicy = HangingPolicy
    sys.exit(main([*sys.argv[1:], "--policy", "pid"]))
