"""Distributions agree with the intervals, keep the symmetries, and hold planted truths at their rate."""

from __future__ import annotations

import numpy as np
import pytest
from test_identifiability import along, information

from irt.fitting.identifiability import intervals
from irt.fitting.least_squares import least_squares
from irt.fitting.posterior import component
from irt.model import Effect
from irt.rig import PARAMETERS
from posterior_coverage import simulated


def drawn(found, count=4000):
    random = np.random.default_rng(3)
    return np.array([list(found.draw(random).values()) for _ in range(count)])


def test_what_is_pinned_down_is_spread_as_its_interval_says():
    known = information(half_width=0.02)
    low, high = np.quantile(drawn(component(known, ())), [0.025, 0.975], axis=0)
    stated = intervals(known)
    np.testing.assert_allclose(low, stated[0], rtol=0.02)
    np.testing.assert_allclose(high, stated[1], rtol=0.02)


def test_draws_fill_a_symmetry_as_far_as_the_ranges_reach_and_never_leave_it():
    flat = information(flat=[along("time")], half_width=1e-5)
    found = drawn(component(flat, ()))
    low, high = intervals(flat)
    assert (found >= low * 0.999).all()
    assert (found <= high * 1.001).all()
    width = np.log(high[3] / low[3])
    assert np.ptp(np.log(found[:, 3])) > 0.9 * width
    fixed = found[:, :3] * found[:, 3:4] ** 2
    assert (fixed.std(axis=0) / fixed.mean(axis=0)).max() < 1e-3


def test_a_parameter_that_alone_is_unknown_is_anywhere_in_its_range():
    friction = np.eye(5)[2]
    found = drawn(component(information(flat=[friction], half_width=1e-4), ()))
    assert found[:, 2].min() < 5e-5
    assert found[:, 2].max() > 9.5e-4
    assert found[:, 0].std() < 1e-4 * 0.1


def test_another_likelihood_widens_and_never_narrows():
    known = information(half_width=0.02)
    widths = known.widths
    own = (0.02 / 1.96 * widths) ** 2
    axis = np.array([1.0, 1.0, 0.0, 0.0, 0.0]) * widths
    narrow = component(known, (), covariance=np.diag(0.01 * own))
    wide = component(known, (), covariance=np.diag(0.01 * own) + 4e-4 * np.outer(axis, axis))
    np.testing.assert_allclose(drawn(narrow).var(axis=0), own, rtol=0.1)
    found = np.cov((drawn(wide) / widths).T)
    assert found[0, 0] == pytest.approx(4e-4 + 0.5e-4, rel=0.15)
    assert found[0, 1] > 3e-4
    assert found[3, 3] == pytest.approx(own[3] / widths[3] ** 2, rel=0.1)


def test_an_independent_error_adds():
    known = information(half_width=0.02)
    own = (0.02 / 1.96 * known.widths) ** 2
    found = drawn(component(known, (), added=np.diag(own)))
    np.testing.assert_allclose(found.var(axis=0), 2.0 * own, rtol=0.1)


@pytest.mark.slow
def test_planted_truths_lie_within_95_percent_intervals_at_that_rate():
    """Over many rigs by `benches/posterior_coverage.py`; here as many as a test may take."""
    held = []
    for seed in (0, 1, 2, 3, 5, 6, 7, 8, 10, 11):
        rig, truth = simulated(seed, stamped=True, engine="rolling")
        names = dict.fromkeys(key.split(".")[0] for key in truth if "." in key)
        model = least_squares(rig, effects=[Effect(name, {}) for name in names], starts=2, threads=2).model
        draws = np.array([one.values for one in model.sample(200)])
        low, high = np.quantile(draws, [0.025, 0.975], axis=0)
        held += [
            low[i] <= truth[name] <= high[i] for i, name in enumerate(PARAMETERS) if name != "time_scale"
        ]
    # 40 at 95 %: fewer than 34 come by chance once in a thousand times.
    assert sum(held) >= 34
