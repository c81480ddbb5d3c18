"""The one exception root, and how its messages are made."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

#: Of more names that are possible only the first so many are listed: the catalogue's effects all are.
MOST_LISTED = 40


class IrtError(ValueError):
    """A file, a value or a name is not as it must be.

    ``str(error)`` is one line for a user: where (file, line, column), what was expected, what came, and what
    to do.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


@contextmanager
def located(where: str) -> Iterator[None]:
    """Put ``where`` (a file, a section of one) before the message of any `IrtError` raised inside.

    A message that begins with it, or with a place inside it, stays as it is.
    """
    try:
        yield
    except IrtError as error:
        if str(error).startswith(tuple(f"{where}{mark}" for mark in ":,/")):
            raise
        raise IrtError(f"{where}: {error}") from error


def unknown_name(kind: str, name: str, possible: Iterable[str]) -> IrtError:
    """Return the error for a name that is none of ``possible``, with the nearest one as a suggestion.

    Parameters
    ----------
    kind : str
        What the name stands for, such as ``"effect"``.
    name : str
        What was found.
    possible : iterable of str
        What could have stood there, in the order to be listed.
    """
    names = list(possible)
    near = difflib.get_close_matches(name, names, n=1)
    hint = f'; did you mean "{near[0]}"?' if near else ";"
    listed = ", ".join(names[:MOST_LISTED]) if names else "none"
    more = f", and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return IrtError(f'unknown {kind} "{name}"{hint} possible: {listed}{more}')
