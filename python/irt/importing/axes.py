"""Assignment of columns to the axes of the convention, decided from fitted maps, with a confidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from irt.importing.conventions import DECIDED, ROLLING_GAIN, SURE
from irt.importing.weak_form import Map

Array = NDArray[np.float64]
Sureness = Literal["surely", "probably", "undecided"]

#: Share of the first input's effect above which a second input also acts on an axis.
_MIXED = 0.15
#: Share above which neither order of two commands is better.
_EITHER = 0.6
#: Range of a rolling ball's gain as factors of 5/7 g: friction, slip, a hollow ball.
_GAIN_FACTORS = (0.6, 1.5)


@dataclass(frozen=True, eq=False)
class Axes:
    """Assignment of a source's columns to the axes of the convention.

    Attributes
    ----------
    order : (int, int)
        Columns of x and y.
    signs : (float, float)
        +1 or -1 by which these columns are multiplied.
    gains, errors : (2,) array
        The deciding gain of each axis, in the column's own sign, and its standard error.
    sure : (str, str)
        Confidence of each decision.
    mixed : (2,) array
        Effect of the other column on the same axis, as a share of this one's.
    """

    order: tuple[int, int]
    signs: tuple[float, float]
    gains: Array
    errors: Array
    sure: tuple[Sureness, Sureness]
    mixed: Array

    def apply(self, columns: Array) -> Array:
        """Return the columns x and y of a source's."""
        return np.asarray(columns[:, list(self.order)] * np.array(self.signs))

    @property
    def decided(self) -> bool:
        """Whether anything was decided."""
        return any(one != "undecided" for one in self.sure)


def declared() -> Axes:
    """Return the axes as the source declares them."""
    unknown = np.full(2, np.nan)
    return Axes((0, 1), (1.0, 1.0), unknown, unknown, ("undecided", "undecided"), np.zeros(2))


def direct() -> Axes:
    """Return the axes of commands that are the tilt itself [rad]."""
    return Axes((0, 1), (1.0, 1.0), np.ones(2), np.zeros(2), ("surely", "surely"), np.zeros(2))


def tilt_axes(found: Map | None) -> Axes:
    """Assign the tilt columns, from the acceleration of the marble (rows x, y) by tilt.

    In the convention the marble accelerates by +5/7 g tilt_y along x and by -5/7 g tilt_x along y. The
    marble's axes are kept as the frame: data do not show whether a tilt or a picture was mirrored, and on a
    flat board it does not matter.
    """
    if found is None:
        return declared()
    # Rows become the effects of tilt_x and tilt_y.
    return _axes(found, rows=(1, 0), signs=(-1.0, 1.0), turn=True)


def command_axes(found: Map | None, tilt: Axes, *, by_marble: bool) -> Axes:
    """Assign the command columns to the tilts; signs are kept, because a gear may have either.

    Parameters
    ----------
    found : Map or None
        The tilt's columns by command, or with ``by_marble`` the marble's acceleration by command.
    tilt : Axes
        Assignment of the tilt's columns.
    by_marble : bool
        Whether ``found`` is the marble's acceleration.
    """
    if found is None:
        return declared()
    if by_marble:
        axes = _axes(found, rows=(1, 0), signs=(-1.0, 1.0), turn=False)
        scale = 1.0 / ROLLING_GAIN
    else:
        axes = _axes(found, rows=tilt.order, signs=tilt.signs, turn=False)
        scale = 1.0
    if min(axes.mixed) > _EITHER:
        axes = _axes(
            found,
            rows=(1, 0) if by_marble else tilt.order,
            signs=(-1.0, 1.0) if by_marble else tilt.signs,
            turn=False,
            order=(0, 1),
        )
    return Axes(axes.order, axes.signs, axes.gains * scale, axes.errors * scale, axes.sure, axes.mixed)


def is_matrix(axes: Axes) -> bool:
    """Return whether each command moves both axes."""
    return bool((axes.mixed > _MIXED).any())


def tilt_zero(found: Map | None, axes: Axes) -> tuple[Array, Array]:
    """Return the measured tilt at which nothing accelerates the marble, (2,) [rad], and its standard error.

    About x and y; 0 with an infinite error where it is undecided.
    """
    zero, error = np.zeros(2), np.full(2, np.inf)
    if found is None:
        return zero, error
    for axis, row in enumerate((1, 0)):
        if axes.sure[axis] != "undecided" and np.isfinite(found.constant_error[row]):
            gain = axes.signs[axis] * axes.gains[axis]
            zero[axis] = -found.constant[row] / gain
            error[axis] = abs(found.constant_error[row] / gain)
    return zero, error


def gain_ratio(axes: Axes) -> float:
    """Return the factor of the tilt's gains relative to 5/7 g; NaN if undecided."""
    known = [abs(gain) for gain, sure in zip(axes.gains, axes.sure, strict=True) if sure != "undecided"]
    return float(np.median(known)) / ROLLING_GAIN if known else float("nan")


def gain_is_odd(ratio: float) -> bool:
    """Return whether the gains are implausible for a rolling ball."""
    return not np.isnan(ratio) and not _GAIN_FACTORS[0] <= ratio <= _GAIN_FACTORS[1]


def _axes(
    found: Map,
    *,
    rows: tuple[int, int],
    signs: tuple[float, float],
    turn: bool,
    order: tuple[int, int] | None = None,
) -> Axes:
    """Return the axes whose x drives row ``rows[0]`` and whose y drives row ``rows[1]``.

    ``signs`` are the signs of gains in the convention. With ``turn``, columns get the sign that yields these;
    otherwise gains are returned in the convention.
    """
    z = np.abs(found.z)[list(rows)]
    effects = np.where(z >= DECIDED, found.effects[list(rows)], 0.0)
    gains, errors = found.gains[list(rows)], found.errors[list(rows)]
    if order is None:
        order = (1, 0) if effects[0, 1] + effects[1, 0] > effects[0, 0] + effects[1, 1] else (0, 1)
    main = np.array([gains[axis, order[axis]] for axis in (0, 1)])
    error = np.array([errors[axis, order[axis]] for axis in (0, 1)])
    sure: list[Sureness] = []
    mixed, turned = np.zeros(2), [1.0, 1.0]
    for axis in (0, 1):
        own, other = effects[axis, order[axis]], effects[axis, order[1 - axis]]
        score = z[axis, order[axis]]
        if own == 0.0:
            sure.append("undecided")
            continue
        mixed[axis] = other / own
        # If two tilts both move an axis, the decision is not certain; commands may well be mixed.
        clear = not turn or mixed[axis] < _EITHER
        sure.append("surely" if score >= SURE and clear else "probably")
        if turn:
            turned[axis] = float(np.sign(main[axis]) * signs[axis])
    if not turn:
        main = main * np.array(signs)
    first, second = sure
    return Axes(order, (turned[0], turned[1]), main, error, (first, second), mixed)
