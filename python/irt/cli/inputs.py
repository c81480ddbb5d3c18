"""What several verbs read."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irt.rig import Rig


def whole(least: int) -> Callable[[str], int]:
    """Return the reader of a whole number that must not be below another."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected a whole number from {least} on, found {text}")
        return int(text)

    return read


def checked(rig: Rig, threads: int | None = None) -> tuple[str, ...]:
    """Check the recordings before a fit, print what would make it wrong, and return that.

    Raises
    ------
    IrtError
        If the recordings can identify nothing.
    """
    from irt.checking import check

    found = check(rig, threads=threads)
    found.require()
    for warning in found.warnings:
        print(f"warning: {warning}", flush=True)
    return found.warnings
