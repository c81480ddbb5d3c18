"""The plan of a proof: numbers of rigs of each kind, and their secret order."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from irt.diagnosis.result import UNLISTED
from irt.errors import IrtError

#: Kinds that hide effects of the catalogue, with their numbers.
SIZES = {"single": 1, "pair": 2, "triple": 3}
SEVERAL = "several"
NULLS = ("none", "outliers")
#: Shares of the kinds among rigs with hidden physics, and among those without.
_HIDDEN = {"single": 0.5, "pair": 0.2, "triple": 0.1, "unlisted": 0.2}
_NOTHING = {"none": 0.9, "outliers": 0.1}
#: Rigs with and without hidden physics in the full proof.
FULL = (300, 300)
#: Worlds of a full proof, which take turns by the index of a rig; each gets a third of each kind.
WORLDS = 3


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
        """Return the kind of each rig, shuffled by the secret seed.

        The numbers of rigs of a kind in any two worlds differ by at most one.
        """
        kinds = [kind for kind, count in self.as_dict().items() for _ in range(count)]
        random = np.random.default_rng(_mixed(seed, "order"))
        # The i-th rig of the sorted kinds goes to one of the places of world i modulo WORLDS.
        order = [""] * len(kinds)
        for world in range(WORLDS):
            places = range(world, len(kinds), WORLDS)
            for place, rig in zip(places, random.permutation(np.array(places)), strict=True):
                order[place] = kinds[rig]
        return order

    def as_dict(self) -> dict[str, int]:
        """Return the plan as JSON content."""
        return asdict(self)


def group_of(label: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """Return the kind of a rig and its hidden physics; "several" for more effects than a plan knows."""
    kind = label["kind"]
    if isinstance(kind, list | tuple):
        names = tuple(str(one) for one in kind)
        return next((group for group, size in SIZES.items() if size == len(names)), SEVERAL), names
    if kind in NULLS:
        return str(kind), ()
    return (UNLISTED if str(kind).startswith(UNLISTED) else "single"), (str(kind),)


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
