"""The terms of a learned correction, with their wavelengths and widths."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.basis import ROUND, SHAPES, shaped
from irt.diagnosis.formula import cleared
from irt.diagnosis.result import NamedEffect
from irt.diagnosis.terms import AT_RIM, GROWTHS, PROFILES, TURNS, VECTORS, of_slot
from irt.model import Parameter
from irt.report.page import Table
from irt.report.words import in_rows, quantity, scaled, with_interval

Array = NDArray[np.float64]

#: Amplitudes of a profile, by the parameter of the first slot: title, unit, units per SI unit.
PARTS = {
    "push_1_x_m_per_s2": ("push along x", "mm/s²", 1e3),
    "push_1_y_m_per_s2": ("push along y", "mm/s²", 1e3),
    "brake_1_m_per_s2": ("drag", "mm/s²", 1e3),
    "gear_1_x": ("change of the gear about x", "%", 1e2),
    "gear_1_y": ("change of the gear about y", "%", 1e2),
}
#: Variables of a profile: name, unit, units per SI unit, power of the second in the unit.
VARIABLES = {
    "position": ("position", "mm", 1e3, 0),
    "velocity": ("velocity", "mm/s", 1e3, -1),
    "heading": ("heading", "°", 180.0 / np.pi, 0),
    "command": ("tilt", "mrad", 1e3, 0),
    "turning": ("rate of the tilt", "mrad/s", 1e3, -1),
    "time": ("time since row 0", "s", 1.0, 1),
    "way": ("path length since row 0", "mm", 1e3, 0),
}
#: Speed at which drags and lateral pushes are given [m/s], the reference of the engine's power laws.
REFERENCE_SPEED = 0.1
_MODE = "mode of the board"
#: Rates of the picture: the quantity, its unit per mrad of tilt, and units per SI unit.
_PICTURE = (("angle", TURNS, "°/mrad", 0.18 / np.pi), ("growth", GROWTHS, "%/mrad", 0.1))
#: Forces at the rim: what they do, unit, units per SI unit, power of the second in the unit.
_AT_RIM = dict(
    zip(
        AT_RIM,
        (("holds back", "mm/s²", 1e3, -2), ("brakes by", "mm/s²", 1e3, -2), ("drag", "1/s", 1.0, -1)),
        strict=True,
    )
)
#: Shapes with a width; lines, bowls and saddles have none.
_OF_A_WIDTH = ("step", "bell", "ridge", "spot")


@dataclass(frozen=True, eq=False)
class LearnedTerm:
    """One profile of a learned correction: amplitudes times a function of a phase.

    Attributes
    ----------
    shape : str
        One of `irt.diagnosis.basis.SHAPES`.
    vectors : dict
        Phase per unit of each variable; keys of `VARIABLES`.
    phase, across : float
        Offset of the phase, and of the second phase of a spot or a saddle [rad].
    amplitudes : dict
        Nonzero amplitudes with intervals; keys of `PARTS`.
    size : Parameter or None
        Wavelength of a wave, width of a step, bell, ridge or spot [SI unit of its variable]; with an
        interval if a single value determines it. Lines, bowls and saddles have no size.
    """

    shape: str
    vectors: dict[str, Array]
    phase: float
    across: float
    amplitudes: dict[str, Parameter]
    size: Parameter | None

    @property
    def variable(self) -> str:
        """The variable that it depends on; the first if there are several."""
        return next(iter(self.vectors), "position")

    def at(self, values: Array) -> Array:
        """Return the profile, (n,), at (n, c) values of its variable, with all other variables zero."""
        vector = self.vectors.get(self.variable, np.zeros(values.shape[1]))
        phases = values @ vector + self.phase
        if self.shape not in ROUND:
            return np.asarray(shaped(self.shape, phases))
        return np.asarray(shaped(self.shape, phases, values @ [-vector[1], vector[0]] + self.across))


def learned_terms(parameters: Mapping[str, Parameter]) -> list[LearnedTerm]:
    """Return the profiles of a learned correction with nonzero amplitudes, from its parameters by name."""
    values = cleared({name: parameter.value for name, parameter in parameters.items()})
    terms = []
    for slot in range(1, PROFILES + 1):
        amplitudes = {part: parameters[of_slot(part, slot)] for part in PARTS if values[of_slot(part, slot)]}
        if not amplitudes:
            continue
        names = {
            variable: [of_slot(name, slot) for name in names if values[of_slot(name, slot)]]
            for variable, names in VECTORS.items()
        }
        vectors = {
            variable: np.array([values[of_slot(name, slot)] for name in VECTORS[variable]])
            for variable, acting in names.items()
            if acting
        }
        shape = SHAPES[round(values[f"shape_{slot}"])]
        acting = [parameters[name] for name in next(filter(None, names.values()), [])]
        terms.append(
            LearnedTerm(
                shape,
                vectors,
                values[f"phase_{slot}_rad"],
                values[f"across_{slot}_rad"],
                amplitudes,
                _size(shape, acting),
            )
        )
    return terms


def _size(shape: str, components: Sequence[Parameter]) -> Parameter | None:
    """Return the wavelength or the width of a profile from the components of its phase vector."""
    if not components or shape not in ("wave", *_OF_A_WIDTH):
        return None
    phase = 2.0 * np.pi if shape == "wave" else 1.0
    size = phase / float(np.linalg.norm([component.value for component in components]))
    first = components[0]
    if len(components) > 1 or first.low is None or first.high is None or first.low * first.high <= 0.0:
        return Parameter(size)
    low, high = sorted(phase / abs(end) for end in (first.low, first.high))
    return Parameter(size, low, high)


def laws(parameters: Mapping[str, Parameter]) -> Iterator[tuple[str, Parameter, Parameter]]:
    """Yield the acting power laws of the speed: name, acceleration at 0.1 m/s [m/s²], power."""
    for name, title in (("drag", "drag against the motion"), ("side", "push to the left of the motion")):
        if parameters[f"{name}_strength"].value:
            yield title, parameters[f"{name}_strength"], parameters[f"{name}_power"]


def terms_table(one: NamedEffect, row_s: float | None) -> Table:
    """Return the terms of a learned correction with their wavelengths or widths.

    Parameters
    ----------
    one : NamedEffect
        The correction.
    row_s : float or None
        Duration of a row [s] if the recordings have no stamps; times are then given in rows.
    """
    return Table(
        "Terms of the correction, with 95 % intervals. The phase grows by 1 rad over a width",
        ["term", "depends on", "wavelength, width or period", "direction", "amplitude"],
        list(_rows(one, row_s)),
        words=(4,),
    )


def described(one: NamedEffect, row_s: float | None) -> Iterator[str]:
    """Yield a line for each term of a learned correction, for the terminal."""
    for shape, depends, size, direction, amplitude in _rows(one, row_s):
        length = {"wave": "wavelength", _MODE: "period"}.get(shape, "width")
        known = {length: size, "direction": direction}
        details = [f"{name} {value}" for name, value in known.items() if value != "-"]
        line = f"{shape} over {', '.join([depends, *details])}: {amplitude}"
        # Tables separate an interval by two spaces.
        yield line.replace("  ", " ")


def _rows(one: NamedEffect, row_s: float | None) -> Iterator[list[str]]:
    for term in learned_terms(one.parameters):
        _, unit, factor = variable_unit(term.variable, row_s)
        size = "-" if term.size is None else f"{with_interval(scaled(factor, term.size))} {unit}"
        vector = term.vectors.get(term.variable, np.zeros(1))
        angle = f"{np.degrees(np.arctan2(vector[1], vector[0])) % 180.0:.0f}°" if len(vector) == 2 else "-"
        amplitudes = [
            f"{part_unit(part, row_s)[0]} {_amplitude(part, value, row_s)}"
            for part, value in term.amplitudes.items()
        ]
        over = " and ".join(VARIABLES[variable][0] for variable in term.vectors)
        yield [term.shape, over or "nothing", size, angle, ", ".join(amplitudes)]
    for title, strength, power in laws(one.parameters):
        size = f"{_amplitude('push_1_x_m_per_s2', strength, row_s)} at {_speed(row_s)}"
        yield ["power law", "speed", "-", "-", f"{title} {size}, power {with_interval(power)}"]
    gain, rate, damping = (
        one.parameters[name] for name in ("mode_gain", "mode_rate_rad_per_s", "mode_damping")
    )
    if gain.value:
        period, unit = Parameter(2.0 * np.pi / rate.value), "s"
        if row_s is not None:
            _, period, unit = in_rows("period_s", period, unit, row_s)
        amplitude = f"gain {with_interval(gain)}, damping {with_interval(damping)}"
        yield [_MODE, "tilt", quantity(period.value, unit), "-", amplitude]
    if one.parameters["yield_lag_s"].value:
        yield [
            "drive that yields",
            "tilt and its rate",
            "-",
            "-",
            ", ".join(_yielding(one.parameters, row_s)),
        ]
    forces = list(_forces_at_rim(one.parameters, row_s))
    if forces:
        yield ["rim", "contact with the rim", "-", "-", ", ".join(forces)]
    values = cleared({name: parameter.value for name, parameter in one.parameters.items()})
    for what, names, unit, factor in _PICTURE:
        rates = [
            f"{with_interval(scaled(factor, one.parameters[name]))} {unit} about {axis}"
            for name, axis in zip(names, "xy", strict=True)
            if values[name]
        ]
        if rates:
            yield ["picture", "tilt", "-", "-", f"{what} {', '.join(rates)}"]


def _yielding(parameters: Mapping[str, Parameter], row_s: float | None) -> Iterator[str]:
    """Yield how late a drive follows, and what it loses about each axis while it turns fast."""
    late, unit = parameters["yield_lag_s"], "s"
    if row_s is not None:
        _, late, unit = in_rows("lag_s", late, unit, row_s)
    yield f"lag {with_interval(late)} {unit}"
    _, per, factor = variable_unit("turning", row_s)
    for axis in "xy":
        share, slowness = parameters[f"yield_{axis}"], parameters[f"yield_{axis}_s_per_rad"].value
        if share.value and slowness:
            kept = quantity(factor / abs(slowness), per)
            yield f"loses {with_interval(scaled(1e2, share))} % about {axis} at rates far above {kept}"


def _forces_at_rim(parameters: Mapping[str, Parameter], row_s: float | None) -> Iterator[str]:
    """Yield what the rim does to a marble that touches it, nothing if negative; in rows without interval."""
    for name, (what, unit, factor, power) in _AT_RIM.items():
        value = parameters[name]
        if value.value <= 0.0:
            continue
        if row_s is None:
            yield f"{what} {with_interval(scaled(factor, value))} {unit}"
        else:
            yield f"{what} {factor * row_s**-power * value.value:.3g} {unit.replace('/s', '/row')}"


def _amplitude(part: str, value: Parameter, row_s: float | None) -> str:
    """Return an amplitude with its unit; in rows without interval, which reflects mostly the time scale."""
    _, unit, factor = part_unit(part, row_s)
    shown = scaled(factor, value)
    return f"{with_interval(Parameter(shown.value) if 'row' in unit else shown)} {unit}"


def _speed(row_s: float | None) -> str:
    return f"{REFERENCE_SPEED:g} m/s" if row_s is None else f"{1e3 * REFERENCE_SPEED * row_s:.3g} mm/row"


def variable_unit(variable: str, row_s: float | None) -> tuple[str, str, float]:
    """Return a variable's name, its display unit, and the number of display units per SI unit."""
    name, unit, factor, power = VARIABLES[variable]
    if row_s is None or not power:
        return name, unit, factor
    return name, "rows" if unit == "s" else unit.replace("/s", "/row"), factor * row_s**-power


def part_unit(part: str, row_s: float | None) -> tuple[str, str, float]:
    """Return an amplitude's title, its display unit, and the number of display units per SI unit."""
    title, unit, factor = PARTS[part]
    if part == "brake_1_m_per_s2":
        title = f"{title} at {_speed(row_s)}"
    if row_s is None or not unit.endswith("/s²"):
        return title, unit, factor
    return title, unit.replace("/s²", "/row²"), factor * row_s**2
