"""The command-line interface: a thin module for each subcommand, without logic of its own.

A subcommand's module has `add_parser(subparsers)`, which sets its `run(args) -> exit status` as a default.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import NoReturn

from adatracker_deploy import __version__
from adatracker_deploy.core.errors import PlatformError, UsageError

STARTED_S = time.monotonic()
"""Start of this process, as near as Python code can tell."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def main(argv: list[str] | None = None) -> int:
    """Run the command; return 0 done, 1 stopped or failed, 2 a wrong request, 130 interrupted."""
    argv = sys.argv[1:] if argv is None else argv
    _hear_interrupts()
    named = bool(argv) and (not argv[0].startswith("-") or argv[0] in ("-h", "--help"))
    try:
        args = _parser(with_commands=named).parse_args(argv)
        if getattr(args, "fleet", None) is not None:
            from adatracker_deploy.cli import fleet

            args = fleet.parse(argv)
        status: int = args.run(args)
        sys.stdout.flush()  # a failed write is reported here, not by the interpreter's end
    except UsageError as error:
        print(f"adatracker-deploy: {error}", file=sys.stderr)
        return 2
    except PlatformError as error:
        print(f"adatracker-deploy: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("adatracker-deploy: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        _forget_stdout()  # the reader has closed the pipe
        return 1
    except OSError as error:
        return _told(error)
    return status


def _told(error: OSError) -> int:
    """Tell of a file that may not be used or an output that cannot be written; return the exit status.

    Raises:
        OSError: it is neither.
    """
    if isinstance(error, PermissionError):
        print(f"adatracker-deploy: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    if error.errno != errno.ENOSPC or error.filename is not None:  # a file's error would name it
        raise error
    _forget_stdout()
    print(f"adatracker-deploy: the output could not be written ({error.strerror})", file=sys.stderr)
    return 1


def _forget_stdout() -> None:
    """Throw away what is still to be written to stdout: the interpreter would try again at its end."""
    with contextlib.suppress(OSError, ValueError), Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _hear_interrupts() -> None:
    """Restore SIGINT if a shell made a background job ignore it: SIGINT stops robots."""
    if (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    ):
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _parser(*, with_commands: bool) -> argparse.ArgumentParser:
    """Return the parser; without commands a misspelt option is not taken for one of them."""
    from adatracker_deploy.cli import (
        ablate,
        collect,
        compare,
        completion,
        doctor,
        evaluate,
        export,
        export_onnx,
        faults,
        film,
        filmstrip,
        layout,
        lists,
        mark,
        push,
        replay,
        report,
        run,
        salvage,
        score,
        serve,
        stop,
        train,
        trials,
        view,
    )

    parser = _Parser(
        prog="adatracker-deploy",
        description="Run a person-following policy on a robot, or rehearse it in software-in-the-loop.",
        epilog="To run a robot, give --platform and no command: adatracker-deploy --platform drone --sitl",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    run.add_arguments(parser)
    if not with_commands:
        return parser
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", parser_class=_Parser)
    order = (
        doctor,
        faults,
        stop,
        view,
        trials,
        mark,
        score,
        compare,
        report,
        film,
        filmstrip,
        replay,
        salvage,
        evaluate,
        export,
        export_onnx,
        push,
        serve,
        collect,
        train,
        ablate,
        lists,
        layout,
        completion,
    )
    for module in order:
        module.add_parser(commands)
    return parser
