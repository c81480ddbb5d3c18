"""What is fitted to what, and the door to the engine's least squares."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from irt import _labsim
from irt.catalogue import EffectInfo, EffectParameter, effect
from irt.engine import Engine
from irt.errors import IrtError, unknown_name
from irt.fitting.solution import Curvature, Filtered, Probable, Refined, Shrunk, Smoothed, Solution
from irt.fitting.unfinished import answered
from irt.model import GEAR_MATRIX
from irt.rig import PARAMETERS

if TYPE_CHECKING:
    from irt.model import Effect, Model
    from irt.rig import Rig
    from irt.segments import Segment

Array = NDArray[np.float64]

TIME = PARAMETERS.index("time_scale")
#: Gauss-Newton steps for start states alone.
STATE_ITERATIONS = 8
#: How often a fit looks around the best point found for a better one, at most.
ROUNDS = 3


@dataclass(frozen=True)
class _Choice:
    """Where an open choice stands: among all values, among the effects, among the effect's parameters."""

    slot: int
    effect: int
    parameter: int
    answers: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Problem:
    """Segments of recordings, and the parameters to find.

    Attributes
    ----------
    names : tuple of str
        Of all n parameters: the five, then ``effect.parameter``. Optional parameters that nobody names are
        no part of the problem.
    slots : (n,) int array
        Where the engine has them among its own m: the five, then all of the effects'.
    neutral : (m,) array
        What the engine's have that are no part of the problem.
    ranges : (n, 2) array
        Ends of their ranges, in their own units.
    allowed : (n, 2) array
        The values that physics allows.
    asked : dict
        The problem in the engine's words, each open choice at its usual answer.
    choices : tuple
        Parameters that are questions of yes or no, and open: every answer is tried.
    """

    names: tuple[str, ...]
    slots: NDArray[np.int64]
    neutral: Array
    ranges: Array
    allowed: Array
    asked: dict[str, Any]
    choices: tuple[_Choice, ...]

    @classmethod
    def of(
        cls,
        rig: Rig | Model,
        segments: Sequence[Segment],
        *,
        effects: Sequence[Effect] = (),
        values: Array | None = None,
        time_scale: float | None = None,
        noise: float | None = None,
        tilt_noise: float | None = None,
        held: Mapping[str, Mapping[str, float]] | None = None,
        fixed: Mapping[str, float] | None = None,
        within: Mapping[str, tuple[float, float]] | None = None,
        engine: Engine = "rolling",
        threads: int | None = None,
    ) -> Problem:
        """Return the problem of fitting the five parameters, and those of effects, to segments.

        Parameters
        ----------
        rig : Rig or Model
            Board, marble, ranges, and whether the marble rests at first.
        segments : sequence of Segment
            What is predicted: all stamped or none.
        effects : sequence of Effect
            What else is in the simulation; the search begins at the values given, and anywhere in the ranges
            for parameters that have none. Optional ones are neutral unless they have a value here.
        values : (5,) array, optional
            Where the search of the five parameters begins; by default anywhere in the ranges.
        time_scale : float, optional
            Hold it at this value: what the stamps say.
        noise : float, optional
            The tracker's standard deviation [board edges]; by default it is estimated from the segments.
        tilt_noise : float, optional
            The tilt sensor's standard deviation [rad]; by default each axis has its own, estimated from the
            segments.
        held : mapping, optional
            Values at which parameters of effects are held, by effect and name.
        fixed : mapping, optional
            Values at which some of the five parameters are held, by name.
        within : mapping, optional
            Other ranges of parameters of effects, by ``effect.parameter``.
        engine, threads
            As for `irt.rollouts`.

        Raises
        ------
        IrtError
            For an unknown effect or parameter, or the same effect twice.
        """
        if len({one.name for one in effects}) < len(effects):
            raise IrtError("effects: expected each one once")
        ranges = [rig.ranges[name] for name in PARAMETERS]
        begin = np.full(len(PARAMETERS), np.nan) if values is None else values
        parameters = np.array([(*ends, start) for ends, start in zip(ranges, begin, strict=True)])
        if time_scale is not None:
            parameters[TIME] = np.nan, np.nan, time_scale
        for name, value in (fixed or {}).items():
            parameters[PARAMETERS.index(name)] = np.nan, np.nan, value
        infos = [_within(_in_units_of(rig, effect(one.name)), within or {}) for one in effects]
        named = [{*one.parameters, *(held or {}).get(one.name, {})} for one in effects]
        pairs = list(zip(infos, named, strict=True))
        all_of_effects = [one for info, names in pairs for one in info.used(names)]
        is_used = [one in info.used(names) for info, names in pairs for one in info.parameters]
        of_engine = [one.neutral for info in infos for one in info.parameters]
        asked = {
            "board": astuple(rig.board),
            "marble": (rig.marble.radius_m, rig.marble.mass_kg, rig.marble.damping_per_s),
            "parameters": parameters,
            "effects": [
                (one.name, _sought(one, info.parameters, (held or {}).get(one.name, {})))
                for one, info in zip(effects, infos, strict=True)
            ],
            "noise": noise,
            "tilt_noise": tilt_noise,
            "engine": engine,
            "hold": segments[0].run.hold if segments else "zero",
            "threads": threads,
            **_recordings(segments, at_rest=rig.start == "rest"),
        }
        return cls(
            names=(
                *PARAMETERS,
                *(f"{info.name}.{one.name}" for info, names in pairs for one in info.used(names)),
            ),
            slots=np.flatnonzero([True] * len(PARAMETERS) + is_used),
            neutral=np.array([np.nan] * len(PARAMETERS) + of_engine),
            ranges=np.array([*ranges, *((one.low, one.high) for one in all_of_effects)]),
            allowed=np.array(
                [(-np.inf, np.inf)] * 2
                + [(0.0, np.inf)] * 3
                + [(one.least, one.most) for one in all_of_effects]
            ),
            asked=asked,
            choices=tuple(_open_choices(effects, held or {})),
        )

    def fit(
        self,
        *,
        starts: int = 8,
        points: Array | None = None,
        seed: int = 0,
        rounds: int = ROUNDS,
        progress: Callable[[int, int, int], None] | None = None,
    ) -> Solution:
        """Fit from the best of a draw, or from (k, n) points that the caller has reason to try.

        `progress` is called with (done, total, rows of a window). Without `rounds` of looking around the best
        one it is a quick look: slopes alone end a little above the bottom where the ground is rough.
        """
        asked: list[tuple[dict[str, Any], list[list[float]]]]
        if points is None:
            asked = [(self._with(answers), []) for answers in product(*(one.answers for one in self.choices))]
        else:
            asked = [(one, self._of_engine(points[own])) for one, own in self._by_choice(points)]
        found = []
        for number, (one, begin) in enumerate(asked):
            tell = None if progress is None else _of_one(progress, number, len(asked))
            answer = answered(
                _labsim.fit, one, points=begin, starts=starts, seed=seed, rounds=rounds, progress=tell
            )
            found.append(self._solution(answer))
        best = min(found, key=lambda one: one.loss)
        return replace(best, rollouts=sum(one.rollouts for one in found))

    def refine(self, values: Array, *, iterations: int = 12) -> list[Refined]:
        """Go from each of (k, n) values to the bottom of the valley it lies in, over whole segments.

        The gears of all must have the signs of the first ones.
        """
        return self._refined(values, iterations, held=False)

    def judge(self, values: Array) -> list[Refined]:
        """Say what each of (k, n) values leaves over, as it is: only start states are estimated."""
        return self._refined(values, STATE_ITERATIONS, held=True)

    def filter(self, values: Array, noise: Array, states: Sequence[Array] | None = None) -> list[Filtered]:
        """Predict each row from all rows before, at each of (k, n) values: an extended Kalman filter.

        Parameters
        ----------
        values : (k, n) array
            The gears of all must have the signs of the first ones.
        noise : (k, 10) array
            The tracker's error from row to row and its lasting error [board edges], how long that lasts [s],
            the spectral density of the marble's random acceleration [m^2/s^3], a random acceleration that
            lasts [m/s^2] and how long [s], and the standard deviations of the coefficient of restitution, of
            the times at which the board answers and at which marbles follow it from a wall [s], and of the
            start velocity [m/s].
        states : sequence of (s, 4) arrays, optional
            Known start states of the segments for each of the values, as of a `Solution`; by default a marble
            starts where it was first seen, at rest on average.
        """
        found: dict[int, Filtered] = {}
        for asked, own in self._by_choice(values):
            begun = None if states is None else [np.ascontiguousarray(states[index]) for index in own]
            of_engine = self._of_engine(values[own])
            filtered = _labsim.filtered(asked, of_engine, np.ascontiguousarray(noise[own]), begun)
            found.update(zip(own, (Filtered(**one) for one in filtered), strict=True))
        return [found[index] for index in range(len(values))]

    def smooth(self, values: Array, noise: Array, states: Array) -> Smoothed:
        """Say what push was needed in each row, given all: (n,) values, (10,) sizes and (s, 4) start states.

        The fixed-interval smoother of `filter`.
        """
        ((asked, _),) = self._by_choice(values[None])
        found = _labsim.smoothed(
            asked,
            self._of_engine(values[None])[0],
            np.ascontiguousarray(noise[None]),
            np.ascontiguousarray(states),
        )
        return Smoothed(**found)

    def ascend(
        self, values: Array, noise: Array, states: Sequence[Array] | None = None, *, iterations: int = 30
    ) -> list[Probable]:
        """Go uphill from (k, n) values and (k, 10) sizes of what is random, as `filter` takes them.

        The hill is the probability of the values and start states where the marble is also pushed at random:
        the likelihood of the filter, and a prior with mean and variance of the parameters' ranges. Start
        states are sought from those given, (s, 4) for each of the values, or from the first rows. The gears
        of all must have the signs of the first ones.
        """
        found: dict[int, Probable] = {}
        for asked, own in self._by_choice(values):
            begin, sizes = self._of_engine(values[own]), np.ascontiguousarray(noise[own])
            begun = None if states is None else [np.ascontiguousarray(states[index]) for index in own]
            tops = answered(_labsim.ascend, asked, begin, sizes, begun, iterations=iterations)
            found.update(zip(own, (Probable.of(one, self.slots) for one in tops), strict=True))
        return [found[index] for index in range(len(values))]

    def inform(self, values: Array, noise: float) -> Curvature:
        """Return what the recordings tell around (n,) values, wherever they come from.

        Start states are estimated; residuals count with their own scale where it is larger than `noise`
        [board edges].
        """
        ((asked, _),) = self._by_choice(values[None])
        (of_engine,) = self._of_engine(values[None])
        return Curvature.of(_labsim.inform(asked, of_engine, noise=noise), self.slots)

    def _refined(self, values: Array, iterations: int, *, held: bool) -> list[Refined]:
        found: dict[int, Refined] = {}
        for asked, own in self._by_choice(values):
            begin = self._of_engine(values[own])
            answers = answered(_labsim.refine, asked, begin, iterations=iterations, held=held)
            refined = (Refined(**{**one, "values": one["values"][self.slots]}) for one in answers)
            found.update(zip(own, refined, strict=True))
        return [found[index] for index in range(len(values))]

    def _solution(self, told: Mapping[str, Any]) -> Solution:
        """Return the engine's solution with the problem's parameters alone."""
        own = {
            "values": told["values"][self.slots],
            "information": Curvature.of(told["information"], self.slots),
            "estimates": [(values[:, self.slots], errors) for values, errors in told["estimates"]],
            "shrunk": [Shrunk.of(one) for one in told["shrunk"]],
        }
        return Solution(**{**told, **own})

    def _of_engine(self, values: Array) -> list[list[float]]:
        """Return (k, n) values as the engine has them, (k, m)."""
        full = np.tile(self.neutral, (len(values), 1))
        full[:, self.slots] = values
        rows: list[list[float]] = full.tolist()
        return rows

    def _by_choice(self, values: Array) -> list[tuple[dict[str, Any], list[int]]]:
        """Return the problem with each answer to open choices that (k, n) values give, and which give it."""
        groups: dict[tuple[float, ...], list[int]] = {}
        for index, row in enumerate(values):
            groups.setdefault(tuple(row[one.slot] for one in self.choices), []).append(index)
        return [(self._with(answers), own) for answers, own in groups.items()]

    def _with(self, answers: Sequence[float]) -> dict[str, Any]:
        """Return the problem in the engine's words, open choices at these answers."""
        effects = [(name, sought.copy()) for name, sought in self.asked["effects"]]
        for one, answer in zip(self.choices, answers, strict=True):
            effects[one.effect][1][one.parameter, 2] = answer
        return {**self.asked, "effects": effects}


def _of_one(
    progress: Callable[[int, int, int], None], number: int, count: int
) -> Callable[[int, int, int], None]:
    """Return the progress of one of some fits."""
    return lambda done, total, rows: progress(number * total + done, count * total, rows)


def tracker_noise(segments: Iterable[Segment]) -> float:
    """Estimate the standard deviation of the tracker [board edges] from the recordings alone."""
    return noise_in(segment.observed for segment in segments)


def noise_in(observed: Iterable[Array]) -> float:
    """Estimate the standard deviation of the tracker [board edges] from (n, 2) positions alone.

    The motion is smooth from row to row, so that of fourth differences mostly noise is left. A tracker that
    reads pixels errs alike as long as the marble stays within one: it is told by the rows in which it moves.
    """
    return _labsim.tracker_noise([np.ascontiguousarray(one) for one in observed])


def _in_units_of(rig: Rig | Model, info: EffectInfo) -> EffectInfo:
    """Return an effect with the ranges that a rig's commands give it: gears are in rad per unit of these."""
    if info.name != GEAR_MATRIX:
        return info
    most = max(abs(end) for name in ("gear_x", "gear_y") for end in rig.ranges[name])
    return replace(info, parameters=tuple(replace(one, low=-most, high=most) for one in info.parameters))


def _within(info: EffectInfo, within: Mapping[str, tuple[float, float]]) -> EffectInfo:
    """Return an effect with other ranges."""
    ends = [within.get(f"{info.name}.{one.name}", (one.low, one.high)) for one in info.parameters]
    pairs = zip(info.parameters, ends, strict=True)
    return replace(info, parameters=tuple(replace(one, low=low, high=high) for one, (low, high) in pairs))


def _sought(chosen: Effect, parameters: Sequence[EffectParameter], held: Mapping[str, float]) -> Array:
    """Return low, high and start of the parameters of an effect, (p, 3); no start is NaN.

    A parameter that is held has no ends, and its value as start; so has a choice, and an optional parameter
    that is not named.
    """
    names = [parameter.name for parameter in parameters]
    for name in (*chosen.parameters, *held):
        if name not in names:
            raise unknown_name(f"parameter of {chosen.name}", name, names)
    choices = {one.name: chosen.parameters.get(one.name, one.neutral) for one in parameters if one.is_choice}
    refining = {
        one.name: one.neutral for one in parameters if one.optional and one.name not in chosen.parameters
    }
    fixed = {**choices, **refining, **held}
    return np.array(
        [
            (np.nan, np.nan, fixed[one.name])
            if one.name in fixed
            else (one.low, one.high, chosen.parameters.get(one.name, np.nan))
            for one in parameters
        ]
    )


def _open_choices(effects: Sequence[Effect], held: Mapping[str, Mapping[str, float]]) -> Iterator[_Choice]:
    """Return the choices of effects that nobody has made."""
    slot = len(PARAMETERS)
    for index, chosen in enumerate(effects):
        made = {*chosen.parameters, *held.get(chosen.name, {})}
        for place, one in enumerate(effect(chosen.name).parameters):
            if one.is_choice and one.name not in made:
                yield _Choice(slot, index, place, one.choices)
            slot += not one.optional or one.name in made


def _recordings(segments: Sequence[Segment], *, at_rest: bool) -> dict[str, Any]:
    """Return the recordings that segments are of, each once, and where in them the segments lie."""
    runs = list(dict.fromkeys(one.run for one in segments))
    return {
        "recordings": [
            (run.knobs, run.durations, run.marble, run.way, run.rolled_path, run.tilt) for run in runs
        ],
        "knobs_before": np.array([np.zeros(2) if at_rest else run.knobs[0] for run in runs]),
        "stretches": [
            (runs.index(one.run), one.first_row, len(one.knobs), at_rest and one.first_row == 0)
            for one in segments
        ],
    }
