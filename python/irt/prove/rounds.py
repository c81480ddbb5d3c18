"""A long proof in rounds: each is hidden, sealed, diagnosed and opened on its own.

So hours of work need not all be done before the first seal is opened, and what is finished counts: the page
tells of the rounds that are, and of how many there are to be.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from irt.prove.chain import Places, verify
from irt.prove.plan import Plan, seed_of_round


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
    """

    out: Path
    count: int
    hidden: int
    nulls: int
    seed: int | None = None

    def __iter__(self) -> Iterator[Round]:
        for number in range(self.count):
            place = self.out if self.count == 1 else self.out / f"round-{number + 1}"
            seed = None if self.seed is None else seed_of_round(self.seed, number)
            yield Round(Places(place), Plan.of(self.hidden, self.nulls, number), seed)


def verify_all(out: Path) -> int:
    """Check every round of a proof that was begun from end to end, and return how many rigs they have.

    Raises
    ------
    IrtError
        If one is not finished, or anything in it was altered.
    """
    rounds = sorted(out.glob("round-*"), key=lambda place: int(place.name.removeprefix("round-")))
    return sum(verify(place) for place in rounds or [out])
