"""The fitting problem: segments and parameters, as passed to the engine's solvers."""

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
from irt.rig import KNOB_RAD, PARAMETERS, STOPS_RAD

if TYPE_CHECKING:
    from irt.model import Effect, Model
    from irt.rig import Rig
    from irt.segments import Segment

Array = NDArray[np.float64]

TIME = PARAMETERS.index("time_scale")
#: Gauss-Newton steps if only start states are estimated.
STATE_ITERATIONS = 8
#: Most rounds of local search around the best point of a fit.
ROUNDS = 3


@dataclass(frozen=True)
class _Choice:
    """Position of an open choice: among all values, the effects, and the effect's parameters."""

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
        Names of all n parameters: the five, then ``effect.parameter``. Optional parameters without a value
        are not part of the problem.
    slots : (n,) int array
        Their indices among the engine's m parameters: the five, then all of the effects.
    neutral : (m,) array
        Values of the engine's parameters that are not part of the problem.
    ranges : (n, 2) array
        Ends of their ranges, in their own units.
    allowed : (n, 2) array
        The values that physics allows.
    asked : dict
        The problem as the engine takes it, each open choice at its neutral value.
    choices : tuple
        Binary parameters without a value: both values are tried.
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
            Board, marble, ranges, and whether the marble starts at rest.
        segments : sequence of Segment
            The segments to predict: all stamped or none.
        effects : sequence of Effect
            Effects of the simulation. The search starts at the given values; parameters without a value start
            anywhere in their ranges. Optional parameters are neutral unless they have a value.
        values : (5,) array, optional
            Start of the search for the five parameters; by default anywhere in the ranges.
        time_scale : float, optional
            Hold the time scale at this value, as given by stamps.
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
        infos = [_within(in_unit_of(rig, effect(one.name)), within or {}) for one in effects]
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
        """Fit from the best points of a draw, or from (k, n) given points.

        `progress` is called with (done, total, rows of a window). `rounds` is the number of local searches
        around the best point: on a rough loss, gradients alone stop slightly above the minimum.
        """
        asked: list[tuple[dict[str, Any], list[list[float]]]]
        if points is None:
            asked = [(self._with(answers), []) for answers in product(*(one.answers for one in self.choices))]
        else:
            asked = [(one, self._of_engine(points[own])) for one, own in self._by_choice(points)]
        found = []
        for number, (one, begin) in enumerate(asked):
            report = None if progress is None else _of_one(progress, number, len(asked))
            answer = answered(
                _labsim.fit, one, points=begin, starts=starts, seed=seed, rounds=rounds, progress=report
            )
            found.append(self._solution(answer))
        best = min(found, key=lambda one: one.loss)
        return replace(best, rollouts=sum(one.rollouts for one in found))

    def refine(self, values: Array, *, iterations: int = 12) -> list[Refined]:
        """Minimise the loss locally from each of (k, n) values, over whole segments.

        The gears of all values must have the signs of the first.
        """
        return self._refined(values, iterations, held=False)

    def judge(self, values: Array) -> list[Refined]:
        """Return the residuals at each of (k, n) values; only start states are estimated."""
        return self._refined(values, STATE_ITERATIONS, held=True)

    def filter(self, values: Array, noise: Array, states: Sequence[Array] | None = None) -> list[Filtered]:
        """Predict each row from all rows before it by an extended Kalman filter, at each of (k, n) values.

        Parameters
        ----------
        values : (k, n) array
            Parameters. The gears of all values must have the signs of the first.
        noise : (k, 14) array
            The tracker's white noise and its correlated noise [board edges], the correlation time of the
            latter [s], the spectral density of the marble's white acceleration noise [m^2/s^3], a correlated
            acceleration noise [m/s^2] and its correlation time [s], and the standard deviations of the
            coefficient of restitution, of the response times of the board, of marbles leaving a wall and of
            marbles that break away from rest [s], the white and correlated noise of the measured tilt [rad]
            and the correlation time of the latter [s], all three zero without a measured tilt, and the
            standard deviation of the start velocity [m/s].
        states : sequence of (s, 4) arrays, optional
            Known start states of the segments for each of the values, as in `Solution`; by default a marble
            starts at its first observed position, at rest on average.
        """
        found: dict[int, Filtered] = {}
        for asked, own in self._by_choice(values):
            begun = None if states is None else [np.ascontiguousarray(states[index]) for index in own]
            of_engine = self._of_engine(values[own])
            filtered = _labsim.filtered(asked, of_engine, np.ascontiguousarray(noise[own]), begun)
            found.update(zip(own, (Filtered(**one) for one in filtered), strict=True))
        return [found[index] for index in range(len(values))]

    def smooth(self, values: Array, noise: Array, states: Array) -> Smoothed:
        """Estimate the missing push in each row from all rows by the fixed-interval smoother of `filter`.

        Takes (n,) values, (14,) noise sizes and (s, 4) start states.
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
        """Maximise the posterior from (k, n) values and (k, 14) noise sizes, as taken by `filter`.

        The posterior of values and start states combines the filter's likelihood, in which the marble is
        pushed at random, with a prior that has the mean and variance of the parameters' ranges. Start states
        begin at `states`, (s, 4) for each of the values, or at those of the first rows. The gears of all
        values must have the signs of the first.
        """
        found: dict[int, Probable] = {}
        for asked, own in self._by_choice(values):
            begin, sizes = self._of_engine(values[own]), np.ascontiguousarray(noise[own])
            begun = None if states is None else [np.ascontiguousarray(states[index]) for index in own]
            tops = answered(_labsim.ascend, asked, begin, sizes, begun, iterations=iterations)
            found.update(zip(own, (Probable.of(one, self.slots) for one in tops), strict=True))
        return [found[index] for index in range(len(values))]

    def leave_out(
        self, values: Array, noise: Array, states: Array, folds: Sequence[int | None], *, iterations: int
    ) -> list[Probable]:
        """Maximise the posterior without each fold of the segments, from the maximum with all of them.

        Takes (n,) values, (14,) noise sizes, (s, 4) start states and the fold of each segment, None if it is
        never left out, and returns a maximum for each fold in ascending order. All folds share the first
        derivatives.
        """
        ((asked, _),) = self._by_choice(values[None])
        found = answered(
            _labsim.leave_out,
            asked,
            self._of_engine(values[None])[0],
            np.ascontiguousarray(noise[None]),
            np.ascontiguousarray(states),
            folds=folds,
            iterations=iterations,
        )
        return [Probable.of(one, self.slots) for one in found]

    def inform(self, values: Array, noise: float) -> Curvature:
        """Return the curvature of the loss at any (n,) values.

        Start states are estimated. Residuals are weighted by their own scale if that is larger than `noise`
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

    def _solution(self, answer: Mapping[str, Any]) -> Solution:
        """Return the engine's solution, with the parameters of the problem only."""
        own = {
            "values": answer["values"][self.slots],
            "information": Curvature.of(answer["information"], self.slots),
            "estimates": [(values[:, self.slots], errors) for values, errors in answer["estimates"]],
            "shrunk": [Shrunk.of(one) for one in answer["shrunk"]],
        }
        return Solution(**{**answer, **own})

    def _of_engine(self, values: Array) -> list[list[float]]:
        """Return (k, n) values as (k, m) values of the engine."""
        full = np.tile(self.neutral, (len(values), 1))
        full[:, self.slots] = values
        rows: list[list[float]] = full.tolist()
        return rows

    def _by_choice(self, values: Array) -> list[tuple[dict[str, Any], list[int]]]:
        """Group (k, n) values by their open choices: pairs of a problem and the indices of its values."""
        groups: dict[tuple[float, ...], list[int]] = {}
        for index, row in enumerate(values):
            groups.setdefault(tuple(row[one.slot] for one in self.choices), []).append(index)
        return [(self._with(answers), own) for answers, own in groups.items()]

    def _with(self, answers: Sequence[float]) -> dict[str, Any]:
        """Return the problem as the engine takes it, with the open choices at these values."""
        effects = [(name, sought.copy()) for name, sought in self.asked["effects"]]
        for one, answer in zip(self.choices, answers, strict=True):
            effects[one.effect][1][one.parameter, 2] = answer
        return {**self.asked, "effects": effects}


def _of_one(
    progress: Callable[[int, int, int], None], number: int, count: int
) -> Callable[[int, int, int], None]:
    """Return the progress callback of one fit out of several."""
    return lambda done, total, rows: progress(number * total + done, count * total, rows)


def tracker_noise(segments: Iterable[Segment]) -> float:
    """Estimate the standard deviation of the tracker [board edges] from the recordings alone."""
    return noise_in(segment.observed for segment in segments)


def noise_in(observed: Iterable[Array]) -> float:
    """Estimate the standard deviation of the tracker [board edges] from (n, 2) positions alone.

    The motion is smooth from row to row, so fourth differences contain mostly noise. The error of a tracker
    that rounds to pixels is constant while the marble stays in a pixel, so only rows with motion are used.
    """
    return _labsim.tracker_noise([np.ascontiguousarray(one) for one in observed])


def in_unit_of(rig: Rig | Model, info: EffectInfo) -> EffectInfo:
    """Return an effect with ranges in the unit of a rig's commands: gears are in rad per unit.

    Restitution and friction of the rim cannot become negative.
    """
    if info.of_rims:
        least = {"increase": -rig.board.wall_restitution, "friction_increase": -rig.board.wall_friction}
        own = [replace(one, low=max(one.low, least.get(one.name, one.low))) for one in info.parameters]
        return replace(info, parameters=tuple(own))
    most = max(abs(end) for name in ("gear_x", "gear_y") for end in rig.ranges[name])
    if info.name == GEAR_MATRIX:
        return replace(info, parameters=tuple(replace(one, low=-most, high=most) for one in info.parameters))
    if rig.commands.unit == "rad":
        return info
    return info.in_unit(rig.commands.unit, most * KNOB_RAD / STOPS_RAD)


def _within(info: EffectInfo, within: Mapping[str, tuple[float, float]]) -> EffectInfo:
    """Return an effect with other ranges."""
    ends = [within.get(f"{info.name}.{one.name}", (one.low, one.high)) for one in info.parameters]
    pairs = zip(info.parameters, ends, strict=True)
    return replace(info, parameters=tuple(replace(one, low=low, high=high) for one, (low, high) in pairs))


def _sought(chosen: Effect, parameters: Sequence[EffectParameter], held: Mapping[str, float]) -> Array:
    """Return low, high and start of the parameters of an effect, (p, 3); a missing start is NaN.

    A held parameter has NaN as low and high, and its value as start. So have choices, and optional parameters
    without a value.
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
    """Return the choices of effects that have no value."""
    slot = len(PARAMETERS)
    for index, chosen in enumerate(effects):
        made = {*chosen.parameters, *held.get(chosen.name, {})}
        for place, one in enumerate(effect(chosen.name).parameters):
            if one.is_choice and one.name not in made:
                yield _Choice(slot, index, place, one.choices)
            slot += not one.optional or one.name in made


def _recordings(segments: Sequence[Segment], *, at_rest: bool) -> dict[str, Any]:
    """Return the recordings of segments, each once, and the location of the segments in them."""
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
