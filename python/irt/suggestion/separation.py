"""What a run would tell between two models."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Separation:
    """What the suggested run would tell between two hypotheses.

    Attributes
    ----------
    first, second : tuple of str
        Their effects.
    distance : float
        Root mean square, over the run, of how far the two differ after refits, over the noise expected.
    nats : float
        Evidence expected between them.
    random_distance, random_nats : float
        The same of a run like those recorded, on average.
    most_nats : float
        The largest evidence that any excitation tried would give.
    alike : bool
        Whether the two, refitted, predict the same whatever is played.
    """

    first: tuple[str, ...]
    second: tuple[str, ...]
    distance: float
    nats: float
    random_distance: float
    random_nats: float
    most_nats: float
    alike: bool
