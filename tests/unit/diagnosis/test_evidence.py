"""How hypotheses compare, and when noise is all that is left."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.diagnosis.case import Fitted
from irt.diagnosis.colour import memory
from irt.diagnosis.evidence import Evidence, is_explained
from irt.diagnosis.heldout import HeldOut, is_supported


def fitted(residuals, effects=(), free=0):
    values = np.zeros(5)
    return Fitted(tuple(effects), ("a",) * 5, values, tuple(residuals), float(np.std(residuals[0])), free)


def noise(scale, *, runs=6, rows=120, seed=0):
    return [scale * np.random.default_rng([seed, run]).standard_normal((rows, 2)) for run in range(runs)]


def test_white_noise_has_no_memory():
    assert memory(noise(1e-3), 1e-3) == pytest.approx(1.0, abs=0.3)


def test_a_smooth_leftover_remembers_many_rows():
    walks = [np.cumsum(one, axis=0) for one in noise(1e-3)]
    assert memory(walks, float(np.std(walks[0]))) > 5.0


def test_memory_is_no_less_for_rows_that_were_lost():
    walks = [np.cumsum(one, axis=0) for one in noise(1e-3)]
    walks[0][10:20] = np.nan
    assert memory(walks, 0.01) > 5.0


@given(st.integers(1, 6), st.integers(0, 3))
def test_more_parameters_and_more_choices_cost_more(parameters, choices):
    evidence = Evidence(scale=1e-3, rows=1500.0, memory=1.0)
    assert evidence.price(parameters + 1, choices) > evidence.price(parameters, choices)
    assert evidence.price(parameters, choices + 1) > evidence.price(parameters, choices)


@given(st.floats(60.0, 1e5), st.integers(1, 6), st.floats(0.9, 1.1))
def test_what_is_needed_is_what_is_worth_naming(rows, parameters, share):
    """One yardstick for what is named, and for what could have been."""
    evidence = Evidence(scale=1e-3, rows=rows, memory=1.0)
    base = fitted([np.full((2000, 2), 2e-3)])
    gain = share * evidence.needed(parameters)
    least = (base.loss(1e-3) - gain) / 4000.0
    # Half of a Student-t with four degrees of freedom, backwards.
    residual = 1e-3 * np.sqrt(4.0 * np.expm1(least / 2.5))
    one = fitted([np.full((2000, 2), residual)], ["lag"], parameters)
    assert np.isclose(evidence.gain(one, base), gain, rtol=1e-6)
    assert evidence.is_better(one, base) == (share > 1.0) or abs(share - 1.0) < 1e-3


def test_what_fits_noise_no_better_is_not_worth_naming(plant):
    case = plant()
    evidence = Evidence(case.noise, 1500.0, 1.0)
    base = fitted(noise(case.noise))
    assert not evidence.is_better(fitted(noise(0.999 * case.noise), ["lag"], 1), base)
    assert evidence.is_better(fitted(noise(0.5 * case.noise), ["lag"], 1), base)


def test_noise_explains_itself_and_a_missing_effect_does_not(plant):
    null = plant(runs=6)
    base = null.fit()
    assert is_explained(null, base, base)
    case = plant([{"name": "parallax", "height_m_per_rad": 0.4}], runs=6)
    base = case.fit()
    assert not is_explained(case, base, base)


def held(losses):
    """Return a hypothesis with given losses on runs held out, at a scale of one."""
    size = [2.0 * np.sqrt(np.expm1(loss / 2.5)) for loss in losses]
    return HeldOut((), tuple(fitted([np.array([[one, 0.0]])]) for one in size))


@given(st.lists(st.floats(0.1, 50.0), min_size=3, max_size=8))
def test_what_is_better_on_every_run_is_supported(gains):
    assert is_supported(held([1.0] * len(gains)), held([1.0 + gain for gain in gains]), 1.0)


@given(st.floats(1.0, 60.0))
def test_a_gain_of_one_run_alone_is_not(gain):
    assert not is_supported(held([1.0] * 4), held([1.0 + gain, 0.999, 0.999, 0.999]), 1.0)


def test_runs_that_see_no_difference_have_no_vote():
    """A bump under three of eight runs: the others come out a little better or worse, by chance."""
    by_chance = [-0.3, -0.2, 0.1, -0.4, -0.1]
    assert is_supported(held([1.0] * 8), held([1.0 + gain for gain in (9.0, 6.0, 5.0, *by_chance)]), 1.0)
    assert not is_supported(held([3.0] * 5), held([3.0 + gain for gain in (9.0, 6.0, -2.0, -2.5, -1.5)]), 1.0)
