"""Hypotheses that explain the recordings as well as the best one: honest ties, and why they are ties."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect, hypothetical
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.search import Search

Array = NDArray[np.float64]

#: Hypotheses closer than this are as good as each other [nats]: odds of about 150 to 1 would tell them apart.
TIE = 5.0
#: With the same numbers in the same places two effects are one by another name if most predictions differ by
#: less than this share of the tracker's noise: where in an update a command falls is no physics.
SAME = 0.1
#: Hypotheses this near are refined before they are compared [nats].
NEAR = 60.0


def rivals(search: Search, best: Fitted, asked: Sequence[str]) -> dict[str, list[Fitted]]:
    """Return for some effects of a hypothesis those that have another in its place and do as well."""
    found: dict[str, list[Fitted]] = {}
    for name in asked:
        same: set[tuple[str, ...]] = set()
        for other in _namesakes(name, best):
            names = tuple(other if one == name else one for one in best.effects)
            (renamed,) = search.case.judge(names, best.values[None])
            if np.nanmedian(np.abs(_between(renamed, best))) < SAME * search.case.noise:
                search.keep(renamed)
                same.add(search.fits[frozenset(names)].effects)
        for one in _instead(search, best, name):
            if search.evidence().gain(best, one) < NEAR:
                search.fit(one.effects, one.values[None], rounds=2)
        tied = _instead(search, best, name)
        found[name] = [
            one for one in tied if one.effects in same or search.evidence().margin(best, one) < TIE
        ]
    return found


def _instead(search: Search, best: Fitted, name: str) -> list[Fitted]:
    """Return the hypotheses that have another effect of the catalogue in the place of one."""
    rest = frozenset(best.effects) - {name}
    return [
        one
        for names, one in search.fits.items()
        if len(names) == len(best.effects) and rest <= names and not names & {name, UNLISTED}
    ]


def _between(one: Fitted, other: Fitted) -> Array:
    """Return by how much two hypotheses' predictions differ, all coordinates in a row [board edges]."""
    pairs = zip(one.residuals, other.residuals, strict=True)
    return np.concatenate([(a - b).ravel() for a, b in pairs])


def _namesakes(name: str, best: Fitted) -> list[str]:
    """Return effects whose parameters have the same units, one by one."""
    units = [parameter.unit for parameter in effect(name).required]
    return [
        info.name
        for info in hypothetical()
        if info.name not in best.effects and [parameter.unit for parameter in info.required] == units
    ]


def reason(case: Case, best: Fitted, other: Fitted, name: str, instead: str) -> str:
    """Say why two hypotheses cannot be told apart, with the size of what is between them."""
    size = float(np.sqrt(np.nanmean(_between(best, other) ** 2))) / case.noise
    if {effect(name).name, effect(instead).name} == {"delay", "latency"}:
        why = (
            "the marble is seen to move alike whether the command comes late or the picture does; only what "
            "is timed by itself would tell, as a lamp switched with a command"
        )
    else:
        why = "these commands do not excite what is different about them"
    alike = f"to {size:.1f} times the tracker's scatter"
    return f"{name} and {instead} predict these recordings alike, {alike}: {why}."
