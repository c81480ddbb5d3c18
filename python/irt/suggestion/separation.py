"""The expected separation of two models by a run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Separation:
    """Expected separation of two hypotheses by the suggested run.

    Attributes
    ----------
    first, second : tuple of str
        Effects of the two hypotheses.
    distance : float
        RMS difference of the two predictions after refits, relative to the expected noise.
    nats : float
        Expected evidence between the two [nats].
    random_distance, random_nats : float
        The same for a run like those recorded, on average.
    most_nats : float
        Largest expected evidence of all excitations tried [nats].
    alike : bool
        Whether the two, refitted, make the same predictions for any commands.
    """

    first: tuple[str, ...]
    second: tuple[str, ...]
    distance: float
    nats: float
    random_distance: float
    random_nats: float
    most_nats: float
    alike: bool
