"""Physics that no effect of the catalogue describes: found, learned as a formula, and put into the model.

What a hypothesis leaves over is laid beside a library of terms, each a push on the marble: waves over the
board, waves over time, powers of the speed against the motion and across it. The terms that explain most
are fitted inside the simulator with everything else (a sparse library, as in SINDy, Brunton et al. 2016, but
in the weak form: no derivative of a noisy position is taken), and stay if recordings held out confirm them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnose.case import Case, Fitted
from irt.diagnose.diagnosis import UNLISTED
from irt.diagnose.evidence import Evidence, excess
from irt.diagnose.heldout import hold_out, is_supported
from irt.diagnose.impacts import shows
from irt.diagnose.latent import Leftover
from irt.diagnose.search import Search
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Waves over the board and over time that the engine's effect can hold.
WAVES = 3
#: Shortest wave over the board [m], and the shortest over time [rows].
SHORTEST_M, SHORTEST_ROWS = 0.02, 4.0
#: Powers of the speed that are tried.
POWERS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
#: What a term must explain [nats]: its parameters, and that it is the best of a few thousand.
WORTH = 25.0
#: Effects are believed if they leave no more than this share of the base model's mismatch.
TRUSTED = 0.1
#: Effects that are believed give way only to what leaves so much of what they do.
HALF = 0.5
#: Speed at which the strength of a power law is given [m/s].
_AT = 0.1


@dataclass(frozen=True)
class Term:
    """A term of the library, with the values that explain most.

    Attributes
    ----------
    variable : str
        What the push depends on: "position", "time", "velocity" or "command".
    values : dict
        Parameters of the engine's effect, of the first slot where there are several.
    free : tuple of str
        Those that a fit may move.
    explained : float
        Share of the leftover's sum of squares.
    """

    variable: str
    values: dict[str, float]
    free: tuple[str, ...]
    explained: float


def library(case: Case, parent: Fitted) -> list[Term]:
    """Return terms that together explain what a hypothesis leaves over, the most important first.

    Each is the one that explains most of what those before it leave; the list ends where the next would
    explain no more than chance does in a library of this size.
    """
    leftover = Leftover(case, parent, weak=not parent.effects)
    if not leftover.count:
        return []
    view = _View(leftover, case.edge_m(parent), case.row_s(parent))
    chosen: list[Term] = []
    while len(chosen) < WAVES:
        terms = [*view.waves_over_board(), *view.waves_over_time()]
        if not any(one.variable == "velocity" for one in chosen):
            terms += view.powers()
        best = max(terms, key=lambda one: one.explained)
        if best.explained * view.total < 2.0 * WORTH * case.noise**2:
            break
        view.take(best)
        waves = sum(one.variable != "velocity" for one in chosen)
        chosen.append(_in_slot(best, waves + 1))
    return chosen


def learn(case: Case, base: Fitted) -> list[tuple[Case, tuple[Term, ...], Fitted]]:
    """Fit the first term of the library, the first two, and all of them, inside the simulator.

    Returns
    -------
    list of (Case, tuple of Term, Fitted)
        The case, which holds what a fit did not move; the terms; the fit.
    """
    terms = library(case, base)
    neutral = {one.name: one.neutral for one in effect(UNLISTED).parameters}
    found: list[tuple[Case, tuple[Term, ...], Fitted]] = []
    for count in range(1, len(terms) + 1):
        values, free = dict(neutral), set()
        for term in terms[:count]:
            values |= term.values
            free |= set(term.free)
        fixed = case.holding(UNLISTED, {key: value for key, value in values.items() if key not in free})
        # A start without what was learned before it, and one with: slopes may lead astray from either.
        points = [[*base.values[: len(PARAMETERS)], *values.values()]]
        if found:
            before = found[-1][2]
            known = {**values, **{k: v for k, v in before.value_of(UNLISTED).items() if v != neutral[k]}}
            points.append([*before.values[: len(PARAMETERS)], *known.values()])
        fitted = fixed.fit([UNLISTED], points=np.array(points), rounds=1)
        found.append((fixed, tuple(terms[:count]), fitted))
    return found


def confirmed(search: Search, best: Fitted) -> tuple[Case, Fitted, tuple[Term, ...]] | None:
    """Return what was learned, if it beats the catalogue's best hypothesis and recordings held out agree.

    Terms stay as long as each is better than those before it.
    """
    case, base = search.case, search.base
    kept: tuple[Case, Fitted, tuple[Term, ...]] | None = None
    before, held_before = base, search.held_out(base)
    for fixed, terms, fitted in learn(case, base):
        evidence = Evidence.of(case, [*search.fits.values(), fitted])
        between = replace(search.between_impacts, held=fixed.held)
        if not evidence.is_better(fitted, before) or not shows(between, fitted, base):
            break
        held = hold_out(fixed, fitted)
        if not is_supported(held, held_before, evidence.scale):
            break
        kept, before, held_before = (fixed, fitted, terms), fitted, held
    if kept is None:
        return None
    search.remember(kept[1], held_before)
    return kept if _is_preferred(search, kept[1], best) else None


def _is_preferred(search: Search, learned: Fitted, best: Fitted) -> bool:
    """Whether what was learned beats the catalogue's best hypothesis, and recordings held out agree.

    Effects that leave much of the mismatch are not believed, a wrong name is worse than none; but what was
    learned and explains less than they do is believed even less.
    """
    if not best.effects:
        return True
    evidence, left = search.evidence(), excess(search.case, best)
    if evidence.margin(learned, best) <= 0.0:
        return False
    if left > TRUSTED * excess(search.case, search.base):
        return True
    if excess(search.case, learned) > HALF * left:
        return False
    return is_supported(search.held_out(learned), search.held_out(best), evidence.scale)


def formula(values: dict[str, float]) -> str:
    """Return the learned push as a formula, in m/s^2."""
    parts = []
    for slot in range(1, WAVES + 1):
        push = [values[f"push_{slot}_{axis}_m_per_s2"] for axis in "xy"]
        if push == [0.0, 0.0]:
            continue
        arguments = [
            f"{values[key]:.4g} {variable}"
            for key, variable in (
                (f"wave_{slot}_x_per_m", "x"),
                (f"wave_{slot}_y_per_m", "y"),
                (f"rate_{slot}_per_s", "t"),
            )
            if values[key] != 0.0
        ]
        inside = " + ".join([*arguments, f"{values[f'phase_{slot}_rad']:.3g}"]).replace("+ -", "- ")
        parts.append(f"({push[0]:.3g}, {push[1]:.3g}) cos({inside})")
    if values["drag_strength"]:
        parts.append(f"{-values['drag_strength']:.3g} (v / 0.1 m/s)^{values['drag_power']:.2g} along v")
    if values["side_strength"]:
        parts.append(f"{values['side_strength']:.3g} (v / 0.1 m/s)^{values['side_power']:.2g} across v")
    return "a = " + " + ".join(parts)


def variables(values: dict[str, float]) -> list[str]:
    """Return on what the learned push depends: position, time, speed."""
    pushing = [
        slot
        for slot in range(1, WAVES + 1)
        if any(values[f"push_{slot}_{axis}_m_per_s2"] != 0.0 for axis in "xy")
    ]
    over_board = any(values[f"wave_{slot}_{axis}_per_m"] != 0.0 for slot in pushing for axis in "xy")
    over_time = any(values[f"rate_{slot}_per_s"] != 0.0 for slot in pushing)
    by_speed = values["drag_strength"] != 0.0 or values["side_strength"] != 0.0
    asked = {"position": over_board, "time": over_time, "speed": by_speed}
    return [name for name, depends in asked.items() if depends]


class _View:
    """A leftover in metres and seconds, against which terms are laid."""

    def __init__(self, leftover: Leftover, edge_m: float, row_s: float) -> None:
        self._leftover, self._edge_m, self._row_s = leftover, edge_m, row_s
        #: From pushes in m/s^2 to board edges a row squared.
        self._unit = row_s**2 / edge_m
        self._data = [leftover.freed(axis, leftover.residual(axis)[:, None])[:, 0] for axis in (0, 1)]
        #: Sum of squares that is left [board edges squared].
        self.total = float(sum(data @ data for data in self._data))

    def take(self, term: Term) -> None:
        """Leave a term out of what is left: its wave or its power law, of any strength."""
        place = self._leftover.rows.place * self._edge_m
        if term.variable == "velocity":
            name = "drag" if "drag_power" in term.values else "side"
            push = self._power_law(name, term.values[f"{name}_power"])
            pushes = [push[:, :1], push[:, 1:]]
        else:
            vector = np.array([term.values["wave_1_x_per_m"], term.values["wave_1_y_per_m"]])
            seconds = self._leftover.rows.time * self._row_s
            angle = (place @ vector + term.values["rate_1_per_s"] * seconds)[:, None]
            pushes = [np.concatenate([np.cos(angle), np.sin(angle)], axis=1)] * 2
        for axis in (0, 1):
            self._leftover.explain(axis, self._leftover.moved(pushes[axis]))
            residual = self._leftover.residual(axis)[:, None]
            self._data[axis] = self._leftover.freed(axis, residual)[:, 0]
        self.total = float(sum(data @ data for data in self._data))

    def _power_law(self, name: str, power: float) -> Array:
        """Return pushes (n, 2) of a power law of unit strength."""
        velocity = self._leftover.rows.velocity * self._edge_m / self._row_s
        speed = np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-9)
        along = velocity / speed
        direction = -along if name == "drag" else np.stack([-along[:, 1], along[:, 0]], axis=1)
        return np.asarray(direction * (speed / _AT) ** power)

    def waves_over_board(self) -> Iterator[Term]:
        """Yield waves over the board, with a push in one direction."""
        place = self._leftover.rows.place * self._edge_m
        step, most = np.pi / (2.0 * max(np.ptp(place[:, 0]), 0.05)), 2.0 * np.pi / SHORTEST_M
        along = np.arange(-most, most + step, step)
        vectors = np.array([(x, y) for x in along[along >= 0.0] for y in along if (x, y) > (0.0, 0.0)])
        vectors = vectors[np.linalg.norm(vectors, axis=1) <= most]
        yield from self._waves(place @ vectors.T, "position", vectors, np.zeros(len(vectors)))

    def waves_over_time(self) -> Iterator[Term]:
        """Yield pushes that come and go with the time since a recording began."""
        seconds = self._leftover.rows.time * self._row_s
        step = np.pi / (2.0 * max(float(seconds.max()), self._row_s))
        rates = np.arange(step, 2.0 * np.pi / (SHORTEST_ROWS * self._row_s), step)
        yield from self._waves(np.outer(seconds, rates), "time", np.zeros((len(rates), 2)), rates)

    def powers(self) -> Iterator[Term]:
        """Yield power laws of the speed, against the motion and across it."""
        for name in ("drag", "side"):
            for power in POWERS:
                strength, explained = self._fitted(self._power_law(name, power))
                values = {f"{name}_strength": strength, f"{name}_power": power}
                yield Term("velocity", values, (f"{name}_strength", f"{name}_power"), explained)

    def _waves(self, angles: Array, variable: str, vectors: Array, rates: Array) -> Iterator[Term]:
        """Yield the waves that explain most, of (n, k) angles in each row."""
        amplitudes, explained = np.zeros((len(rates), 2, 2)), np.zeros(len(rates))
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
        for i in np.argsort(-explained, kind="stable")[:1]:
            # One phase for both axes: that of the larger share.
            cosine, sine = amplitudes[i, :, 0], amplitudes[i, :, 1]
            phase = 0.5 * np.arctan2(-2.0 * (cosine * sine).sum(), (cosine**2 - sine**2).sum())
            push = cosine * np.cos(phase) - sine * np.sin(phase)
            values = {
                "push_1_x_m_per_s2": float(push[0]),
                "push_1_y_m_per_s2": float(push[1]),
                "wave_1_x_per_m": float(vectors[i, 0]),
                "wave_1_y_per_m": float(vectors[i, 1]),
                "rate_1_per_s": float(rates[i]),
                "phase_1_rad": float(phase % (2.0 * np.pi)),
            }
            still = "rate_1_per_s" if variable == "position" else "wave_1_"
            free = tuple(name for name in values if not name.startswith(still))
            yield Term(variable, values, free, float(explained[i]))

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


def _in_slot(term: Term, slot: int) -> Term:
    """Return a term in another of the engine's waves."""

    def moved(name: str) -> str:
        return name.replace("_1_", f"_{slot}_")

    values = {moved(name): value for name, value in term.values.items()}
    return Term(term.variable, values, tuple(moved(name) for name in term.free), term.explained)
