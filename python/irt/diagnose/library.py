"""A library of pushes that no effect of the catalogue has, and which of them explains most of what is left.

What a hypothesis leaves over is laid beside pushes on the marble: waves over the board, over its velocity,
over the board's tilt and over time, and powers of the speed against the motion and across it. That is a
sparse library, as in SINDy (Brunton et al. 2016), but in the weak form: no derivative of a noisy position is
taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.diagnose.case import Case, Fitted
from irt.diagnose.latent import Leftover
from irt.diagnose.stretches import LONGEST
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Shortest wave over the board [m], and the shortest over time [rows].
SHORTEST_M, SHORTEST_ROWS = 0.02, 4.0
#: Waves over velocity or tilt have so many periods over what was seen of it, at most.
PERIODS = 3
#: Power laws of the speed: against the motion, and across it. Powers that are tried.
LAWS = ("drag", "side")
POWERS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
#: What a term must explain [nats]: its parameters, and that it is the best of a few thousand.
WORTH = 25.0
#: Rows of the stretches in which predictions are looked at once something is learned.
HORIZONS = (LONGEST, 60, 120)
#: Waves that the engine's effect can hold, and the parameters of one over each of what it may depend on.
WAVES = 5
VECTORS = {
    "position": ("wave_1_x_per_m", "wave_1_y_per_m"),
    "velocity": ("velocity_1_x_s_per_m", "velocity_1_y_s_per_m"),
    "command": ("tilt_1_x_per_rad", "tilt_1_y_per_rad"),
    "time": ("rate_1_per_s",),
}
#: Speed at which the strength of a power law is given [m/s].
AT = 0.1


@dataclass(frozen=True)
class Term:
    """A term of the library, with the values that explain most.

    Attributes
    ----------
    variable : str
        What the push depends on: "position", "time", "velocity" or "command".
    values : dict
        Parameters of the engine's effect, those of a wave by their names in the first slot.
    free : tuple of str
        Those that a fit may move.
    explained : float
        Share of the leftover's sum of squares.
    """

    variable: str
    values: dict[str, float]
    free: tuple[str, ...]
    explained: float

    @property
    def law(self) -> str | None:
        """The power law that it is, "drag" or "side"; None for a wave."""
        return next((name for name in LAWS if f"{name}_power" in self.values), None)

    def in_slot(self, slot: int) -> Term:
        """Return it in another of the engine's waves."""
        values = {of_slot(name, slot): value for name, value in self.values.items()}
        return Term(self.variable, values, tuple(of_slot(name, slot) for name in self.free), self.explained)


def of_slot(name: str, slot: int) -> str:
    """Return what a parameter of the engine's first wave is called in another of its waves."""
    return name.replace("_1_", f"_{slot}_")


def in_slots(terms: Sequence[Term]) -> list[Term]:
    """Return terms as the engine's effect takes them together: each wave in a slot of its own."""
    waves = itertools.accumulate(int(term.law is None) for term in terms)
    return [term.in_slot(slot) for term, slot in zip(terms, waves, strict=True)]


def likely_terms(case: Case, seen: View | None, learned: Fitted, terms: Sequence[Term]) -> list[Term]:
    """Return terms that explain most of what is left over, as the motion itself shows it and predictions do.

    Parameters
    ----------
    case : Case
        The recordings.
    seen : View or None
        The motion as it was observed, freed of what these terms could do to it.
    learned : Fitted
        The base model with what was learned so far.
    terms : sequence of Term
        Those that were learned.

    Returns
    -------
    list of Term
        Of each view the likeliest, where it explains more than chance does in a library of this size.
    """
    found = [_likeliest(seen, case, terms)]
    if terms:
        # In long stretches small pushes show, in short ones predictions do not go astray.
        views = (Leftover(case, learned, longest=rows) for rows in HORIZONS)
        found += [_likeliest(View(one, case, learned), case, terms) for one in views if one.count]
    return [one for one in found if one is not None]


def motion_seen(case: Case, base: Fitted) -> View | None:
    """Return the motion as it was observed; None where the marble never moved far from the rim."""
    leftover = Leftover(case, base, weak=True)
    return View(leftover, case, base) if leftover.count else None


def _likeliest(view: View | None, case: Case, terms: Sequence[Term]) -> Term | None:
    """Return the term that explains most in a view, of those that the engine's effect still has room for."""
    if view is None:
        return None
    laws = [name for name in LAWS if name not in {term.law for term in terms}]
    used = sum(term.law is None for term in terms)
    told = [*view.powers(laws), *(view.waves() if used < WAVES else ())]
    best: Term | None = max(told, key=lambda one: one.explained, default=None)
    if best is None or best.explained * view.total < 2.0 * WORTH * case.noise**2:
        return None
    return best


class View:
    """A leftover in metres, seconds and radians, against which terms are laid."""

    def __init__(self, leftover: Leftover, case: Case, parent: Fitted) -> None:
        edge_m, row_s = case.edge_m(parent), case.row_s(parent)
        rows = leftover.rows
        self._leftover, self._row_s = leftover, row_s
        gears = parent.values[[PARAMETERS.index(name) for name in ("gear_x", "gear_y")]]
        self._told = {
            "position": rows.place * edge_m,
            "velocity": rows.velocity * edge_m / row_s,
            "command": rows.knobs * gears,
            "time": rows.time[:, None] * row_s,
        }
        #: From pushes in m/s^2 to board edges a row squared.
        self._unit = row_s**2 / edge_m
        self._data = [self._freed(axis) for axis in (0, 1)]

    @property
    def total(self) -> float:
        """Sum of squares that is left [board edges squared]."""
        return max(float(sum(data @ data for data in self._data)), 1e-300)

    def take(self, term: Term) -> None:
        """Leave a term out of what is left: its wave or its power law, of any strength."""
        if term.law is not None:
            push = self._power_law(term.law, term.values[f"{term.law}_power"])
            pushes = [push[:, :1], push[:, 1:]]
        else:
            vector = np.array([term.values[name] for name in VECTORS[term.variable]])
            angle = self._told[term.variable] @ vector
            pushes = [np.stack([np.cos(angle), np.sin(angle)], axis=1)] * 2
        for axis in (0, 1):
            self._leftover.explain(axis, self._leftover.moved(pushes[axis]))
            self._data[axis] = self._freed(axis)

    def _freed(self, axis: int) -> Array:
        return self._leftover.freed(axis, self._leftover.residual(axis)[:, None])[:, 0]

    def waves(self) -> Iterator[Term]:
        """Yield of each kind the wave, with a push in one direction, that explains most."""
        step = np.pi / (2.0 * max(float(np.ptp(self._told["position"][:, 0])), 0.05))
        yield self._wave("position", _half_plane(np.full(2, step), int(2.0 * np.pi / SHORTEST_M / step)))
        for variable in ("velocity", "command"):
            seen = np.ptp(self._told[variable], axis=0)
            if (seen > 0.0).all():
                yield self._wave(variable, _half_plane(np.pi / (2.0 * seen), 4 * PERIODS))
        step = np.pi / (2.0 * max(float(self._told["time"].max()), self._row_s))
        yield self._wave("time", np.arange(step, 2.0 * np.pi / (SHORTEST_ROWS * self._row_s), step)[:, None])

    def powers(self, laws: Sequence[str]) -> Iterator[Term]:
        """Yield power laws of the speed, against the motion and across it."""
        for name in laws:
            for power in POWERS:
                strength, explained = self._fitted(self._power_law(name, power))
                values = {f"{name}_strength": strength, f"{name}_power": power}
                yield Term("velocity", values, (f"{name}_strength", f"{name}_power"), explained)

    def _power_law(self, name: str, power: float) -> Array:
        """Return pushes (n, 2) of a power law of unit strength."""
        velocity = self._told["velocity"]
        speed = np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-9)
        along = velocity / speed
        direction = -along if name == "drag" else np.stack([-along[:, 1], along[:, 0]], axis=1)
        return np.asarray(direction * (speed / AT) ** power)

    def _wave(self, variable: str, vectors: Array) -> Term:
        """Return the wave that explains most, of (k, c) vectors over the c values of a variable."""
        angles = self._told[variable] @ vectors.T
        amplitudes, explained = np.zeros((len(vectors), 2, 2)), np.zeros(len(vectors))
        for axis in (0, 1):
            parts = [
                self._unit * self._leftover.freed(axis, self._leftover.moved(part))
                for part in (np.cos(angles), np.sin(angles))
            ]
            gram = np.array([[(a * b).sum(axis=0) for b in parts] for a in parts]).transpose(2, 0, 1)
            gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 1e-300 * np.eye(2)
            right = np.array([part.T @ self._data[axis] for part in parts]).T
            amplitudes[:, axis] = np.linalg.solve(gram, right[..., None])[..., 0]
            explained += (amplitudes[:, axis] * right).sum(axis=1) / self.total
        best = int(np.argmax(explained))
        # One phase for both axes: that of the larger share.
        cosine, sine = amplitudes[best, :, 0], amplitudes[best, :, 1]
        phase = 0.5 * np.arctan2(-2.0 * (cosine * sine).sum(), (cosine**2 - sine**2).sum())
        push = cosine * np.cos(phase) - sine * np.sin(phase)
        told = {
            "push_1_x_m_per_s2": float(push[0]),
            "push_1_y_m_per_s2": float(push[1]),
            **dict(zip(VECTORS[variable], vectors[best].tolist(), strict=True)),
            "phase_1_rad": float(phase % (2.0 * np.pi)),
        }
        return Term(variable, told, tuple(told), float(explained[best]))

    def _fitted(self, push: Array) -> tuple[float, float]:
        """Return the strength of a (n, 2) push that suits best, and what it explains."""
        parts = [
            self._unit * self._leftover.freed(axis, self._leftover.moved(push[:, axis : axis + 1]))[:, 0]
            for axis in (0, 1)
        ]
        length = sum(float(part @ part) for part in parts)
        along = sum(float(part @ data) for part, data in zip(parts, self._data, strict=True))
        if length <= 0.0:
            return 0.0, 0.0
        return along / length, along**2 / length / self.total


def _half_plane(steps: Array, reach: int) -> Array:
    """Return a grid of vectors (k, 2), of each two opposite ones one, no longer than so many steps."""
    grid = np.array([(x, y) for x in range(reach + 1) for y in range(-reach, reach + 1) if (x, y) > (0, 0)])
    return np.asarray(grid[np.linalg.norm(grid, axis=1) <= reach] * steps)
