"""Plots of a learned correction over position, tilt, speed, time or path length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.basis import ROUND
from irt.diagnosis.board_motion import kept, of_lags
from irt.diagnosis.result import Diagnosis, NamedEffect
from irt.diagnosis.terms import YIELDING
from irt.model import Parameter
from irt.report import style
from irt.report.diagnosis_plots import thinned
from irt.report.learned import (
    PARTS,
    REFERENCE_SPEED,
    LearnedTerm,
    laws,
    learned_terms,
    part_unit,
    variable_unit,
)
from irt.report.page import Picture
from irt.report.plots import rim_of
from irt.rig import Rig

Array = NDArray[np.float64]

#: Samples per radian of phase, enough for a smooth line; least and most samples along an axis.
_PER_RADIAN, _LEAST, _MOST = 2.0, 24, 240
#: Most vertices of a recorded path drawn over a map.
_MOST_CORNERS = 300
#: Variables with an x and a y component; a heading has its cosine and its sine.
_PLANE = ("position", "velocity", "command")


def learned_pictures(
    folder: Path, one: NamedEffect, rig: Rig, diagnosis: Diagnosis, row_s: float, *, stamped: bool
) -> list[Picture]:
    """Draw a learned correction over the variables that it depends on.

    Parameters
    ----------
    folder : Path
        Folder of the pictures.
    one : NamedEffect
        The correction.
    rig, diagnosis : Rig, Diagnosis
        Give the range of positions and speeds: outside it a correction is undetermined.
    row_s : float
        Duration of a row [s].
    stamped : bool
        Whether axes are in seconds; otherwise they are in rows.

    Raises
    ------
    IrtError
        If a file cannot be written.
    """
    shown_row_s = None if stamped else row_s
    pictures = []
    groups: dict[str, list[LearnedTerm]] = {}
    for term in learned_terms(one.parameters):
        groups.setdefault(term.variable, []).append(term)
    seen = _Seen(rig, diagnosis, row_s)
    for variable, terms in groups.items():
        for part in PARTS:
            acting = [term for term in terms if part in term.amplitudes]
            if not acting:
                continue
            path = folder / f"learned-{variable}-{part.replace('_1_', '-').removesuffix('_m_per_s2')}.svg"
            title, unit, _ = part_unit(part, shown_row_s)
            name, _, _ = variable_unit(variable, shown_row_s)
            caption = f"Learned {title} over the {name} [{unit}]."
            field = _Field(part, acting, variable, shown_row_s)
            if variable in _PLANE:
                _plot_map(path, field, seen)
                if variable == "position":
                    caption += " Grey: recorded paths; elsewhere the correction is extrapolated."
            else:
                _plot_line(path, field, seen)
            pictures.append(Picture(path, caption))
    for law in laws(one.parameters):
        path = folder / f"learned-{law[0].split(maxsplit=1)[0]}.svg"
        _plot_law(path, law, seen.speed, shown_row_s)
        pictures.append(Picture(path, f"Learned {law[0]} over the speed."))
    drive = {name: one.parameters[name].value for name in YIELDING}
    if drive[YIELDING[0]]:
        path = folder / "learned-drive.svg"
        _plot_drive(path, drive, seen.rates(drive[YIELDING[0]]), shown_row_s)
        pictures.append(Picture(path, "Learned share of its angle that a drive keeps, over its rate."))
    return pictures


class _Seen:
    """Ranges of the variables of a correction in the recordings [SI units]."""

    def __init__(self, rig: Rig, diagnosis: Diagnosis, row_s: float) -> None:
        edge, model = rig.board.edge_x_m, diagnosis.model
        self.reach = rim_of(model) * edge
        self.paths = [edge * run.observed for run in diagnosis.runs]
        speeds = [np.linalg.norm(np.diff(path, axis=0), axis=1) / row_s for path in self.paths]
        known = np.concatenate([speed[np.isfinite(speed)] for speed in speeds] or [np.zeros(0)])
        # Differences of noisy positions overstate the highest speeds.
        self.speed = float(np.quantile(known, 0.99)) if len(known) else 0.1
        gears = [model.parameters[name].value for name in ("gear_x", "gear_y")]
        self._tilts, self._row_s = [one.knobs * gears for one in rig.recordings], row_s
        self.tilt = max(float(np.abs(one).max(initial=0.0)) for one in self._tilts)
        self.seconds = row_s * max(len(one.knobs) for one in rig.recordings)
        lengths = [float(np.nansum(np.linalg.norm(np.diff(path, axis=0), axis=1))) for path in self.paths]
        self.way = max(lengths, default=0.1)

    def rates(self, lag: float) -> Array:
        """Return the highest rates about x and y of a drive with a lag [s] under the commands [rad/s]."""
        lags = np.array([lag])
        late = [of_lags(one, one[0], lags, self._row_s) for one in self._tilts]
        return np.asarray(np.max([np.abs(one[:, 0]).max(axis=0) for one in late], axis=0) / lag)

    def ends(self, variable: str) -> list[tuple[float, float]]:
        """Return the limits of the axes of a variable."""
        if variable == "position":
            return [(-float(half), float(half)) for half in self.reach]
        if variable in ("velocity", "command"):
            half = self.speed if variable == "velocity" else self.tilt
            return [(-half, half)] * 2
        if variable == "heading":
            return [(-np.pi, np.pi)]
        return [(0.0, self.seconds if variable == "time" else self.way)]


@dataclass(frozen=True, eq=False)
class _Field:
    """One part of a correction, such as its push along x, over one variable."""

    part: str
    terms: Sequence[LearnedTerm]
    variable: str
    row_s: float | None

    def at(self, values: Array) -> Array:
        """Return the field, (n,), at (n, c) values of the variable [display unit]."""
        _, _, times = part_unit(self.part, self.row_s)
        return np.asarray(
            times * sum(term.amplitudes[self.part].value * term.at(values) for term in self.terms)
        )

    @property
    def label(self) -> str:
        """Label of the axis."""
        title, unit, _ = part_unit(self.part, self.row_s)
        return f"{title}  [{unit}]"

    def samples(self, axis: int, low: float, high: float) -> Array:
        """Return sample points along an axis, dense enough for the fastest of the terms."""
        fastest = 0.0
        for term in self.terms:
            rates = np.abs(term.vectors.get(self.variable, np.zeros(2)))
            # The second phase of spots and saddles runs across the first.
            along = self.variable in _PLANE and term.shape not in ROUND
            fastest = max(fastest, float(rates[axis] if along else rates.max()))
        count = int(np.clip(np.ceil(_PER_RADIAN * fastest * (high - low)), _LEAST, _MOST))
        return np.linspace(low, high, count)


def _plot_map(path: Path, field: _Field, seen: _Seen) -> None:
    """Draw a field as a colour map over a plane."""
    name, unit, factor = variable_unit(field.variable, field.row_s)
    places = [field.samples(axis, *ends) for axis, ends in enumerate(seen.ends(field.variable))]
    grid = np.stack(np.meshgrid(*places), axis=-1)
    values = field.at(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    most = float(np.abs(values).max()) or 1.0
    # Around zero the plane keeps the colour of the paper.
    half = len(style.DIVERGING) // 2
    colours = (*style.DIVERGING[:half], style.PAPER, *style.DIVERGING[half:])
    levels = np.linspace(-most, most, len(colours) + 1)
    with style.drawing(path, 3.9, 3.9) as figure:
        axes: Any = figure.subplots()
        x, y = (factor * one for one in places)
        filled = axes.contourf(x, y, np.clip(values, -most, most), levels=levels, colors=colours)
        if field.variable == "position":
            for run in seen.paths:
                axes.plot(*(factor * run[thinned(len(run), _MOST_CORNERS)]).T, color=style.RECORDED, lw=0.7)
        where = (
            "tilt about "
            if field.variable == "command"
            else ""
            if field.variable == "position"
            else f"{name} "
        )
        axes.set(xlabel=f"{where}x  [{unit}]", ylabel=f"{where}y  [{unit}]", aspect="equal")
        axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        bar = figure.colorbar(filled, orientation="horizontal", aspect=28, ticks=levels[::3], format="%.3g")
        bar.set_label(field.label)
        bar.outline.set_visible(False)


def _plot_line(path: Path, field: _Field, seen: _Seen) -> None:
    """Draw a field as a line over a scalar variable."""
    name, unit, factor = variable_unit(field.variable, field.row_s)
    ((low, high),) = seen.ends(field.variable)
    along = field.samples(0, low, high)
    heading = field.variable == "heading"
    values = np.column_stack([np.cos(along), np.sin(along)]) if heading else along[:, None]
    with style.drawing(path, style.WIDTH, 2.6) as figure:
        axes: Any = figure.subplots()
        axes.axhline(0.0, color=style.MUTED, lw=0.7)
        axes.plot(factor * along, field.at(values), color=style.TUNED)
        axes.set(xlabel=f"{name}  [{unit}]", ylabel=field.label, xlim=(factor * low, factor * high))


def _plot_drive(path: Path, drive: Mapping[str, float], rates: Array, row_s: float | None) -> None:
    """Draw the shares of its angles that a drive keeps, up to the recorded rates."""
    _, unit, factor = variable_unit("turning", row_s)
    with style.drawing(path, style.WIDTH, 2.6) as figure:
        axes: Any = figure.subplots()
        for axis, most, color in zip("xy", rates, (style.TUNED, style.RECORDED), strict=True):
            along = np.linspace(0.0, most, _MOST)
            share = kept(drive[f"yield_{axis}"], drive[f"yield_{axis}_s_per_rad"], along)
            axes.plot(factor * along, 100.0 * share, color=color, label=f"about {axis}")
        axes.set(xlabel=f"rate of the drive  [{unit}]", ylabel="share of its angle  [%]")
        axes.set_xlim(0.0, factor * float(rates.max()))
        axes.set_ylim(bottom=0.0)
        axes.legend()


def _plot_law(path: Path, law: tuple[str, Parameter, Parameter], speed: float, row_s: float | None) -> None:
    """Draw a power law over the range of recorded speeds."""
    title, strength, power = law
    _, of, times = part_unit("push_1_x_m_per_s2", row_s)
    _, unit, factor = variable_unit("velocity", row_s)
    speeds = np.linspace(0.0, speed, _MOST)
    values = times * strength.value * (speeds / REFERENCE_SPEED) ** power.value
    with style.drawing(path, style.WIDTH, 2.6) as figure:
        axes: Any = figure.subplots()
        axes.axhline(0.0, color=style.MUTED, lw=0.7)
        axes.plot(factor * speeds, values, color=style.TUNED)
        axes.set(xlabel=f"speed  [{unit}]", ylabel=f"{title.split(maxsplit=1)[0]}  [{of}]")
        axes.set_xlim(0.0, factor * speed)
