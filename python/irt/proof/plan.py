"""The plan of a proof: numbers of rigs of each kind, and their secret order."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from irt.errors import IrtError

#: Kinds of rigs; the first two have no hidden physics.
KINDS = ("none", "outliers", "single", "pair", "triple", "unlisted")
#: Kinds that hide effects of the catalogue, with their numbers.
SIZES = {"single": 1, "pair": 2, "triple": 3}
NULLS = ("none", "outliers")
#: Shares of the kinds among rigs with hidden physics, and among those without.
_HIDDEN = {"single": 0.5, "pair": 0.2, "triple": 0.1, "unlisted": 0.2}
_NOTHING = {"none": 0.9, "outliers": 0.1}


@dataclass(frozen=True)
class Plan:
    """Numbers of rigs of each kind.

    Attributes
    ----------
    none, outliers : int
        Rigs without hidden physics, the latter with outliers of the tracker.
    single, pair, triple, unlisted : int
        Rigs that hide one effect, two or three effects, or physics outside the catalogue.
    """

    none: int = 0
    outliers: int = 0
    single: int = 0
    pair: int = 0
    triple: int = 0
    unlisted: int = 0

    @classmethod
    def of(cls, hidden: int, nulls: int) -> Plan:
        """Return the plan for numbers of rigs with and without hidden physics.

        Raises
        ------
        IrtError
            If it has no rigs.
        """
        if hidden + nulls < 1:
            raise IrtError("a proof needs at least one rig")
        return cls(**_shared(hidden, _HIDDEN), **_shared(nulls, _NOTHING))

    @property
    def rigs(self) -> int:
        """The number of rigs."""
        return sum(self.as_dict().values())

    def names(self) -> list[str]:
        """Return the names of all rigs, which are plain numbers."""
        return [f"rig-{number:04d}" for number in range(1, self.rigs + 1)]

    def order(self, seed: int) -> list[str]:
        """Return the kind of each rig, shuffled by the secret seed."""
        kinds = [kind for kind in KINDS for _ in range(getattr(self, kind))]
        places = np.random.default_rng(_mixed(seed, "order")).permutation(len(kinds))
        return [kinds[place] for place in places]

    def as_dict(self) -> dict[str, int]:
        """Return the plan as JSON content."""
        return asdict(self)


def is_of_kind(hidden: Any, kind: str) -> bool:
    """Return whether the ``kind`` of a label, an effect or several or a word, is of a kind of rigs."""
    if kind in SIZES:
        return (1 if isinstance(hidden, str) else len(hidden)) == SIZES[kind]
    return str(hidden).startswith(kind)


def seed_of(seed: int, index: int) -> int:
    """Return the seed of one rig, below 2^63; it reveals nothing about the other seeds."""
    return _mixed(seed, f"rig {index}")


def _mixed(seed: int, purpose: str) -> int:
    return int.from_bytes(hashlib.sha256(f"{seed} {purpose}".encode()).digest()[:8], "big") >> 1


def _shared(count: int, shares: dict[str, float]) -> dict[str, int]:
    """Split a count by shares with the largest remainders; ties go to the first kinds."""
    exact = {kind: share * count for kind, share in shares.items()}
    split = {kind: int(value) for kind, value in exact.items()}
    order = sorted(exact, key=lambda kind: split[kind] - exact[kind])
    for kind in order[: count - sum(split.values())]:
        split[kind] += 1
    return split
