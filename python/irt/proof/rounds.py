"""Rounds of a long proof: each is concealed, sealed, diagnosed and opened independently.

Finished rounds count before the whole proof is done. The page reports the finished rounds and their planned
number.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from irt.errors import IrtError
from irt.proof.hash_chain import Places, unfinished, verify
from irt.proof.plan import Plan, seed_of_round


@dataclass(frozen=True)
class Round:
    """One of the rounds of a proof.

    Attributes
    ----------
    places : Places
        Its paths.
    plan : Plan
        Its rigs.
    seed : int or None
        Seed of the hidden physics; None for one from the operating system.
    """

    places: Places
    plan: Plan
    seed: int | None


@dataclass(frozen=True)
class Rounds:
    """The rounds of a proof.

    Attributes
    ----------
    out : Path
        The folder of the proof.
    count : int
        Number of rounds; a single one is in the folder itself, several are in subfolders.
    hidden, nulls : int
        Numbers of rigs with and without hidden physics in each round.
    seed : int or None
        Seed of the whole proof; None for one per round from the operating system.
    before : int
        Number of rigs of earlier proofs that are counted together with these rounds.
    """

    out: Path
    count: int
    hidden: int
    nulls: int
    seed: int | None = None
    before: int = 0

    def __iter__(self) -> Iterator[Round]:
        for number in range(self.count):
            place = self.out if self.count == 1 else _place(self.out, number + 1)
            seed = None if self.seed is None else seed_of_round(self.seed, number)
            first = self.before + number * (self.hidden + self.nulls)
            yield Round(Places(place), Plan.of(self.hidden, self.nulls, first), seed)


@dataclass(frozen=True)
class Checked:
    """Result of a check.

    Attributes
    ----------
    rigs : int
        Number of rigs in all finished rounds, which are unaltered.
    unfinished : str
        One line about the unfinished round; empty if there is none.
    """

    rigs: int
    unfinished: str = ""


def verify_all(out: Path) -> Checked:
    """Check all finished rounds of a proof from end to end.

    The last round may be unfinished, as after Ctrl-C.

    Raises
    ------
    IrtError
        If no round is finished, or a file of one was altered or removed.
    """
    begun = max(_numbers(out), default=0)
    last = _place(out, begun) if begun else out
    # In a folder without a proof the check fails with the name of the missing file.
    lacks = unfinished(Places(last)) if begun or (out / "seals").is_dir() else ""
    line = f"{last}: not finished, and not checked: {lacks}; the same command goes on" if lacks else ""
    if lacks and begun < 2:
        raise IrtError(line)
    before = []
    for number in range(1, begun):
        before.append(place := _place(out, number))
        if gone := unfinished(Places(place)) if place.is_dir() else "is not there":
            raise IrtError(f"{place}: {gone}, though a later round began: something was taken away")
    return Checked(sum(map(verify, before if lacks else [*before, last])), line)


def _numbers(out: Path) -> Iterator[int]:
    """Yield the numbers of the started rounds, of several."""
    for place in out.glob("round-*"):
        fits = re.fullmatch(r"round-([1-9]\d*)", place.name)
        if fits and place.is_dir():
            yield int(fits[1])


def _place(out: Path, number: int) -> Path:
    """Return the folder of one of several rounds."""
    return out / f"round-{number}"
