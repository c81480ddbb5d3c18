"""`irt`: finds the verb, runs it, and turns the outcome into an exit status.

A verb is a module of this package with a ``NAME``, a ``HELP`` of one line, ``add_arguments(parser)``, which
also sets the parser's ``epilog`` to an example, and ``run(args)``. It imports what it works with inside
``run``: all verbs are loaded to answer ``irt --help``.
"""

from __future__ import annotations

import argparse
import keyword
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Any, Protocol, cast

from irt.errors import IrtError

#: One list for parser, help and tests; in the order in which a user meets them.
VERBS = (
    "demo",
    "drive",
    "simulate",
    "evaluate",
    "check",
    "pretrain",
    "tune",
    "diagnose",
    "suggest",
    "export",
    "prove",
    "reproduce",
    "import",
    "track",
)

DONE = 0
COULD_NOT = 1
WRONG_USAGE = 2  # argparse exits with it by itself
INTERRUPTED = 130  # what shells report of a program that Ctrl-C has ended


class Verb(Protocol):
    """What the module of a verb holds."""

    NAME: str
    HELP: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments, and an example in the epilog."""

    def run(self, args: argparse.Namespace) -> None:
        """Do it; raise `IrtError` where it cannot be done."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status; wrong usage raises `SystemExit` with its own."""
    words = sys.argv[1:] if argv is None else argv
    with_traceback = "--traceback" in words or os.environ.get("IRT_TRACEBACK", "0") not in {"", "0"}
    try:
        try:
            args = make_parser().parse_args(words)
            args.run(args)
        finally:
            sys.stdout.flush()
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


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all verbs."""
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "--traceback",
        action="store_true",
        default=argparse.SUPPRESS,
        help="show where in the program an error arose (IRT_TRACEBACK=1 does the same)",
    )
    parser = argparse.ArgumentParser(
        prog="irt",
        description="Tune a marble-labyrinth simulator to recordings, and find the physics it leaves out.",
        epilog="irt VERB --help tells more about a verb, with an example.",
        parents=[common],
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subparsers = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for name in VERBS:
        # A word of Python's own cannot be a module's name.
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


class _Version(argparse.Action):
    """Looks the version up when asked for it: that takes longer than all the rest of the help."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from importlib.metadata import version

        print(f"irt {version('labsim-irt')}")
        parser.exit()


def _explained(error: Exception) -> str:
    if isinstance(error, IrtError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        # What the files module did not meet on a path: a full disk behind standard output, say.
        _silence_stdout()
        return f"{error.filename or 'output'}: {error.strerror}"
    kind = f"unexpected {type(error).__name__}: {error}"
    return f"{kind} (a fault of irt; please report it with what --traceback shows)"


def _failed(message: str, status: int) -> int:
    print(f"irt: {' '.join(message.splitlines())}", file=sys.stderr)
    return status


def _silence_stdout() -> None:
    """Send what is left for standard output nowhere: the interpreter would complain when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
