"""``python -m adatracker_deploy``: the same as the command ``adatracker-deploy``."""

import sys

from adatracker_deploy.cli import main

if __name__ == "__main__":
    sys.exit(main())
