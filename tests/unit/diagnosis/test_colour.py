"""Noise that remembers the row before is noise; what a model lacks carries on."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.diagnosis.case import Fitted
from irt.diagnosis.colour import MOST_CARRIED, carried, fresh, memory, seeming
from irt.diagnosis.evidence import excess, is_lost, is_noise
from irt.fitting.problem import noise_in

SCALE = 1e-3


def coloured(share, *, runs=8, rows=120, seed=0):
    """Noise of standard deviation SCALE that carries on a share of the row before."""
    random = np.random.default_rng(seed)
    noise = random.normal(size=(runs, rows, 2))
    for row in range(1, rows):
        noise[:, row] = share * noise[:, row - 1] + np.sqrt(1.0 - share**2) * noise[:, row]
    return [*(SCALE * noise)]


def fitted(residuals):
    size = 1.4826 * float(np.median(np.abs(np.concatenate(residuals))))
    return Fitted((), (), np.zeros(5), tuple(residuals), size, 0)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_the_share_that_carries_on_is_found_and_taken_off(share):
    noise = coloured(share)
    found = carried(noise, SCALE)
    assert found == pytest.approx(share, abs=0.08)
    new, size = fresh(noise, found)
    assert memory(new, size) == pytest.approx(1.0, abs=0.3)
    assert size == pytest.approx(SCALE * np.sqrt(1.0 - share**2), rel=0.08)


@given(st.floats(0.0, MOST_CARRIED), st.floats(0.01, 0.2))
def test_the_more_carries_on_the_smaller_noise_seems(share, more):
    assert seeming(0.0) == pytest.approx(1.0)
    assert seeming(share + more) > seeming(share)


def test_noise_seems_as_much_smaller_as_differences_tell():
    assert noise_in(coloured(0.5, runs=4)) * seeming(0.5) == pytest.approx(SCALE, rel=0.08)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_noise_that_remembers_a_row_is_noise(plant, share):
    case = replace(plant(), noise=SCALE / seeming(share))
    assert is_noise(case, fitted(coloured(share)))


def test_what_carries_on_is_not_noise(plant):
    case = replace(plant(), noise=SCALE)
    drift = [np.cumsum(0.2 * one, axis=0) for one in coloured(0.0, seed=1)]
    assert not is_noise(case, fitted([a + b for a, b in zip(coloured(0.0), drift, strict=True)]))
    assert not is_noise(case, fitted([1.5 * one for one in coloured(0.0)]))


def test_nothing_left_over_carries_nothing_on():
    assert carried([np.zeros((5, 2))], 1.0) == 0.0


def test_a_model_is_lost_where_far_more_than_noise_is_left_and_much_of_what_the_base_left(plant):
    case = replace(plant(), noise=SCALE)
    base, most = (fitted([size * np.cumsum(one, axis=0) for one in coloured(0.0)]) for size in (10.0, 8.0))
    assert is_lost(case, base, base)
    assert is_lost(case, most, base)
    assert not is_lost(case, fitted(coloured(0.0)), base)
    # A few times the noise throughout is next to nothing of what the base model left.
    rest = fitted([3.0 * one for one in coloured(0.0)])
    assert 2.0 * case.noise < rest.noise < 0.1 * base.noise
    assert not is_lost(case, rest, base)
    assert excess(case, rest) > 0.1 * excess(case, base)


def test_a_tracker_without_noise_leaves_none(plant):
    assert is_noise(plant(), fitted([np.zeros((20, 2))] * 4))
