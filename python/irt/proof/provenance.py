"""Provenance of the rounds of a proof: seed, concealed world, and version and digest of the code."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from irt.files import make_folder, read_json, write_atomic
from irt.proof.hash_chain import Places

#: Files of the package's digest: its modules and the engine.
_CODE = ("*.py", "*.so", "*.pyd")
_DIGITS = 12
#: File in the folder of a round.
_NOTES = "made.json"


@dataclass(frozen=True)
class Made:
    """Provenance of a round, as text.

    Attributes
    ----------
    rigs : int
        Number of rigs.
    seed : str
        Seed of the hidden physics.
    world, code : str
        Versions of the concealed world, and of the package that diagnosed the rigs.
    """

    rigs: int
    seed: str
    world: str
    code: str

    @classmethod
    def of(cls, places: Places, rigs: int) -> Made:
        """Return the provenance of a finished round with this number of rigs.

        If several versions of the code worked on it, all of them are listed.

        Raises
        ------
        IrtError
            If its keys or its notes are missing.
        """
        notes, keys = read_json(places.out / _NOTES), read_json(places.keys)
        return cls(rigs, f"{keys['seed']}", *(", then ".join(notes[name]) for name in ("world", "code")))


def note(places: Places, world: str) -> None:
    """Record, in a round's folder, the version that works on it.

    Raises
    ------
    IrtError
        If the file cannot be read or written.
    """
    path = make_folder(places.out) / _NOTES
    notes: dict[str, list[str]] = read_json(path) if path.exists() else {"world": [], "code": []}
    for name, now in (("world", world), ("code", f"{this_code()}, one thread each")):
        if now not in notes[name]:
            notes[name].append(now)
    write_atomic(path, json.dumps(notes, indent=1) + "\n")


@functools.cache
def this_code() -> str:
    """Return version and digest of the running package."""
    root = Path(__file__).parents[1]
    total = hashlib.sha256()
    for path in sorted(path for kind in _CODE for path in root.rglob(kind)):
        total.update(f"{path.relative_to(root).as_posix()}\0".encode())
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return f"irt {version('labsim-irt')}, code {total.hexdigest()[:_DIGITS]}"
