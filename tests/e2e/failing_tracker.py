"""The command, with a policy whose 100th answer is an error that nobody expected."""

from __future__ import annotations

import sys

from adatracker_deploy.cli import main
from adatracker_deploy.policy.pid import PidPolicy

ANSWERS = 100


class FailingPolicy(PidPolicy):
    """The baseline, until it fails."""

    answered = 0

    def act(self, observation):
        self.answered += 1
        if self.answered > ANSWERS:
            print("failing", flush=True)
            raise ZeroDivisionError("the network has no weights")
        return super().act(observation)


if __name__ == "__main__":
    import adatracker_deploy.policy.pid as module

    module.PidPolicy = FailingPolicy
    sys.exit(main([*sys.argv[1:], "--policy", "pid"]))
