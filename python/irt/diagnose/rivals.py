"""Hypotheses that explain the recordings as well as the best one: honest ties, and why they are ties."""

from __future__ import annotations

import numpy as np

from irt.catalogue import effect
from irt.diagnose.case import Case, Fitted
from irt.diagnose.search import Search

#: Hypotheses closer than this are as good as each other [nats]: odds of about 150 to 1 would tell them apart.
TIE = 5.0
#: Hypotheses this near are refined before they are compared [nats].
NEAR = 60.0


def rivals(search: Search, best: Fitted) -> dict[str, list[Fitted]]:
    """Return for each effect of a hypothesis those that have another in its place and do as well."""
    found: dict[str, list[Fitted]] = {}
    for name in best.effects:
        rest = frozenset(best.effects) - {name}
        others = [
            one
            for names, one in list(search.fits.items())
            if len(names) == len(best.effects) and rest <= names and name not in names
        ]
        for other in others:
            if search.evidence().gain(best, other) < NEAR:
                search.keep(_refined(search.case, other))
        tied = [search.fits[frozenset(one.effects)] for one in others]
        found[name] = [one for one in tied if search.evidence().margin(best, one) < TIE]
    return found


def reason(case: Case, best: Fitted, other: Fitted, name: str, instead: str) -> str:
    """Say why two hypotheses cannot be told apart, with the size of what is between them."""
    between = np.concatenate([(a - b).ravel() for a, b in zip(best.residuals, other.residuals, strict=True)])
    size = float(np.sqrt(np.nanmean(between**2))) / case.noise
    if {effect(name).name, effect(instead).name} == {"delay", "latency"}:
        why = (
            "the marble is seen to move alike whether the command comes late or the picture does; only what "
            "is timed by itself would tell, as a lamp switched with a command"
        )
    else:
        why = "these commands do not excite what is different about them"
    alike = f"to {size:.1f} times the tracker's scatter"
    return f"{name} and {instead} predict these recordings alike, {alike}: {why}."


def _refined(case: Case, one: Fitted) -> Fitted:
    return case.fit(one.effects, points=one.values[None], rounds=2)
