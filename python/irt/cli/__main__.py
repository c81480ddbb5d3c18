"""Entry point of `irt`: parse the command line, run the verb, return an exit status.

Each verb is a module of this package. It defines ``NAME``, a one-line ``HELP``, ``add_arguments(parser)`` and
``run(args)``; ``add_arguments`` also sets the parser's ``epilog`` to an example. Heavy imports belong inside
``run``, because ``irt --help`` loads every verb.
"""

from __future__ import annotations

import argparse
import difflib
import keyword
import os
import re
import signal
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from types import FrameType, TracebackType
from typing import Any, NoReturn, Protocol, cast

from irt.errors import IrtError

#: Verbs for the parser, the help and the tests, in the order in which a user needs them.
VERBS = (
    "demo",
    "drive",
    "track",
    "import",
    "check",
    "tune",
    "evaluate",
    "diagnose",
    "suggest",
    "simulate",
    "export",
    "pretrain",
    "prove",
    "reproduce",
)

DONE = 0
COULD_NOT = 1
WRONG_USAGE = 2  # set by argparse itself
INTERRUPTED = 130  # the shell's status of a program ended by Ctrl-C
TERMINATED = 143  # and by SIGTERM


class Verb(Protocol):
    """Interface of a verb's module."""

    NAME: str
    HELP: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments and set the epilog to an example."""

    def run(self, args: argparse.Namespace) -> None:
        """Run the verb; raise `IrtError` on failure."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status; wrong usage raises `SystemExit` with status 2."""
    words = sys.argv[1:] if argv is None else argv
    if argv is None:
        # What Ctrl-C cleans up, another process's SIGTERM is to clean up too.
        signal.signal(signal.SIGTERM, _terminated)
    with_traceback = "--traceback" in words or _wants_traceback()
    try:
        try:
            if not words:
                make_parser().print_help(sys.stderr)
                return WRONG_USAGE
            args = make_parser().parse_args(words)
            args.run(args)
        finally:
            sys.stdout.flush()
    except _Terminated:
        return _failed("terminated", TERMINATED)
    except KeyboardInterrupt:
        return _failed("stopped", INTERRUPTED)
    except BrokenPipeError:
        _silence_stdout()
        return DONE
    except Exception as error:
        if with_traceback:
            traceback.print_exc()
        return _failed(_explained(error), COULD_NOT)
    return DONE


def report_errors(program: str) -> None:
    """Let errors of a script, such as those of `examples/`, end in one line as those of `irt` do.

    Errors that are not ours keep their traceback: the script may be the user's own.
    """

    def report(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if isinstance(error, KeyboardInterrupt):
            _failed("stopped", INTERRUPTED, program)
        elif isinstance(error, IrtError | OSError) and not _wants_traceback():
            _failed(_explained(error), COULD_NOT, program)
        else:
            sys.__excepthook__(kind, error, trace)

    sys.excepthook = report


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all verbs."""
    common = _Parser(add_help=False)
    common.add_argument(
        "--traceback",
        action="store_true",
        default=argparse.SUPPRESS,
        help="show the Python traceback of an error (IRT_TRACEBACK=1 does the same)",
    )
    parser = _Parser(
        prog="irt",
        description="Tune a marble-labyrinth simulator to recordings, and find the physics it leaves out.",
        epilog="irt VERB --help describes a verb and shows an example.",
        parents=[common],
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subparsers = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for name in VERBS:
        # A Python keyword cannot be a module name.
        module = f"{name}_" if keyword.iskeyword(name) else name
        verb = cast("Verb", import_module(f"irt.cli.{module}"))
        subparser = subparsers.add_parser(
            verb.NAME,
            help=verb.HELP,
            description=f"{verb.HELP[:1].upper()}{verb.HELP[1:]}.",
            parents=[common],
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        verb.add_arguments(subparser)
        subparser.set_defaults(run=verb.run)
    return parser


class _Parser(argparse.ArgumentParser):
    """A parser whose errors suggest the nearest verb, option or choice.

    A verb refuses options that it does not know itself: argparse leaves that to the parser above, whose usage
    does not show them.
    """

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            options = [name for action in self._actions for name in action.option_strings]
            self.error(f"unrecognized arguments: {' '.join(unknown)}{_nearest(unknown[0], options)}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        if wrong := re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)$", message):
            message += _nearest(wrong[1], re.findall(r"[^\s,']+", wrong[2]))
        super().error(message)


def _nearest(word: str, possible: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, possible, n=1)
    return f"; did you mean {near[0]}?" if near else ""


class _Version(argparse.Action):
    """Print the version. The lookup runs on demand, because it is slower than the rest of the help."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from importlib.metadata import version

        print(f"irt {version('labsim-irt')}")
        parser.exit()


class _Terminated(KeyboardInterrupt):
    """SIGTERM came."""


def _terminated(_signal: int, _frame: FrameType | None) -> None:
    # A second signal, during the clean-up, ends the process at once.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    raise _Terminated


def _wants_traceback() -> bool:
    return os.environ.get("IRT_TRACEBACK", "0") not in {"", "0"}


def _explained(error: Exception) -> str:
    if isinstance(error, IrtError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        # An I/O error outside `irt.files`, such as a full disk behind standard output.
        _silence_stdout()
        return f"{error.filename or 'output'}: {error.strerror}"
    kind = f"unexpected {type(error).__name__}: {error}"
    return f"{kind} (a fault of irt; please report it with the output of --traceback)"


def _failed(message: str, status: int, program: str = "irt") -> int:
    print(f"{program}: {' '.join(message.splitlines())}", file=sys.stderr)
    return status


def _silence_stdout() -> None:
    """Redirect standard output to the null device, so that the interpreter's final flush cannot fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
