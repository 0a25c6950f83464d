"""Run a command beside a real ``vcan0``: ``python -m tests.wheeled.uml COMMAND [ARGUMENT]...``."""

from __future__ import annotations

import sys

from tests.wheeled.uml.choice import NoRoomError, find_room

LIMIT_S = 600.0


def main(command: list[str]) -> int:
    """Print what the command printed, once it has ended; return its exit status."""
    try:
        ended = find_room()(command, limit_s=LIMIT_S)
    except NoRoomError as error:
        print(error, file=sys.stderr)
        return 2
    sys.stdout.write(ended.output)
    return ended.status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
