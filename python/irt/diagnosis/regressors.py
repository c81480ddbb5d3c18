"""Regression of a missing push on the library of terms.

The library is sparse, as in SINDy (Brunton et al. 2016), but in weak form: noisy positions are not
differentiated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

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
    shaped,
    spots,
    waves,
)
from irt.diagnosis.board_motion import kept, of_lags, of_modes
from irt.diagnosis.displacements import Displacements, row_variances
from irt.diagnosis.free_motion import LONGEST, PULL_OF_SLOPE, Free, free_motion
from irt.diagnosis.score import Scored, with_less_push
from irt.diagnosis.terms import (
    AT_RIM,
    BRAKE,
    GEARS,
    LAWS,
    MODE,
    PICTURE,
    PROFILES,
    PUSH,
    VECTORS,
    YIELD,
    Term,
)
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
#: Time constants of drives that yield [s], and the widths of the bells that they keep, as shares of the root
#: mean square of their rates.
LAGS = np.geomspace(0.03, 1.0, 8)
KEPT = np.geomspace(0.15, 1.2, 4)
#: Smallest width of a bell [rad/s], the finest of the engine's range: no board is seen to turn so slowly.
STEADY = 5e-4
#: Least share of the angles that follows late in a first guess of what is lost.
LEAST = 0.1
#: Required gain per parameter of a term [nats].
PRICE = 3.0
#: Smallest gain of terms of other families relative to the best, and most families.
NEAR, FAMILIES = 0.7, 3
#: Most rows of segments of the observed motion; the displacement by a push grows with the square of the time.
SEEN = 60
#: Most rows of segments of predictions.
HORIZONS = (LONGEST, 60, 120)
#: Most rows in total.
MOST_ROWS = 1200
#: Variances of the random push that are tried, as shares of that of the set.
SHARES = (1.0, 0.1, 0.01)
#: Reference speed of the strength of a power law [m/s].
AT = 0.1


def terms_of_motion(now: Scored, base: Scored) -> list[Term]:
    """Return the terms that explain most of the observed motion, of several families.

    The observed motion reveals pushes however poor predictions are, but only if commands act unchanged, and
    if the picture does not turn.

    Parameters
    ----------
    now : Scored
        The five parameters with the terms learned so far.
    base : Scored
        The five parameters alone.
    """
    if any(term.law == PICTURE for term in now.terms):
        return []
    return _likely(now, _free(base, SEEN, weak=True), base, FAMILIES)


def terms_of_residuals(now: Scored) -> list[Term]:
    """Return the term that explains most of the residuals of a set's predictions, at each horizon.

    Long segments reveal small pushes; in short segments predictions do not diverge.
    """
    return [term for rows in HORIZONS for term in _likely(now, _free(now, rows, weak=False), now, 1)]


def _free(one: Scored, longest: int, *, weak: bool) -> Free:
    return free_motion(one.fitted, longest, weak=weak, most=MOST_ROWS)


def _likely(now: Scored, free: Free, parent: Scored, families: int) -> list[Term]:
    """Return the best terms of at most `families` families that still fit into the engine's effect.

    For the observed motion, of which `parent` is the set, the terms learned so far are removed, except those
    that act at the rim, which no free motion touches.
    """
    if not len(free[0].time):
        return []
    regressors = Regressors(free, now.noise, parent)
    if parent is not now:
        for term in now.terms:
            if term.law not in AT_RIM:
                regressors.take(term)
    return regressors.likely(now.terms, families)


class Regressors:
    """A missing push in segments of free motion, and the values of all variables in its rows [SI units].

    The likelihood of a term is the largest over sizes of the random push, because that of a set stands for
    the missing term as well.

    Parameters
    ----------
    free : tuple
        Segments of free motion.
    noise : (14,) array
        Noise sizes of the filter.
    one : Scored
        The set whose residuals these are.
    """

    def __init__(self, free: Free, noise: Array, one: Scored) -> None:
        parent, dataset = one.fitted, one.dataset
        edge_m, row_s = dataset.edge_m(parent), dataset.row_s(parent)
        variances = row_variances(free, noise, row_s, edge_m)
        self._missed = [
            Displacements(free, with_less_push(noise, share), variances, row_s, edge_m) for share in SHARES
        ]
        self._rows, self._dataset, self._row_s = free[0], dataset, row_s
        rows = free[0]
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

    def likely(self, terms: Sequence[Term], families: int) -> list[Term]:
        """Return the best terms of at most `families` families that gain more than their parameters cost."""
        best: dict[tuple[str, ...], tuple[float, Term]] = {}
        for one in self._candidates(terms):
            worth = one.gain - PRICE * len(one.free)
            if worth > best.get(one.family, (0.0,))[0]:
                best[one.family] = (worth, one)
        ranked = sorted(best.values(), key=lambda one: -one[0])[:families]
        return [one for worth, one in ranked if worth > NEAR * ranked[0][0]]

    def take(self, term: Term) -> None:
        """Remove a term of any strength from the residuals."""
        pushes = self._pushes(term)
        for missed in self._missed:
            missed.explain(pushes)

    def _pushes(self, term: Term) -> Array:
        """Return the pushes of a term with unit strength, (n, k, 2); waves have two phases."""
        values = term.values
        if term.law == MODE:
            return self._swings(
                *(np.array([values[f"mode_{name}"]]) for name in ("rate_rad_per_s", "damping"))
            )
        if term.law == YIELD:
            return self._yielded(values)
        if term.law is not None:
            return self._power_law(term.law, values[f"{term.law}_power"])[:, None]
        pushes = np.ones((1, 2))
        if term.brakes:
            pushes = self._power_law("drag", values["drag_power"])
        elif term.gears:
            pushes = self._pulls(self._values["command"])
        return np.asarray(self._profile(term)[:, :, None] * pushes[:, None])

    def _candidates(self, terms: Sequence[Term]) -> Iterator[Term]:
        laws = {term.law for term in terms}
        powers = [term.values["drag_power"] for term in terms if "drag_power" in term.free]
        for name in LAWS:
            if name not in laws:
                yield from self._laws(name, powers[:1] if name == "drag" and powers else POWERS)
        if MODE not in laws:
            yield self._mode()
        if YIELD not in laws:
            yield self._yielding()
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
            found = self._sized(_by_axis(self._power_law(name, power)[:, None]))
            values = {f"{name}_strength": found.strengths[0], f"{name}_power": power}
            yield Term("velocity", values, tuple(values), found.explained, found.gain)

    def _mode(self) -> Term:
        """Return the best mode of the board."""
        rates, dampings = (grid.ravel() for grid in np.meshgrid(RATES, DAMPINGS))
        found = self._sized(_by_axis(self._swings(rates, dampings)))
        names = ("mode_gain", "mode_rate_rad_per_s", "mode_damping")
        best = (found.strengths[0], float(rates[found.place]), float(dampings[found.place]))
        values = dict(zip(names, best, strict=True))
        return Term("command", values, tuple(values), found.explained, found.gain)

    def _yielding(self) -> Term:
        """Return the best drive that yields.

        Its pushes are the lag of the angles, and the loss of a share of them where they turn fast.
        """
        angles, rates = self._drives(LAGS)
        late = self._pulls(angles - self._values["command"][:, None])
        sizes = np.sqrt((rates**2).mean(axis=0))[:, None] * KEPT[:, None]
        lost = 1.0 - shaped("bell", rates[:, :, None] / np.maximum(sizes, 1e-12))
        fast = self._pulls(angles[:, :, None] * lost)
        late = np.broadcast_to(late[:, :, None], fast.shape)
        parts = [one.reshape(len(one), -1, 2) for one in (late, fast)]
        found = self._best([[one[..., axis] for one in parts] for axis in (0, 1)])
        follows, yields = np.reshape(found.strengths, (2, 2)).T
        shares = np.clip(-yields / np.maximum(follows, LEAST), -1.0, 1.0)
        place = np.unravel_index(found.place, (len(LAGS), len(KEPT)))
        # An axis that rests loses nothing.
        slowness = np.where(sizes[place] > 0.0, 1.0 / np.maximum(sizes[place], STEADY), 0.0)
        # A turn about y pushes along x.
        values = {
            "yield_lag_s": float(LAGS[place[0]]),
            **{f"yield_{name}": float(one) for name, one in zip("yx", shares, strict=True)},
            **{f"yield_{name}_s_per_rad": float(one) for name, one in zip("xy", slowness, strict=True)},
        }
        return Term("command", values, tuple(values), found.explained, found.gain)

    def _yielded(self, values: Mapping[str, float]) -> Array:
        """Return the pushes (n, 1, 2) of a drive that yields."""
        angles, rates = self._drives(np.array([values["yield_lag_s"]]))
        shares, slowness = (
            np.array([values[f"yield_{name}{unit}"] for name in "xy"]) for unit in ("", "_s_per_rad")
        )
        return self._pulls(kept(shares, slowness, rates) * angles - self._values["command"][:, None])

    def _drives(self, lags: Array) -> tuple[Array, Array]:
        """Return the angles and rates (n, k, 2) of drives with k lags, in the middles of the rows."""
        away = self._away(of_lags, lags)
        return self._values["command"][:, None] + away, -away / lags[:, None]

    def _swings(self, rates: Array, dampings: Array) -> Array:
        """Return the pushes (n, k, 2) by the deviations of k modes from the board's angles."""
        return self._pulls(self._away(of_modes, rates, dampings))

    def _away(self, of: Callable[..., Array], *shapes: Array) -> Array:
        """Return the deviations (n, k, 2) of k motions of the board from the commanded angles."""
        at_rest = self._dataset.rig.start == "rest"
        tilts = [one.knobs * self._gears for one in self._dataset.rig.recordings]
        return self._of_runs(
            [of(one, np.zeros(2) if at_rest else one[0], *shapes, self._row_s) for one in tilts]
        )

    @staticmethod
    def _pulls(angles: Array) -> Array:
        """Return the pushes [m/s^2] by angles about x and y in the last axis."""
        # A turn about y pushes along x, a turn about x against y.
        return PULL_OF_SLOPE * np.stack([angles[..., 1], -angles[..., 0]], axis=-1)

    def _of_runs(self, values: Sequence[Array]) -> Array:
        """Return the values (n, ...) in each row from (rows, ...) values of each recording."""
        rows = self._rows
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
        changes = [profiles * pushes[:, axis : axis + 1] for axis in (0, 1)]

        found = self._best([[one] for one in changes])
        return _term(grid, found, dict(zip(names, found.strengths, strict=True)))

    def _braked(self, grid: Grid, law: Array, power: float) -> Term:
        """Return the best profile as a change of the drag."""
        profiles = grid.of(self._values[grid.variable])
        found = self._sized([profiles * law[:, axis : axis + 1] for axis in (0, 1)])
        return _term(grid, found, {BRAKE: found.strengths[0], "drag_power": power})

    def _sized(self, pushes: Sequence[Array]) -> Found:
        """Return the best of k pushes with one strength, (n, k) along each axis."""
        return self._best([[one] for one in pushes], shared=True)

    def _wave(self, variable: str, vectors: Array) -> Term:
        """Return the best wave among (k, c) wave vectors over the c components of a variable."""
        angles = self._values[variable] @ vectors.T
        waves_of = np.cos(angles), np.sin(angles)
        found = self._best([waves_of, waves_of])
        # Both axes share one phase, that of the larger amplitude.
        amplitude = np.reshape(found.strengths, (2, 2))
        cosine, sine = amplitude[:, 0], amplitude[:, 1]
        phase = 0.5 * np.arctan2(-2.0 * (cosine * sine).sum(), (cosine**2 - sine**2).sum())
        push = cosine * np.cos(phase) - sine * np.sin(phase)
        grid = waves(variable, vectors[found.place : found.place + 1], float(phase % (2.0 * np.pi)))
        return _term(grid, found._replace(place=0), dict(zip(PUSH, push.tolist(), strict=True)))

    def _best(self, parts: Sequence[Sequence[Array]], *, shared: bool = False) -> Found:
        """Return the best of k pushes over all sizes of the random push.

        The information on strengths grows as the random push becomes smaller. With the information beside a
        larger one, a push explains at least as much, and it is calculated only for pushes that might win.

        Parameters
        ----------
        parts : sequences of (n, k) arrays
            For each axis, the parts of the pushes whose strengths differ.
        shared : bool
            Whether both axes have the same strengths.
        """
        plain = max(one.log_likelihood for one in self._missed)
        count = parts[0][0].shape[1]
        best, gains, information = None, np.full(count, np.inf), None
        for missed in self._missed:
            least = missed.log_likelihood - plain
            products = [missed.products(axis, of_axis) for axis, of_axis in enumerate(parts)]
            if information is not None:
                gains = least + 0.5 * _explained(information, products, shared=shared)[1]
            places = np.flatnonzero(gains > (-np.inf if best is None else best.gain))
            if not len(places):
                continue
            chosen = parts if len(places) == count else [[one[:, places] for one in each] for each in parts]
            more = [missed.information(axis, of_axis) for axis, of_axis in enumerate(chosen)]
            if information is None:
                information = more
            else:
                for one, own in zip(information, more, strict=True):
                    one[places] = own
            strengths, explained = _explained(more, [one[places] for one in products], shared=shared)
            index = int(np.argmax(explained))
            most = float(explained[index])
            share, gain = most / max(missed.total, 1e-300), least + 0.5 * most
            if best is None or gain > best.gain:
                best = Found(int(places[index]), strengths[index].ravel().tolist(), share, gain)
        assert best is not None
        return best


def _explained(
    information: Sequence[Array], products: Sequence[Array], *, shared: bool
) -> tuple[Array, Array]:
    """Return strengths (k, axes, p) of k pushes, and the sums of squares (k,) that they explain.

    Parameters
    ----------
    information : sequence of (k, p, p) arrays
        For each axis, the information on the strengths of p parts.
    products : sequence of (k, p) arrays
        For each axis, the products of residuals and displacements by the parts.
    shared : bool
        Whether both axes have the same strengths; these are returned once.
    """
    gram, right = np.stack(information, axis=1), np.stack(products, axis=1)
    if shared:
        gram, right = gram.sum(axis=1, keepdims=True), right.sum(axis=1, keepdims=True)
    identity = np.eye(gram.shape[-1])
    # Parts may depend on each other, or be contained in the nuisance directions.
    size = np.trace(gram, axis1=-2, axis2=-1)[..., None, None]
    strengths = np.linalg.solve(gram + (1e-9 * size + 1e-300) * identity, right[..., None])[..., 0]
    strengths = np.where(size[..., 0] > 0.0, strengths, 0.0)
    return strengths, (strengths * right).sum(axis=(1, 2))


class Found(NamedTuple):
    """The best of some pushes: place and strengths, explained share, and gain in log-likelihood [nats]."""

    place: int
    strengths: list[float]
    explained: float
    gain: float


def _by_axis(pushes: Array) -> list[Array]:
    """Return (n, k, 2) pushes as one (n, k) array for each axis."""
    return [pushes[..., axis] for axis in (0, 1)]


def _term(grid: Grid, found: Found, sizes: Mapping[str, float]) -> Term:
    """Return the term of one of the profiles with these strengths."""
    vector = dict(zip(VECTORS[grid.variable], grid.vectors[found.place].tolist(), strict=True))
    phases = {"phase_1_rad": float(grid.phases[found.place])}
    across = {"across_1_rad": float(grid.across[found.place])}
    free = {**vector, **phases, **sizes}
    if grid.shape in ROUND:
        free = {**free, **across}
    if grid.shape == "spot":
        # A spot has a size but no direction.
        del free[VECTORS["position"][1]]
    values = {"shape_1": float(SHAPES.index(grid.shape)), **vector, **phases, **across, **sizes}
    return Term(grid.variable, values, tuple(free), found.explained, found.gain)
