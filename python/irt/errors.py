"""The exception class of the package, and helpers for its messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

#: Most names listed in a message; enough for all effects of the catalogue.
MOST_LISTED = 40


class IrtError(ValueError):
    """An invalid file, value or name.

    ``str(error)`` is one line for the user: location (file, line, column), expected and actual value, and
    remedy.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


@contextmanager
def located(where: str) -> Iterator[None]:
    """Prefix the message of any `IrtError` raised in the block with ``where``, a file or a section of one.

    Messages that start with it already are unchanged.
    """
    try:
        yield
    except IrtError as error:
        if str(error).startswith(tuple(f"{where}{mark}" for mark in ":,/")):
            raise
        raise IrtError(f"{where}: {error}") from error


def unknown_name(kind: str, name: str, possible: Iterable[str]) -> IrtError:
    """Return the error for an unknown name, with the nearest possible name as a suggestion.

    Parameters
    ----------
    kind : str
        Kind of the name, such as ``"effect"``.
    name : str
        The unknown name.
    possible : iterable of str
        The possible names, in the order to be listed.
    """
    names = list(possible)
    near = difflib.get_close_matches(name, names, n=1)
    hint = f'; did you mean "{near[0]}"?' if near else ";"
    listed = ", ".join(names[:MOST_LISTED]) if names else "none"
    more = f", and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return IrtError(f'unknown {kind} "{name}"{hint} possible: {listed}{more}')
