"""How the rounds of a proof came about: what a page says of each, and what tells one code from another."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from irt.files import make_folder, write_atomic
from irt.proof.hash_chain import Places, read_json

#: What the package runs: its modules, and the engine.
_CODE = ("*.py", "*.so", "*.pyd")
_DIGITS = 12
#: In the folder of a round.
_NOTES = "made.json"


@dataclass(frozen=True)
class Made:
    """How a round was made, in words.

    Attributes
    ----------
    rigs : int
        How many it has.
    seed : str
        Of what was hidden.
    world, code : str
        What recorded the rigs, and what diagnosed them.
    """

    rigs: int
    seed: str
    world: str
    code: str

    @classmethod
    def of(cls, places: Places, rigs: int) -> Made:
        """Return how a finished round of so many rigs was made.

        What one code began and another went on with was made by both.

        Raises
        ------
        IrtError
            If its keys or its notes are missing.
        """
        told, keys = read_json(places.out / _NOTES), read_json(places.keys)
        return cls(rigs, f"{keys['seed']}", *(", then ".join(told[name]) for name in ("world", "code")))


def note(places: Places, world: str) -> None:
    """Write down, in a round's folder, what works on it now.

    Raises
    ------
    IrtError
        If the file cannot be read or written.
    """
    path = make_folder(places.out) / _NOTES
    told: dict[str, list[str]] = read_json(path) if path.exists() else {"world": [], "code": []}
    for name, now in (("world", world), ("code", f"{this_code()}, one thread each")):
        if now not in told[name]:
            told[name].append(now)
    write_atomic(path, json.dumps(told, indent=1) + "\n")


@functools.cache
def this_code() -> str:
    """Return version and digest of the package that runs: another digest is other code."""
    root = Path(__file__).parents[1]
    told = hashlib.sha256()
    for path in sorted(path for kind in _CODE for path in root.rglob(kind)):
        told.update(f"{path.relative_to(root).as_posix()}\0".encode())
        told.update(hashlib.sha256(path.read_bytes()).digest())
    return f"irt {version('labsim-irt')}, code {told.hexdigest()[:_DIGITS]}"
