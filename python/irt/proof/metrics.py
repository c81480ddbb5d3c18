"""Scores over many rigs: rates with intervals, confusions, detection power and the promised floors."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from irt.catalogue import hypothetical
from irt.diagnosis.result import UNLISTED
from irt.proof.plan import NULLS, SEVERAL, SIZES
from irt.proof.score import NOTHING, RigScore, matched

#: Edges of the bins of signal over noise.
BINS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, math.inf)
#: Signal over noise above which an effect must be named.
CLEAR = 5.0
#: The worlds of a full proof, by the words of the page.
PYBULLET, MUJOCO, CAMERA = "PyBullet", "MuJoCo", "through a camera"


@dataclass(frozen=True)
class Rate:
    """A rate: successes of trials, with Wilson's 95 % interval.

    Attributes
    ----------
    good, of : int
        The counts.
    """

    good: int
    of: int

    @classmethod
    def over(cls, scores: Iterable[RigScore], is_good: Callable[[RigScore], bool]) -> Rate:
        """Return the rate of good scores."""
        good = [is_good(one) for one in scores]
        return cls(sum(good), len(good))

    @property
    def share(self) -> float:
        """The rate as a number, NaN without trials."""
        return self.good / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval (Wilson 1927); from 0 to 1 without trials."""
        if not self.of:
            return 0.0, 1.0
        from scipy.stats import binomtest  # noqa: PLC0415

        interval = binomtest(self.good, self.of).proportion_ci(method="wilson")
        return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class Difference:
    """The difference of two rates, with Newcombe's 95 % interval (1998, method 10)."""

    first: Rate
    second: Rate

    @property
    def of(self) -> int:
        """The number of trials of both; 0 if either has none."""
        return self.first.of + self.second.of if self.first.of and self.second.of else 0

    @property
    def share(self) -> float:
        """The first rate minus the second, NaN if either has no trials."""
        return self.first.share - self.second.share

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval; from -1 to 1 if either has no trials."""
        if not self.of:
            return -1.0, 1.0
        one, other = self.first.share, self.second.share
        (low, high), (least, most) = self.first.interval, self.second.interval
        below, above = math.hypot(one - low, most - other), math.hypot(high - one, other - least)
        return self.share - below, self.share + above


@dataclass(frozen=True)
class Quantity:
    """A median with its 95 % interval.

    Attributes
    ----------
    value, low, high : float
        NaN without values.
    of : int
        Number of values.
    """

    value: float
    low: float
    high: float
    of: int

    @classmethod
    def median(cls, values: Sequence[float], draws: int = 2000) -> Quantity:
        """Return the median of values, with its interval by the bootstrap (percentiles, fixed seed)."""
        if not len(values):
            return cls(math.nan, math.nan, math.nan, 0)
        known = np.asarray(values, dtype=np.float64)
        middle = float(np.median(known))
        if len(known) == 1:
            return cls(middle, middle, middle, 1)
        from scipy.stats import bootstrap  # noqa: PLC0415

        interval = bootstrap(
            (known,), np.median, n_resamples=draws, method="percentile", rng=0
        ).confidence_interval
        return cls(middle, float(interval.low), float(interval.high), len(known))


@dataclass(frozen=True)
class Floor:
    """A promise and its measured value.

    Attributes
    ----------
    what : str
        Name of the metric.
    promise : str
        The floor as a phrase.
    value, low, high : float
        Measured value and its 95 % interval.
    of : int
        Number of rigs or intervals.
    kept : bool or None
        Whether the value keeps the promise; None if nothing was counted.
    sure : bool
        Whether the whole interval agrees, which needs many rigs.
    is_rate : bool
        Whether it is a rate, or a difference of rates, which is shown in percent.
    """

    what: str
    promise: str
    value: float
    low: float
    high: float
    of: int
    kept: bool | None
    sure: bool = True
    is_rate: bool = True

    @classmethod
    def between(
        cls,
        what: str,
        promise: str,
        measured: Rate | Quantity | Difference,
        *,
        least: float = -math.inf,
        most: float = math.inf,
    ) -> Floor:
        """Return the floor of a value that must lie between two limits."""
        if isinstance(measured, Quantity):
            value, low, high = measured.value, measured.low, measured.high
        else:
            value, (low, high) = measured.share, measured.interval
        kept = least <= value <= most if measured.of else None
        sure = least <= low <= high <= most if kept else high < least or low > most
        is_rate = not isinstance(measured, Quantity)
        return cls(what, promise, value, low, high, measured.of, kept, sure, is_rate)


@dataclass(frozen=True)
class Bin:
    """A range of signal over noise, and the share of effects found in it."""

    low: float
    high: float
    rate: Rate


def nulls(scores: Iterable[RigScore]) -> list[RigScore]:
    """Return the rigs without hidden physics."""
    return [one for one in scores if one.group in NULLS]


def of_catalogue(scores: Iterable[RigScore]) -> list[RigScore]:
    """Return the rigs with hidden effects of the catalogue."""
    return [one for one in scores if one.group in (*SIZES, SEVERAL)]


def in_group(scores: Iterable[RigScore], group: str) -> list[RigScore]:
    """Return the rigs of one kind."""
    return [one for one in scores if one.group == group]


def world_of(score: RigScore) -> str:
    """Return the world in which a rig was recorded, in words; empty if it does not say."""
    if score.through_camera:
        return CAMERA
    return {"pybullet": PYBULLET, "mujoco": MUJOCO}.get(score.engine, score.engine)


def in_world(scores: Iterable[RigScore], world: str) -> list[RigScore]:
    """Return the rigs of one world."""
    return [one for one in scores if world_of(one) == world]


def is_clear(score: RigScore) -> bool:
    """Return whether the base model is off the true path by at least five times the noise, or failed."""
    return score.errors is None or score.errors.signal >= CLEAR


def coverage(scores: Iterable[RigScore], *, of_effects: bool | None = None) -> tuple[Rate, int]:
    """Return the coverage of closed 95 % intervals, and the number of open ones.

    Parameters
    ----------
    scores : iterable of RigScore
        The rigs.
    of_effects : bool, optional
        Only parameters of effects, or only those of the base; by default both.
    """
    outcomes = [
        held
        for one in scores
        for name, held in one.intervals.items()
        if of_effects is None or of_effects == ("." in name)
    ]
    closed = [held for held in outcomes if held != "open"]
    return Rate(closed.count("yes"), len(closed)), len(outcomes) - len(closed)


@dataclass(frozen=True)
class Decile:
    """Inclusion probabilities in a tenth of the range: its number, their mean, how many effects act."""

    number: int
    mean: float
    rate: Rate


def calibration(scores: Iterable[RigScore]) -> list[Decile]:
    """Return how often effects act, by the probability that a diagnosis gave to it, in deciles that have any.

    An effect of the catalogue that a diagnosis does not list counts with a probability of 0, so that what was
    missed counts too.
    """
    names = [one.name for one in hypothetical()]
    pairs = [
        (one.inclusion.get(name, 0.0), name in one.kinds)
        for one in scores
        if one.verdict != "failed"
        for name in dict.fromkeys([*names, *one.inclusion])
    ]
    deciles = []
    for decile in range(10):
        among = [pair for pair in pairs if min(int(10 * pair[0]), 9) == decile]
        if among:
            mean = float(np.mean([value for value, _ in among]))
            deciles.append(Decile(decile, mean, Rate(sum(true for _, true in among), len(among))))
    return deciles


def gaps(scores: Iterable[RigScore]) -> list[float]:
    """Return the closed share of the held-out gap for each rig with a gap."""
    return [one.closed for one in scores if one.closed is not None]


def confusion(scores: Iterable[RigScore]) -> Counter[tuple[str, str]]:
    """Count confusions as (hidden, named).

    A hidden effect counts as named if a name or its tie contains it. A missed effect is paired with a
    remaining name, or with `NOTHING`; a surplus name is paired with `NOTHING` hidden. Physics outside the
    catalogue is `UNLISTED`, hidden or named.
    """
    counted: Counter[tuple[str, str]] = Counter()
    for one in scores:
        hidden = [UNLISTED] if one.group == UNLISTED else list(one.kinds)
        ties = {name: one.ties.get(name, []) for name in one.named}
        if one.verdict == "failed":
            counted.update((kind, "failed") for kind in hidden or [NOTHING])
            continue
        if one.verdict == UNLISTED:
            ties.setdefault(UNLISTED, [])
        pairs = matched(hidden, ties)
        spare = [name for name in ties if name not in pairs.values()]
        for kind in hidden:
            counted[kind, kind if kind in pairs else spare.pop(0) if spare else NOTHING] += 1
        counted.update((NOTHING, name) for name in spare)
        if not hidden and not ties:
            counted[NOTHING, NOTHING] += 1
    return counted


def power(scores: Iterable[RigScore]) -> list[Bin]:
    """Return the share of rigs with found effects, by the signal over noise of the refitted base model."""
    answers = [(one.errors.signal, one.found) for one in of_catalogue(scores) if one.errors is not None]
    return [
        Bin(low, high, Rate(sum(found for _, found in inside), len(inside)))
        for low, high in itertools.pairwise(BINS)
        for inside in [[one for one in answers if low <= one[0] < high]]
    ]


def floors(scores: Sequence[RigScore]) -> list[Floor]:
    """Return the promises of a proof with their measured values."""
    known = of_catalogue(scores)
    pairs, triples, unlisted = (in_group(scores, group) for group in ("pair", "triple", UNLISTED))
    worlds = {world: rate_right(in_world(known, world)) for world in (PYBULLET, MUJOCO, CAMERA)}
    return [
        Floor.between("false alarms", "at most 1 %", Rate.over(nulls(scores), _alarmed), most=0.01),
        Floor.between(
            f"named, or in a declared tie, where the signal is at least {CLEAR:g} times the noise",
            "at least 95 %",
            rate_right([one for one in known if is_clear(one)]),
            least=0.95,
        ),
        Floor.between("both effects of a pair", "at least 88 %", rate_right(pairs), least=0.88),
        Floor.between("all of three effects", "at least 70 %", rate_right(triples), least=0.7),
        Floor.between("effects named through a camera", "at least 88 %", worlds[CAMERA], least=0.88),
        Floor.between(
            "effects named in PyBullet minus in MuJoCo",
            "at most 5 points",
            Difference(worlds[PYBULLET], worlds[MUJOCO]),
            most=0.05,
        ),
        Floor.between(
            "held-out gap closed, median", "at least 0.95", Quantity.median(gaps(known)), least=0.95
        ),
        Floor.between(
            "95 % intervals that contain the truth", "85 to 99 %", coverage(scores)[0], least=0.85, most=0.99
        ),
        Floor.between("unlisted physics reported as such", "at least 80 %", rate_right(unlisted), least=0.8),
        Floor.between(
            "unlisted physics, held-out gap closed, median",
            "at least 0.75",
            Quantity.median(gaps(unlisted)),
            least=0.75,
        ),
    ]


def rate_right(scores: Iterable[RigScore]) -> Rate:
    """Return the rate of right answers."""
    return Rate.over(scores, lambda one: one.found)


def _alarmed(score: RigScore) -> bool:
    return score.false_alarm or score.verdict == "failed"
