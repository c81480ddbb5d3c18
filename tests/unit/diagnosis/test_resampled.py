"""Intervals are no sharper than the recordings agree."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.diagnosis.case import Fitted
from irt.diagnosis.heldout import HeldOut
from irt.diagnosis.resampled import with_scatter
from irt.fitting.information import FLAT, Information


def information(half_width):
    count = len(half_width)
    ends = np.tile([-10.0, 10.0], (count, 1))
    return Information(
        names=tuple("abcde"[:count]),
        values=np.zeros(count),
        widths=np.full(count, 2.0),
        ranges=ends,
        allowed=ends,
        free=np.ones(count, dtype=bool),
        directions=np.eye(count),
        half_width=np.array(half_width),
        offset=np.zeros(count),
    )


def held_out(values):
    fits = tuple(Fitted((), (), np.array(one), (), 1.0, 0) for one in values)
    return HeldOut(fits, ())


def test_means_of_recordings_get_the_interval_of_their_mean():
    """Leaving one of n numbers out of their mean is where the jackknife is exact."""
    random = np.random.default_rng(0)
    held = 0
    for _ in range(400):
        drawn = random.normal(size=8)
        left_out = [[np.delete(drawn, index).mean()] for index in range(8)]
        told = with_scatter(information([0.0]), held_out(left_out))
        held += abs(drawn.mean()) < 2.0 * told.half_width[0]
    assert held / 400 == pytest.approx(0.95, abs=0.03)


@given(st.lists(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=2), min_size=3, max_size=9))
def test_no_interval_shrinks_and_flat_directions_stay(values):
    told = information([0.01, 2.0 * FLAT])
    wider = with_scatter(told, held_out(values))
    assert (wider.half_width >= told.half_width).all()
    assert wider.half_width[1] == told.half_width[1]


def test_two_recordings_say_nothing_of_their_scatter():
    told = information([0.01, 0.02])
    assert with_scatter(told, held_out([[0.5, 0.5], [-0.5, -0.5]])) is told
