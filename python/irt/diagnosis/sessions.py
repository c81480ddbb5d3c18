"""Values that differ between the sessions of one rig.

The fits without each recording in turn say what each recording pulls a value towards: its jackknife
pseudo-value (Tukey, 1958, "Bias and confidence in not-quite large samples"), k times the value of all k
recordings less k - 1 times that without it. Sessions differ in a value if the pseudo-values of their
recordings do, by more than those of one session scatter: one-way analysis of variance, at a probability that
counts all values that were compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from irt.sessions import session_of

Array = NDArray[np.float64]

#: Recordings that each session needs for its own scatter.
FEWEST = 3
#: The largest corrected probability at which a value counts as different.
CLEAR = 0.01


@dataclass(frozen=True)
class Difference:
    """A value that differs between sessions.

    Attributes
    ----------
    parameter : str
        One of the five, or ``effect.parameter``.
    values : dict
        What each session's recordings say it is, by session.
    p_value : float
        Of so large a difference where there is none, corrected for the number of values compared.
    """

    parameter: str
    values: dict[str, float]
    p_value: float


def differences(
    recordings: Sequence[str], values: Mapping[str, float], without: Mapping[str, Array]
) -> list[Difference]:
    """Return the values that differ between sessions, the clearest first.

    Parameters
    ----------
    recordings : sequence of k str
        Names of the recordings; their sessions stand before a slash.
    values : mapping
        Values by name, of a fit to all recordings.
    without : mapping
        For each name the (k,) values of fits without each recording.
    """
    sessions = np.array([session_of(name) for name in recordings])
    names = list(dict.fromkeys(sessions.tolist()))
    if not is_enough(recordings):
        return []
    compared = {name: own for name, own in without.items() if np.ptp(own) > 0.0}
    found = []
    for name, own in compared.items():
        pseudo = len(own) * values[name] - (len(own) - 1) * own
        groups = {session: pseudo[sessions == session] for session in names}
        p_value = min(1.0, len(compared) * _p_value(list(groups.values())))
        if p_value <= CLEAR:
            found.append(Difference(name, {key: float(one.mean()) for key, one in groups.items()}, p_value))
    return sorted(found, key=lambda one: one.p_value)


def is_enough(recordings: Sequence[str]) -> bool:
    """Whether there are several sessions, each with enough recordings to be compared."""
    sessions = [session_of(name) for name in recordings]
    return len(set(sessions)) > 1 and min(sessions.count(one) for one in sessions) >= FEWEST


def _p_value(groups: Sequence[Array]) -> float:
    """Return the probability of means so far apart, by one-way analysis of variance."""
    everything = np.concatenate(groups)
    between = sum(len(one) * (one.mean() - everything.mean()) ** 2 for one in groups)
    within = sum(float(((one - one.mean()) ** 2).sum()) for one in groups)
    freedom = len(groups) - 1, len(everything) - len(groups)
    ratio = (between / freedom[0]) / max(within / freedom[1], 1e-300)
    return float(fdtrc(*freedom, ratio))


def sentences(recordings: Sequence[str], found: Sequence[Difference]) -> Iterator[str]:
    """Say what differs between sessions; nothing where there is one session alone."""
    names = list(dict.fromkeys(session_of(name) for name in recordings))
    if len(names) < 2:
        return
    if not is_enough(recordings):
        yield f"Sessions with fewer than {FEWEST} recordings cannot be compared: record more in each."
        return
    if not found:
        yield f"No value differs between {' and '.join(names)} by more than their recordings scatter."
    for one in found:
        shown = ", ".join(f"{value:.4g} in {session}" for session, value in one.values.items())
        yield (
            f"Between sessions {one.parameter} differs: {shown} (p = {one.p_value:.1g}); the model has one "
            "value for all, and sessions diagnosed by themselves have their own."
        )
