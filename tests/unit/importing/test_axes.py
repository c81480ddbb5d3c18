"""From maps to axes: swaps, signs, mixing, and what is not decided."""

from __future__ import annotations

import numpy as np
import pytest

from irt.importing.axes import command_axes, gain_is_odd, gain_ratio, is_matrix, tilt_axes
from irt.importing.conventions import ROLLING_GAIN
from irt.importing.weak_form import Map

NONE = np.full(2, np.nan)


def fitted(gains: list[list[float]], error: float = 0.05) -> Map:
    array = np.array(gains)
    return Map(array, np.full((2, 2), error), NONE, NONE, NONE, NONE, np.ones(2), 1000)


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("signs", [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
def test_every_convention_of_the_tilt(swap: bool, signs: tuple[float, float]) -> None:
    # Columns hold our tilts times signs, in either order.
    gains = ROLLING_GAIN * np.array([[0.0, 1.0], [-1.0, 0.0]]) * np.array(signs)
    axes = tilt_axes(fitted((gains[:, ::-1] if swap else gains).tolist()))
    ours = np.array([[0.02, -0.01]])
    logged = ours * signs
    assert np.allclose(axes.apply(logged[:, ::-1] if swap else logged), ours)
    assert axes.sure == ("surely", "surely")
    assert gain_ratio(axes) == pytest.approx(1.0)
    assert not gain_is_odd(gain_ratio(axes))


def test_nothing_significant_keeps_what_was_declared() -> None:
    axes = tilt_axes(fitted([[0.1, -0.2], [0.2, 0.1]]))
    assert (axes.order, axes.signs, axes.sure) == ((0, 1), (1.0, 1.0), ("undecided", "undecided"))
    assert np.isnan(gain_ratio(axes))


def test_one_axis_that_shows_places_the_other_without_a_sign() -> None:
    # Column 0 moves x: it is our tilt_y, so column 1 can only be tilt_x.
    axes = tilt_axes(fitted([[-7.0, 0.1], [0.1, 0.1]]))
    assert (axes.order, axes.signs, axes.sure) == ((1, 0), (1.0, -1.0), ("undecided", "surely"))


def test_commands_are_ordered_but_keep_their_signs() -> None:
    tilt = tilt_axes(fitted([[7.0, 0.0], [0.0, 7.0]]))
    assert (tilt.order, tilt.signs) == ((1, 0), (-1.0, 1.0))
    found = fitted([[0.0, -2.0], [3.0, 0.0]])
    axes = command_axes(found, tilt, by_marble=False)
    # Our tilt_x is minus column 1, which command 0 moves by +3.
    assert axes.order == (0, 1)
    assert axes.signs == (1.0, 1.0)
    assert axes.gains == pytest.approx([-3.0, -2.0])
    assert not is_matrix(axes)


def test_commands_that_move_both_axes_keep_their_order() -> None:
    tilt = tilt_axes(fitted([[0.0, 7.0], [-7.0, 0.0]]))
    found = fitted([[2.0, 2.1], [-2.1, 2.0]])
    axes = command_axes(found, tilt, by_marble=False)
    assert axes.order == (0, 1)
    assert is_matrix(axes)
    assert axes.gains == pytest.approx([2.0, 2.0])


def test_commands_by_the_marble_become_gears() -> None:
    found = fitted([[0.0, ROLLING_GAIN], [2.0 * ROLLING_GAIN, 0.0]])
    axes = command_axes(found, tilt_axes(None), by_marble=True)
    assert axes.gains == pytest.approx([-2.0, 1.0])


def test_gains_far_from_a_rolling_ball_are_odd() -> None:
    assert gain_is_odd(gain_ratio(tilt_axes(fitted([[0.0, 1.9], [-1.9, 0.0]]))))
