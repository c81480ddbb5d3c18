"""Published files of a proof beside its page: commitments, manifest and keys of each round."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from irt.errors import IrtError
from irt.files import write_atomic
from irt.proof.hash_chain import Places

#: The copied files of a round, and a key of each, which identifies it.
HOLDS = {
    "commitments": {"commitments", "recordings"},
    "manifest": {"commitments", "answers"},
    "keys": {"manifest", "keys", "seed"},
}
#: Present and former names of such files; without a number, as in a proof's own folder.
_NAME = re.compile(rf"({'|'.join(HOLDS)})(-\d+)?\.json")


def published(folder: Path, rounds: Sequence[Places], earlier: int = 0) -> Iterator[tuple[str, Path]]:
    """Yield the files of each round with their names in the folder beside the page.

    A single round has a number as well, so that further rounds change no name. The first numbers belong to
    earlier proofs, whose files are in the folder already.
    """
    for number in range(1, earlier + 1):
        for name in HOLDS:
            yield f"{name}-{number}.json", folder / f"{name}-{number}.json"
    for number, path in _files(rounds):
        yield f"{path.stem}-{earlier + number}{path.suffix}", path


def named(rounds: Sequence[Places]) -> Iterator[tuple[str, Path]]:
    """Yield the same files with descriptive labels, for pages without copies."""
    for number, path in _files(rounds):
        yield f"`{path.name}`" + (f", round {number}" if len(rounds) > 1 else ""), path


def publish(folder: Path, rounds: Sequence[Places], earlier: int = 0) -> set[str]:
    """Copy the files of all rounds into a folder, and return their names there.

    Raises
    ------
    IrtError
        If one cannot be written, or a file of an earlier round is missing.
    """
    names = set()
    for name, path in published(folder, rounds, earlier):
        if not path.exists():
            raise IrtError(f"{path}: is not there, and belongs to a round that the page counts")
        if path != folder / name:
            write_atomic(folder / name, path.read_bytes())
        names.add(name)
    return names


def withdraw(folder: Path, stay: Collection[str]) -> None:
    """Remove files of an earlier page from the folder: those of other rounds or with other names.

    Raises
    ------
    IrtError
        If one cannot be removed.
    """
    for path in sorted(folder.iterdir()):
        if path.name not in stay and _is_copy(path):
            try:
                path.unlink()
            except OSError as error:
                raise IrtError(f"{path}: cannot be removed: {error.strerror}") from error


def _is_copy(path: Path) -> bool:
    """Return whether a file is a published one, by its name and its content."""
    fits = _NAME.fullmatch(path.name)
    # A folder with seals is the proof itself, which a page of the same name shares.
    if fits is None or not path.is_file() or (fits[2] is None and (path.parent / "seals").exists()):
        return False
    with suppress(OSError, ValueError):
        content = json.loads(path.read_bytes())
        return isinstance(content, dict) and set(content) == HOLDS[fits[1]]
    return False


def _files(rounds: Sequence[Places]) -> Iterator[tuple[int, Path]]:
    """Yield the number of each round with each of its files."""
    for number, places in enumerate(rounds, start=1):
        for name in HOLDS:
            path: Path = getattr(places, name)
            yield number, path
