"""A long proof in rounds: each is hidden, sealed, diagnosed and opened on its own.

So hours of work need not all be done before the first seal is opened, and what is finished counts: the page
tells of the rounds that are, and of how many there are to be.
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
        Where everything of it lies.
    plan : Plan
        Which rigs it has.
    seed : int or None
        Of what is hidden; None has the operating system draw one.
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
        How many rounds it has; the only one lies in the folder itself, several in folders below it.
    hidden, nulls : int
        Rigs of each round that hide something, and that do not.
    seed : int or None
        Of the whole proof; None has the operating system draw one for each round.
    before : int
        Rigs of earlier proofs, which these rounds are to be counted with.
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
    """What came of a check.

    Attributes
    ----------
    rigs : int
        Of all rounds that are finished; everything of them is what it was when it was sealed.
    unfinished : str
        The round that is not, and what it lacks, in a line; empty where there is none.
    """

    rigs: int
    unfinished: str = ""


def verify_all(out: Path) -> Checked:
    """Check every round of a proof that is finished from end to end.

    The last one may be unfinished: that is how a proof is left by Ctrl-C.

    Raises
    ------
    IrtError
        If none is finished, anything in one was altered, or something of a round is gone.
    """
    begun = max(_numbers(out), default=0)
    last = _place(out, begun) if begun else out
    # Where nothing was ever hidden there is nothing to go on with: it says which file is not there.
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
    """Yield the numbers of the rounds that were begun, of several."""
    for place in out.glob("round-*"):
        fits = re.fullmatch(r"round-([1-9]\d*)", place.name)
        if fits and place.is_dir():
            yield int(fits[1])


def _place(out: Path, number: int) -> Path:
    """Return the folder of one of several rounds."""
    return out / f"round-{number}"
