"""One-step predictions and fits of effects with a random push."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irt.errors import IrtError
from irt.fitting.problem import Problem
from irt.model import Effect
from irt.segments import segments

TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])
#: White and correlated noise of the tracker with its correlation time, white and correlated push with its
#: correlation time, restitution, start velocity.
NOISE = np.array([1e-3, 1e-5, 0.1, 1e-5, 1e-3, 0.2, 0.1, *[0.0] * 6, 0.1])


def problem_of(rig, *effects):
    return Problem.of(rig, segments(rig), effects=[Effect(name, {}) for name in effects], time_scale=TRUTH[3])


def test_a_free_run_is_predicted_as_it_is_and_lost_rows_cost_nothing(planted):
    rig = planted(2, stamped=True)
    marble = rig.recordings[0].marble.copy()
    marble[10:14] = np.nan
    rig = replace(rig, recordings=(replace(rig.recordings[0], marble=marble), rig.recordings[1]))
    (found,) = problem_of(rig).filter(TRUTH[None], NOISE[None])
    for predicted, variance, one in zip(found.predicted, found.variance, rig.recordings, strict=True):
        seen = np.isfinite(one.marble)
        np.testing.assert_allclose(predicted[seen], one.marble[seen], atol=1e-9)
        assert np.isnan(variance[0]).all()
        assert (variance[1:] > 0.0).all()
    assert (found.variance[0][13] > found.variance[0][9]).all()
    assert np.isfinite(found.log_likelihood).all()


def test_the_evidence_asks_for_the_effect_that_is_there_beside_a_random_push(planted):
    rig = planted(6, noise=1e-3, stamped=True, effects=[{"name": "delay", "delay_s": 0.12}])
    random = np.random.default_rng(5)
    pushed = tuple(
        replace(one, knobs=one.knobs + 0.004 * random.standard_normal(one.knobs.shape))
        for one in rig.recordings
    )
    rig = replace(rig, recordings=pushed)
    tops = {}
    for names, begin in [((), []), (("delay",), [0.02]), (("viscous_drag",), [0.05])]:
        values = np.array([[*TRUTH, *begin]] * 2)
        noise = np.array([NOISE, [*NOISE[:3], 1e-3, *NOISE[4:]]])
        found = problem_of(rig, *names).ascend(values, noise)
        tops[names] = max(found, key=lambda one: one.log_evidence)
    delay = tops[("delay",)]
    assert abs(delay.values[5] - 0.12) < 4.0 * delay.deviations[5]
    assert delay.deviations[5] < 0.02
    assert delay.log_evidence > tops[()].log_evidence + 10.0
    assert delay.log_evidence > tops[("viscous_drag",)].log_evidence + 10.0


def test_a_size_that_nothing_random_has_is_refused(planted):
    problem = problem_of(planted(1, stamped=True))
    with pytest.raises(IrtError, match="push: expected a number of at least 0"):
        problem.filter(TRUTH[None], np.array([[*NOISE[:3], -1.0, *NOISE[4:]]]))


def test_an_axis_that_never_moves_says_nothing(planted):
    rig = planted(4, noise=1e-3, stamped=True)
    still = [1.0, 0.0]
    runs = tuple(
        replace(one, marble=one.marble * still, knobs=one.knobs * still[::-1]) for one in rig.recordings
    )
    problem = problem_of(replace(rig, recordings=runs))
    (found,) = problem.filter(TRUTH[None], NOISE[None])
    assert np.abs(found.log_likelihood[:, 0]).min() > 0.0
    np.testing.assert_array_equal(found.log_likelihood[:, 1], 0.0)
    (top,) = problem.ascend(TRUTH[None], NOISE[None])
    assert np.hypot(*top.noise[:2]) == pytest.approx(1e-3, rel=0.3)


def test_without_a_fold_the_maximum_is_that_of_the_other_runs(planted):
    drag = {"name": "viscous_drag", "rate_per_s": 0.5}
    rig = planted(5, noise=1e-3, stamped=True, effects=[drag])
    folds = [0, 1, 1, 2, 0]
    values = np.array([*TRUTH, 0.4])
    # Without a push there is one maximum.
    noise = np.array([*NOISE[:3], 0.0, 0.0, 0.2, 0.02, *NOISE[7:]])
    (top,) = problem_of(rig, "viscous_drag").ascend(values[None], noise[None], iterations=60)
    found = problem_of(rig, "viscous_drag").leave_out(top.values, top.noise, top.states, folds, iterations=60)
    assert len(found) == 3
    for fold, one in enumerate(found):
        kept = [index for index, own in enumerate(folds) if own != fold]
        rest = replace(rig, recordings=tuple(rig.recordings[index] for index in kept))
        (other,) = problem_of(rest, "viscous_drag").ascend(
            top.values[None], top.noise[None], [top.states[kept]], iterations=60
        )
        free = other.deviations > 0.0
        np.testing.assert_array_less(np.abs(one.values - other.values)[free], 0.3 * other.deviations[free])
        assert one.log_likelihood == pytest.approx(other.log_likelihood, abs=0.2)
        assert np.abs(one.values - top.values)[5] > 0.0
