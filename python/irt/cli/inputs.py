"""What several verbs read."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irt.model import Model


def read_model(path: Path) -> Model:
    """Read a model whose effects this engine knows.

    Raises
    ------
    IrtError
        If the file is no such model.
    """
    from irt.model import load_model
    from irt.rollouts import effects

    return load_model(path, {effect["name"]: tuple(effect["parameters"]) for effect in effects()})


def whole(least: int) -> Callable[[str], int]:
    """Return the reader of a whole number that must not be below another."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected a whole number from {least} on, found {text}")
        return int(text)

    return read
