"""Regression of a missing push on the library of terms.

The library is sparse, as in SINDy (Brunton et al. 2016), but in weak form: noisy positions are not
differentiated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.basis import (
    LOCAL,
    POLYNOMIALS,
    ROUND,
    SHAPES,
    Grid,
    half_plane,
    lines,
    saddles,
    spots,
    waves,
)
from irt.diagnosis.dataset import Fitted
from irt.diagnosis.free_motion import LONGEST, PULL
from irt.diagnosis.latent_force import LatentForce
from irt.diagnosis.terms import BRAKE, GEARS, LAWS, MODE, PROFILES, PUSH, VECTORS, Term
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Shortest wave over the board [m], and the shortest over time [rows].
SHORTEST_M, SHORTEST_ROWS = 0.02, 4.0
#: Most periods of waves over the observed span of velocity or tilt.
PERIODS = 3
#: Powers of the speed, and powers of drags with a profile.
POWERS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
BRAKES = (0.0, 1.0)
#: Variables of the profiles of drags and of gears.
BRAKED = ("position", "heading", "time", "way")
GEARED = ("position", "time", "way")
#: Waves of drags and gears over time: periods in the longest recording, and phases.
SLOW = np.arange(0.25, 2.1, 0.25)
PHASES = np.arange(4) * np.pi / 4.0
#: Rates [rad/s] and dampings of modes.
RATES = np.geomspace(2.0, 40.0, 25)
DAMPINGS = (0.03, 0.1, 0.25, 0.6)
#: Required gain per parameter of a term, and for being the best of about 10,000 terms [nats].
PRICE, WORTH = 3.0, 12.0
#: Smallest gain of terms of other families relative to the best, and most families.
NEAR, FAMILIES = 0.7, 3
#: Most rows of segments of the observed motion; the displacement by a push grows with the square of the time.
SEEN = 60
#: Most rows in total.
MOST_ROWS = 1200
#: Most rows of segments of predictions, once a term is learned.
HORIZONS = (LONGEST, 60, 120)
#: Reference speed of the strength of a power law [m/s].
AT = 0.1


def likely_terms(learned: Fitted, seen: Regressors | None, terms: Sequence[Term]) -> list[Term]:
    """Return the terms that explain most of the observed motion and of the residuals of predictions.

    Parameters
    ----------
    learned : Fitted
        A set of effects, including the terms learned so far.
    seen : Regressors or None
        The observed motion, without the contributions of these terms.
    terms : sequence of Term
        The terms learned so far.

    Returns
    -------
    list of Term
        For the observed motion the best terms of several families, and for residuals at each horizon the best
        term, if they explain more than chance does in a library of this size.
    """
    found = [] if seen is None else seen.likely(terms, FAMILIES)
    if terms or seen is None:
        # Long segments reveal small pushes; in short segments predictions do not diverge.
        horizons = HORIZONS if terms else HORIZONS[:1]
        forces = (LatentForce(learned, longest=rows, most=MOST_ROWS) for rows in horizons)
        found += [term for one in forces if one.count for term in Regressors(one, learned).likely(terms, 1)]
    return found


def motion_seen(base: Fitted) -> Regressors | None:
    """Return the regression of the observed motion; None if there are no segments of free motion."""
    force = LatentForce(base, weak=True, longest=SEEN, most=MOST_ROWS)
    return Regressors(force, base) if force.count else None


class Regressors:
    """A missing push, and the values of all variables in its rows [SI units]."""

    def __init__(self, force: LatentForce, parent: Fitted) -> None:
        dataset = parent.dataset
        edge_m, row_s = dataset.edge_m(parent), dataset.row_s(parent)
        rows = force.rows
        self._force, self._dataset, self._row_s = force, dataset, row_s
        self._gears = parent.values[[PARAMETERS.index(name) for name in ("gear_x", "gear_y")]]
        self._values = {
            "position": rows.place * edge_m,
            "velocity": rows.velocity * edge_m / row_s,
            "heading": rows.velocity
            / np.maximum(np.linalg.norm(rows.velocity, axis=1, keepdims=True), 1e-12),
            "command": rows.knobs * self._gears,
            "time": rows.time[:, None] * row_s,
            "way": edge_m * self._of_runs([one.way[:, None] for one in dataset.rig.recordings]),
        }
        #: Factor from m/s^2 to board edges per row squared.
        self._unit = row_s**2 / edge_m
        self._data = [self._projected(axis) for axis in (0, 1)]

    @property
    def total(self) -> float:
        """Sum of squared residuals [board edges squared]."""
        return max(float(sum(data @ data for data in self._data)), 1e-300)

    def likely(self, terms: Sequence[Term], families: int) -> list[Term]:
        """Return the best terms of at most `families` families that still fit into the engine's effect."""
        best: dict[tuple[str, ...], tuple[float, Term]] = {}
        for one in self._candidates(terms):
            gain = 0.5 * one.explained * self.total / self._dataset.noise**2 - PRICE * len(one.free)
            if gain > best.get(one.family, (WORTH,))[0]:
                best[one.family] = (gain, one)
        ranked = sorted(best.values(), key=lambda one: -one[0])[:families]
        return [one for gain, one in ranked if gain > NEAR * ranked[0][0]]

    def take(self, term: Term) -> None:
        """Remove a term of any strength from the residuals."""
        pushes = self._pushes(term)
        for axis in (0, 1):
            self._force.explain(axis, self._force.moved(pushes[:, :, axis]))
            self._data[axis] = self._projected(axis)

    def _pushes(self, term: Term) -> Array:
        """Return the pushes of a term with unit strength, (n, k, 2); waves have two phases."""
        values = term.values
        if term.law == MODE:
            return self._swings(
                *(np.array([values[f"mode_{name}"]]) for name in ("rate_rad_per_s", "damping"))
            )
        if term.law is not None:
            return self._power_law(term.law, values[f"{term.law}_power"])[:, None]
        pushes = np.ones((1, 2))
        if term.brakes:
            pushes = self._power_law("drag", values["drag_power"])
        elif term.gears:
            pushes = self._pulls(self._values["command"])
        return np.asarray(self._profile(term)[:, :, None] * pushes[:, None])

    def _projected(self, axis: int) -> Array:
        return self._force.projected(axis, self._force.residual(axis)[:, None])[:, 0]

    def _moved(self, axis: int, pushes: Array) -> Array:
        """Return displacements (n, k) by pushes (n, k) [m/s^2], without nuisance directions."""
        return self._unit * self._force.projected(axis, self._force.moved(pushes))

    def _candidates(self, terms: Sequence[Term]) -> Iterator[Term]:
        laws = {term.law for term in terms}
        powers = [term.values["drag_power"] for term in terms if "drag_power" in term.free]
        for name in LAWS:
            if name not in laws:
                yield from self._laws(name, powers[:1] if name == "drag" and powers else POWERS)
        if MODE not in laws:
            yield self._mode()
        if sum(term.law is None for term in terms) < PROFILES:
            yield from self._waves()
            even = np.ones((len(self._values["time"]), 2))
            yield from (self._pushed(grid, even, PUSH) for grid in self._local())
            tilts = self._pulls(self._values["command"])
            yield from (self._pushed(grid, tilts, GEARS) for grid in self._changing(*GEARED))
            for power in powers[:1] or BRAKES:
                law = self._power_law("drag", power)
                yield from (self._braked(grid, law, power) for grid in self._changing(*BRAKED))

    def _waves(self) -> Iterator[Term]:
        """Yield the best wave over each variable, with a push in one direction."""
        step = np.pi / (2.0 * max(float(np.ptp(self._values["position"][:, 0])), 0.05))
        yield self._wave("position", half_plane(np.full(2, step), int(2.0 * np.pi / SHORTEST_M / step)))
        for variable in ("velocity", "command"):
            if self._varies(variable):
                seen = np.ptp(self._values[variable], axis=0)
                yield self._wave(variable, half_plane(np.pi / (2.0 * seen), 4 * PERIODS))
        step = np.pi / (2.0 * self._lasts)
        yield self._wave("time", np.arange(step, 2.0 * np.pi / (SHORTEST_ROWS * self._row_s), step)[:, None])

    def _local(self) -> Iterator[Grid]:
        """Yield steps, bells, ridges, polynomials, spots and saddles over the variables."""
        for variable, values in self._values.items():
            if self._varies(variable) and variable != "heading":
                yield from lines(variable, values, (*LOCAL, *POLYNOMIALS))
        yield from spots(self._values["position"])
        yield from (
            saddles(name, self._values[name]) for name in ("position", "command") if self._varies(name)
        )

    def _changing(self, *variables: str) -> Iterator[Grid]:
        """Yield the profiles of a drag or a gear over the board, over these variables, and over time."""
        yield from spots(self._values["position"])
        for variable in variables:
            if self._varies(variable):
                yield from lines(variable, self._values[variable], ("step", "bell", "line"))
        rates = 2.0 * np.pi / self._lasts * SLOW
        yield from (waves("time", rates[:, None], phase) for phase in PHASES)

    def _varies(self, variable: str) -> bool:
        return bool((np.ptp(self._values[variable], axis=0) > 0.0).all())

    @property
    def _lasts(self) -> float:
        """Seconds of the longest recording."""
        return max(float(self._values["time"].max()), self._row_s)

    def _laws(self, name: str, powers: Sequence[float]) -> Iterator[Term]:
        """Yield power laws of the speed, against the motion or perpendicular to it."""
        for power in powers:
            strength, explained = self._sized(self._power_law(name, power)[:, None])
            values = {f"{name}_strength": float(strength[0]), f"{name}_power": power}
            yield Term("velocity", values, tuple(values), float(explained[0]))

    def _mode(self) -> Term:
        """Return the best mode of the board."""
        rates, dampings = (grid.ravel() for grid in np.meshgrid(RATES, DAMPINGS))
        gains, explained = self._sized(self._swings(rates, dampings))
        best = int(np.argmax(explained))
        names = ("mode_gain", "mode_rate_rad_per_s", "mode_damping")
        values = dict(zip(names, map(float, (gains[best], rates[best], dampings[best])), strict=True))
        return Term("command", values, tuple(values), float(explained[best]))

    def _swings(self, rates: Array, dampings: Array) -> Array:
        """Return the pushes (n, k, 2) by the deviations of k modes from the board's angles."""
        at_rest = self._dataset.rig.start == "rest"
        tilts = [one.knobs * self._gears for one in self._dataset.rig.recordings]
        away = self._of_runs(
            [_away(one, np.zeros(2) if at_rest else one[0], rates, dampings, self._row_s) for one in tilts]
        )
        return self._pulls(away)

    @staticmethod
    def _pulls(angles: Array) -> Array:
        """Return the pushes [m/s^2] by angles about x and y in the last axis."""
        # A turn about y pushes along x, a turn about x against y.
        return PULL * np.stack([angles[..., 1], -angles[..., 0]], axis=-1)

    def _of_runs(self, values: Sequence[Array]) -> Array:
        """Return the values (n, ...) in each row from (rows, ...) values of each recording."""
        rows = self._force.rows
        return np.array([values[run][row] for run, row in zip(rows.run, rows.time.astype(int), strict=True)])

    def _power_law(self, name: str, power: float) -> Array:
        """Return the pushes (n, 2) of a power law with unit strength."""
        velocity = self._values["velocity"]
        speed = np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-9)
        along = velocity / speed
        direction = -along if name == "drag" else np.stack([-along[:, 1], along[:, 0]], axis=1)
        return np.asarray(direction * (speed / AT) ** power)

    def _profile(self, term: Term) -> Array:
        """Return a profile in each row, (n, k); waves have two phases."""
        vector = np.array([[term.values[name] for name in VECTORS[term.variable]]])
        phase, across = (np.array([term.values[name]]) for name in ("phase_1_rad", "across_1_rad"))
        if term.shape == "wave":
            vector, phase = np.tile(vector, (2, 1)), phase + np.array([0.0, 0.5 * np.pi])
        return Grid(term.variable, term.shape, vector, phase, across).of(self._values[term.variable])

    def _pushed(self, grid: Grid, pushes: Array, names: Sequence[str]) -> Term:
        """Return the best profile as a factor of (n, 2) pushes.

        The names are those of its strengths along x and along y.
        """
        profiles = grid.of(self._values[grid.variable])
        strengths, explained = np.zeros((2, len(grid.phases))), np.zeros(len(grid.phases))
        for axis in (0, 1):
            moved = self._moved(axis, profiles * pushes[:, axis : axis + 1])
            along, length = moved.T @ self._data[axis], (moved**2).sum(axis=0)
            strengths[axis] = along / np.maximum(length, 1e-300)
            explained += strengths[axis] * along / self.total
        best = int(np.argmax(explained))
        sizes = dict(zip(names, strengths[:, best].tolist(), strict=True))
        return _term(grid, best, sizes, float(explained[best]))

    def _braked(self, grid: Grid, law: Array, power: float) -> Term:
        """Return the best profile as a change of the drag."""
        profiles = grid.of(self._values[grid.variable])
        strengths, explained = self._sized(profiles[:, :, None] * law[:, None])
        best = int(np.argmax(explained))
        sizes = {BRAKE: float(strengths[best]), "drag_power": power}
        return _term(grid, best, sizes, float(explained[best]))

    def _sized(self, pushes: Array) -> tuple[Array, Array]:
        """Return the best strengths (k,) of (n, k, 2) pushes, and the share that each explains (k,)."""
        along, length = np.zeros(pushes.shape[1]), np.zeros(pushes.shape[1])
        for axis in (0, 1):
            moved = self._moved(axis, pushes[:, :, axis])
            along += moved.T @ self._data[axis]
            length += (moved**2).sum(axis=0)
        strengths = np.asarray(along / np.maximum(length, 1e-300))
        return strengths, np.asarray(strengths * along / self.total)

    def _wave(self, variable: str, vectors: Array) -> Term:
        """Return the best wave among (k, c) wave vectors over the c components of a variable."""
        angles = self._values[variable] @ vectors.T
        amplitudes, explained = np.zeros((len(vectors), 2, 2)), np.zeros(len(vectors))
        for axis in (0, 1):
            parts = [self._moved(axis, part) for part in (np.cos(angles), np.sin(angles))]
            gram = np.array([[(a * b).sum(axis=0) for b in parts] for a in parts]).transpose(2, 0, 1)
            gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 1e-300 * np.eye(2)
            right = np.array([part.T @ self._data[axis] for part in parts]).T
            amplitudes[:, axis] = np.linalg.solve(gram, right[..., None])[..., 0]
            explained += (amplitudes[:, axis] * right).sum(axis=1) / self.total
        best = int(np.argmax(explained))
        # Both axes share one phase, that of the larger amplitude.
        cosine, sine = amplitudes[best, :, 0], amplitudes[best, :, 1]
        phase = 0.5 * np.arctan2(-2.0 * (cosine * sine).sum(), (cosine**2 - sine**2).sum())
        push = cosine * np.cos(phase) - sine * np.sin(phase)
        sizes = dict(zip(PUSH, push.tolist(), strict=True))
        grid = waves(variable, vectors[best : best + 1], phase % (2.0 * np.pi))
        return _term(grid, 0, sizes, float(explained[best]))


def _term(grid: Grid, index: int, sizes: Mapping[str, float], explained: float) -> Term:
    """Return the term of one of the profiles with these strengths."""
    vector = dict(zip(VECTORS[grid.variable], grid.vectors[index].tolist(), strict=True))
    phases = {"phase_1_rad": float(grid.phases[index])}
    across = {"across_1_rad": float(grid.across[index])}
    free = {**vector, **phases, **sizes}
    if grid.shape in ROUND:
        free = {**free, **across}
    if grid.shape == "spot":
        # A spot has a size but no direction.
        del free[VECTORS["position"][1]]
    values = {"shape_1": float(SHAPES.index(grid.shape)), **vector, **phases, **across, **sizes}
    return Term(grid.variable, values, tuple(free), explained)


def _away(tilts: Array, before: Array, rates: Array, dampings: Array, row_s: float) -> Array:
    """Return the deviations (n, k, 2) of k modes from (n, 2) angles, in the middles of the rows.

    The modes start at rest at the angles `before`; each angle holds for a row.
    """
    found = np.zeros((len(tilts), len(rates), 2))
    state = np.zeros((len(rates), 2, 2))
    state[:, 0] = before
    step, middle = _step(rates, dampings, row_s), _step(rates, dampings, 0.5 * row_s)
    for row, tilt in enumerate(tilts):
        state[:, 0] -= tilt
        found[row] = (middle @ state)[:, 0]
        state = step @ state
        state[:, 0] += tilt
    return found


def _step(rates: Array, dampings: Array, seconds: float) -> Array:
    """Return the transition matrices (k, 2, 2) of free oscillations over a time [s]."""
    ringing, fade = rates * np.sqrt(1.0 - dampings**2), rates * dampings
    cos, sin = np.cos(ringing * seconds), np.sin(ringing * seconds) / ringing
    matrix = np.array([[cos + fade * sin, sin], [-sin * rates**2, cos - fade * sin]])
    return np.asarray(np.exp(-fade * seconds)[:, None, None] * matrix.transpose(2, 0, 1))
