"""The score of a set of effects: the evidence of a simulator with these effects and a random push."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect, hypothetical
from irt.diagnosis import config
from irt.diagnosis.dataset import Dataset, Fitted
from irt.diagnosis.hypotheses import (
    ALIKE,
    JITTER,
    MAP,
    MEAN,
    SHIFT_S,
    SMOOTHED_S,
    SPIN,
    SPINNING,
    simulated,
)
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.terms import Term
from irt.diagnosis.time_symmetry import off_bounds
from irt.engine import SUBSTEP_S
from irt.fitting.problem import Problem
from irt.fitting.solution import Probable
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Indices of the noise sizes, as taken by `Problem.filter`.
WHITE, LASTING, LASTING_S, PUSH, PULL, PULL_S, RESTITUTION = range(7)
KICK, DEPARTURE, RELEASE, TILT_WHITE, TILT_LASTING, TILT_LASTING_S, START_VELOCITY = range(7, 14)

#: Maximum-likelihood scale of Student's t with four degrees of freedom for standard normal errors. The
#: filter's sizes of the tracker's noise are such scales.
SCALE_OF_NORMAL = 0.8310

#: Effects of the timing of commands, which include the time-step offset between engines.
TIMES = ALIKE | {JITTER}
#: Index and initial value of the noise sizes that a set has because of its effects, by `EffectInfo.noise`.
OF_EFFECTS = {"jitter": (KICK, config.KICK), "release": (RELEASE, config.RELEASE)}


@dataclass(frozen=True, eq=False)
class Scored:
    """A set of effects at the maximum of its posterior.

    Attributes
    ----------
    dataset : Dataset
        The dataset, with the held parameters of effects.
    effects : tuple of str
        The effects in the order of addition.
    names : tuple of str
        Names of the n parameters: the five, then ``effect.parameter``.
    top : Probable
        Values, deviations, noise sizes, likelihood and evidence.
    price : float
        Negative log prior of the set [nats].
    terms : tuple of Term
        Terms of the learned correction, if it is among the effects.
    filtered : Scored, optional
        The same set with values from the filter, if its values are from free runs by least squares.
    """

    dataset: Dataset
    effects: tuple[str, ...]
    names: tuple[str, ...]
    top: Probable
    price: float
    terms: tuple[Term, ...] = ()
    filtered: Scored | None = None

    @property
    def is_free(self) -> bool:
        """Whether the values are from free runs by least squares, instead of from the filter."""
        return self.filtered is not None

    @property
    def score(self) -> float:
        """The log posterior of the set, up to a constant [nats]; minus infinity if delays would be negative.

        The spread of nonnegative delays is not much larger than their mean.
        """
        if JITTER in self.effects and self.noise[KICK] > config.SPREAD * mean_delay(self.values):
            return -math.inf
        return self.log_evidence - self.price

    @property
    def log_evidence(self) -> float:
        """The log evidence of the set, up to a constant [nats].

        Spinning friction is maximised instead of integrated over, like the noise sizes, because its posterior
        has no width at zero.
        """
        spin = self.names.index(SPIN)
        width = float(self.top.deviations[spin] / self.top.values[spin]) / _width_before()
        return self.top.log_evidence - math.log(width)

    @property
    def values(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.top.values.tolist(), strict=True))

    @property
    def noise(self) -> Array:
        """Noise sizes as taken by `Problem.filter`, (14,)."""
        return np.asarray(self.top.noise)

    @property
    def tracker(self) -> float:
        """Standard deviation of the tracker's white and correlated noise together [board edges].

        The filter's noise sizes are scales of Student's t, which are converted to those of normal errors.
        """
        return float(np.hypot(*self.noise[[WHITE, LASTING]])) / SCALE_OF_NORMAL

    @property
    def drift(self) -> float:
        """Standard deviation of free runs by the random push of a complete model [board edges].

        It is that of a marble away from walls and without friction: the push is white beyond its correlation
        time, and integrated twice.
        """
        white, pull, _ = config.LITTLE
        seconds = self.dataset.row_s(self.fitted) * np.array(
            [len(one.knobs) for one in self.dataset.segments]
        )
        cubes = float((seconds**4).sum() / (4.0 * seconds.sum()))
        variance = (white + 2.0 * pull**2 * config.PULL_S) * cubes / 3.0
        return math.sqrt(variance) / self.dataset.edge_m(self.fitted)

    @functools.cached_property
    def fitted(self) -> Fitted:
        """The evaluation of its values by free runs."""
        effects = simulated(self.effects)
        problem = self.dataset.problem(effects)
        values = np.array([self.values[name] for name in problem.names])
        return self.dataset.judge(effects, values[None])[0]

    @property
    def is_exact(self) -> bool:
        """Whether free runs miss by about the tracker's noise."""
        return not self.errs_more_than(self.dataset.noise)

    def errs_more_than(self, noise: float) -> bool:
        """Whether free runs have clearly more than this noise [board edges], or an unknown one."""
        return not self.fitted.noise < (1.0 + config.EXCEEDS) * noise


@functools.cache
def _width_before() -> float:
    """Return the prior standard deviation of the logarithm of the spinning friction."""
    (size,) = effect(SPINNING).required
    return math.log(size.high / size.low) / math.sqrt(12.0)


def mean_delay(values: Mapping[str, float]) -> float:
    """Return the mean of jittered delays [s]: the sum of shift and smoothing."""
    return values[SHIFT_S] + values[SMOOTHED_S]


@dataclass(eq=False)
class Scores:
    """Scores of the sets of a dataset.

    Attributes
    ----------
    dataset : Dataset
        The dataset, with the held parameters of effects.
    terms : tuple of Term
        Terms of the learned correction, if it is among the effects.
    known : dict
        The best fit of each set.
    fits_of_base : list
        All fits of the five parameters alone.
    """

    dataset: Dataset
    terms: tuple[Term, ...] = ()
    known: dict[frozenset[str], Scored] = field(default_factory=dict)
    fits_of_base: list[Scored] = field(default_factory=list)
    _shaken: set[Scored] = field(default_factory=set)

    @classmethod
    def of(cls, one: Scored) -> Scores:
        """Return the scores for sets with the held parameters and terms of a set."""
        return cls(one.dataset, one.terms)

    def price(self, effects: Sequence[str]) -> float:
        """Return the negative log prior of a set [nats].

        One effect is expected, with all of the catalogue equally probable, and so is each term of the
        library. Delay jitter counts as two effects, mean and spread.
        """
        named = sum(name != UNLISTED for name in effects) + (JITTER in effects)
        learned = len(self.terms) if UNLISTED in effects else 0
        return named * math.log(len(hypothetical())) + learned * math.log(config.LIBRARY)

    def base(self) -> Scored:
        """Score the five parameters alone, from several starts that are repeated until they gain nothing.

        Once they have gained, one round in vain is no proof that the next one would be, too.
        """
        key: frozenset[str] = frozenset()
        if key not in self.known:
            values, noises = self._starts()
            for signs in self._signs():
                self.ascend((), values * signs, noises, iterations=config.THOROUGH)
            gears = self.known[key].top.values[:2]
            values[:, :2] = np.copysign(values[:, :2], gears)
            # Between gears of different signs lies a board that does not move.
            self.fits_of_base = [
                one for one in self.fits_of_base if (one.top.values[:2] * gears >= 0.0).all()
            ]
            self._spun(self.known[key])
            patience, before = 1, None
            for number in range(config.AGAIN):
                now = self.known[key]
                # From the same start states, the same starts lead to the same maxima.
                starts = slice(0 if now is before else None)
                self._again(values[starts], noises[starts], now, number)
                patience = 2 if self.known[key].score > now.score + config.SURE else patience - 1
                if patience == 0:
                    break
                before = now
        return self.known[key]

    def _again(self, values: Array, noises: Array, one: Scored, number: int) -> None:
        """Fit a set from earlier starts and draws of its posterior, with its start states and all pushes.

        Where much physics is missing, the likelihood has many local maxima, and at one with too large a push
        no effect shows in the screening. Close to a maximum there are others: on a real labyrinth starts one
        standard deviation away gained 40 nats.
        """
        pushed = np.stack([self.noise(push) for push in config.PUSHES])
        self.ascend(
            one.effects,
            np.concatenate([values, self._drawn(one, len(pushed), number)]),
            np.concatenate([noises, pushed]),
            one.top.states,
            iterations=config.THOROUGH,
        )

    def shaken(self, one: Scored) -> Scored:
        """Fit a set once from draws of its posterior, and return the best fit of the set."""
        if one not in self._shaken:
            self._shaken.add(one)
            values = self._drawn(one, config.SHAKEN, 0)
            noise = np.tile(one.noise, (len(values), 1))
            self.ascend(one.effects, values, noise, one.top.states, iterations=config.THOROUGH)
        return self.known[frozenset(one.effects)]

    def _drawn(self, one: Scored, count: int, number: int) -> Array:
        """Draw values of a set from the normal approximation of its posterior, (count, n).

        Gears keep their signs.
        """
        random = np.random.default_rng([self.dataset.seed, 13, number])
        values = one.top.values + one.top.deviations * random.standard_normal((count, len(one.names)))
        values[:, :2] = np.copysign(values[:, :2], one.top.values[:2])
        return values

    def _spun(self, one: Scored) -> None:
        """Fit a set from other spinning frictions, because the likelihood is flat at large values."""
        count = len(config.SPINNING)
        values = np.tile(one.top.values, (2 * count, 1))
        values[:, one.names.index(SPIN)] = np.tile(config.SPINNING, 2)
        noise = np.tile(one.noise, (len(values), 1))
        noise[count:] = quiet(noise[count:])
        self.ascend(one.effects, values, noise, one.top.states, iterations=config.THOROUGH)

    def problem(self, effects: Sequence[str]) -> Problem:
        """Return the problem of a set, with a small delay for the time-step offset between engines."""
        if set(effects) & TIMES:
            return self.dataset.grey_box(simulated(effects))
        return self.dataset.grey_box([MEAN, *simulated(effects)], within={SHIFT_S: (0.0, SUBSTEP_S)})

    def _signs(self) -> list[Array]:
        """Return factors (7,) of start values, for each sign of the gears that their ranges hold.

        Least squares find signs, but not if the marble hardly moves.
        """
        ends = [self.dataset.rig.ranges[name] for name in PARAMETERS[:2]]
        both = [(1.0, -1.0) if low < 0.0 < high else (1.0,) for low, high in ends]
        return [np.array([*signs, *[1.0] * 5]) for signs in itertools.product(*both)]

    def _starts(self) -> tuple[Array, Array]:
        """Return initial values and noise sizes: least squares, and the middle of ranges.

        If much physics is missing, least squares are far off, except for the signs of the gears and their
        size for a given time scale.
        """
        found = self.dataset.fit((), starts=6, rounds=1).values
        middle = found.copy()
        friction, time, scale = range(2, 5)
        if self.dataset.time_scale is None:
            middle[time] = np.mean(self.dataset.rig.ranges[PARAMETERS[time]])
            middle[:2] *= (found[time] / middle[time]) ** 2
        middle[friction] = np.mean(self.dataset.rig.ranges[PARAMETERS[friction]])
        middle[scale] = 1.0
        values, noises = [], []
        for begin, pushes in ((found, config.PUSHES[:-1]), (middle, config.PUSHES[1:])):
            for push in pushes:
                values.append([*begin, SUBSTEP_S / 2.0, config.SPINNING[1]])
                noises.append(self.noise(push))
        return np.array(values), np.array(noises)

    def noise(self, push: float) -> Array:
        """Return initial noise sizes, (14,)."""
        white, lasting = max(self.dataset.noise, 1e-5), max(self.dataset.noise, 1e-6)
        return np.array(
            [
                white,
                lasting,
                0.15,
                push,
                config.PULL,
                config.PULL_S,
                0.1,
                0.0,
                config.DEPARTURE,
                0.0,
                *(config.TILT if self.dataset.has_tilt else (0.0, 0.0, 0.0)),
                config.START_VELOCITY,
            ]
        )

    def ascend(
        self,
        effects: Sequence[str],
        values: Array,
        noise: Array,
        states: Array | None = None,
        *,
        iterations: int,
    ) -> list[Scored]:
        """Maximise the posterior from (k, n) values, (k, 14) noise sizes and (s, 4) states; keep the best."""
        problem = self.problem(effects)
        values, noise = off_bounds(self.dataset, problem.names, values, noise)
        noise = of_effects(noise, effects)
        tops = problem.ascend(
            values, noise, None if states is None else [states] * len(values), iterations=iterations
        )
        price = self.price(effects)
        terms = self.terms if UNLISTED in effects else ()
        found = [Scored(self.dataset, tuple(effects), problem.names, top, price, terms) for top in tops]
        for one in found:
            self.remember(one)
        if not effects:
            self.fits_of_base += found
        return found

    def freed(self, one: Scored) -> Scored:
        """Return a set with values from free runs."""
        return replace(one, top=replace(one.top, values=self.least_squares(one)), filtered=one)

    def least_squares(self, one: Scored) -> Array:
        """Return the values of a set after a fit of free runs that starts at them, (n,); a map is held."""
        effects, dataset = simulated(one.effects), self.dataset
        if MAP in effects:
            own = f"{MAP}."
            held = {key.removeprefix(own): one.values[key] for key in one.names if key.startswith(own)}
            dataset = dataset.holding(MAP, held)
        names = dataset.problem(effects).names
        found = dataset.fit(effects, points=np.array([[one.values[name] for name in names]]), rounds=0)
        values = one.values | dict(zip(names, found.values.tolist(), strict=True))
        return np.array([values[name] for name in one.names])

    def loss_without(self, one: Scored, sizes: Sequence[int]) -> float:
        """Return the loss of log-likelihood without some of the noise [nats]; infinite if unknown.

        Parameters
        ----------
        one : Scored
            The set.
        sizes : sequence of int
            Indices of the noise sizes that are set to zero, such as `PUSH`. A push within the differences
            between engines counts as zero.
        """
        if {PUSH, PULL}.issuperset(sizes) and (one.noise[[PUSH, PULL]] <= config.LITTLE[:2]).all():
            return 0.0
        problem = self.problem(one.effects)
        noise = one.noise.copy()
        for white, lasting in ((WHITE, LASTING), (TILT_WHITE, TILT_LASTING)):
            if lasting in sizes:
                noise[white] = np.hypot(noise[white], noise[lasting])
        noise[list(sizes)] = 0.0
        (top,) = problem.ascend(
            self.from_where(problem, one)[None], noise[None], [one.top.states], iterations=config.THOROUGH
        )
        gain = one.top.log_likelihood - float(top.log_likelihood)
        return max(0.0, gain) if math.isfinite(gain) else math.inf

    def push(self, one: Scored) -> float:
        """Return the gain in log-likelihood by a random push [nats]."""
        return self.loss_without(one, [PUSH, PULL])

    def rebounds(self, one: Scored) -> float:
        """Return the gain in log-likelihood by random rebounds and departures from the rim [nats]."""
        return self.loss_without(one, [RESTITUTION, DEPARTURE])

    def is_whole(self, one: Scored) -> bool:
        """Whether random push and correlated noise gain less than an additional effect would have to."""
        needed = math.log(len(hypothetical())) + config.SURE
        return self.loss_without(one, [PUSH, PULL, LASTING, TILT_LASTING]) < needed

    def remember(self, one: Scored) -> None:
        """Keep a fit if it is the best with its effects."""
        key = frozenset(one.effects)
        known = self.known.get(key)
        if known is None or one.score > known.score or math.isnan(known.score):
            self.known[key] = one

    @staticmethod
    def from_where(problem: Problem, source: Scored) -> Array:
        """Return the values of a set as values of a problem, (n,); the time-step offset is half a step."""
        values = source.values
        return np.array([values.get(name, SUBSTEP_S / 2.0) for name in problem.names])


def quiet(noise: Array) -> Array:
    """Return (k, 14) noise sizes with push and random rebounds as small as for a complete model."""
    sizes = noise.copy()
    sizes[:, [PUSH, PULL, RESTITUTION]] = config.LITTLE
    return sizes


def start_unknown(dataset: Dataset, noise: Array, states: list[Array]) -> tuple[Array, list[Array] | None]:
    """Return (k, 14) noise sizes and start states with which a filter finds the start states along the way.

    The start state of a recording in motion was fitted to the recording, with other values or effects. With
    small pushes, an error of it lasts to the end. Recordings from rest keep their states.
    """
    if dataset.rig.start == "rest":
        return noise, states
    sizes = noise.copy()
    sizes[:, START_VELOCITY] = config.START_VELOCITY
    return sizes, None


def of_effects(noise: Array, effects: Sequence[str]) -> Array:
    """Return (k, 14) noise sizes of which those that belong to effects are zero without such an effect.

    For example, a marble that rolling friction alone holds breaks away where its push and the friction are in
    balance. When it does makes no difference then, and a size without influence would only hold up a fit.
    """
    sizes = noise.copy()
    random = {effect(name).noise for name in effects}
    for name, (index, start) in OF_EFFECTS.items():
        sizes[:, index] = np.where(sizes[:, index] > 0.0, sizes[:, index], start) if name in random else 0.0
    return sizes


def with_less_push(noise: Array, share: float) -> Array:
    """Return noise sizes (14,) with a share of the variance of the random pushes."""
    sizes = noise.copy()
    sizes[[PUSH, PULL]] *= share, math.sqrt(share)
    return sizes
