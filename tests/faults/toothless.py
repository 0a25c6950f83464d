"""The toolkit's command with one injector that does nothing: ``toothless.py FAULT ARGUMENTS...``."""

from __future__ import annotations

import sys

from adatracker_deploy.cli import main
from adatracker_deploy.faults import injection

if __name__ == "__main__":
    name, *arguments = sys.argv[1:]
    assert name in injection.STRIKES
    injection.STRIKES[name] = lambda *_: None
    sys.exit(main(arguments))
