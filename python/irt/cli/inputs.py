"""What several verbs read."""

from __future__ import annotations

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
