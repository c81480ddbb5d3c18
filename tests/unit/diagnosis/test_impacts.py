"""What counts as seen between impacts."""

import numpy as np
import pytest

from irt.catalogue import hypothetical
from irt.diagnosis.hypotheses import acts_on_impacts_alone
from irt.diagnosis.impacts import between_impacts, shows

TRUTH = np.array([0.06, 0.05, 4e-4, 15.0, 1.03])
DRAG = {"name": "viscous_drag", "rate_per_s": 0.4}
REBOUND = {"name": "wall_restitution", "increase": 0.6}


def refined(case, names, values):
    return case.refine(names, np.array([*TRUTH, *values])[None])[0]


def test_how_and_where_a_marble_is_thrown_back_shows_in_impacts_alone():
    found = {one.name for one in hypothetical() if acts_on_impacts_alone(one.name)}
    assert found == {"wall_restitution", "camera_offset"}


def test_stretches_keep_away_from_the_rim(plant):
    case = plant(runs=6, rows=120)
    base = refined(case, [], [])
    between = between_impacts(case, base)
    reach = case.model(base).reach
    kept = sum(len(one.knobs) for one in between.segments)
    assert 0 < kept < sum(len(one.knobs) for one in case.segments)
    for segment, fold in zip(between.segments, between.folds, strict=True):
        assert (np.abs(segment.observed) < reach).all()
        whole = case.segments[list(case.folds).index(fold)]
        stop = segment.first_row + len(segment.knobs)
        np.testing.assert_array_equal(segment.observed, whole.observed[segment.first_row : stop])
        np.testing.assert_array_equal(segment.knobs, whole.knobs[segment.first_row : stop])


@pytest.mark.parametrize("seed", range(6))
def test_start_states_of_stretches_are_found(plant, seed):
    case = plant(runs=6, rows=120, seed=seed)
    between = between_impacts(case, refined(case, [], []))
    (told,) = between.judge([], TRUTH[None])
    for residual in told.residuals:
        assert np.sqrt(np.nanmean(residual**2)) < 2.0 * case.noise


def test_what_is_there_shows(plant):
    case = plant([DRAG])
    base, drag = refined(case, [], []), refined(case, ["viscous_drag"], [0.3])
    assert shows(between_impacts(case, base), drag, base)


def test_what_is_not_there_does_not(plant):
    case = plant()
    base = refined(case, [], [])
    for name, values in (("viscous_drag", [0.01]), ("tilt_bias", [1e-5, 1e-5])):
        assert not shows(between_impacts(case, base), refined(case, [name], values), base)


def test_a_rebound_must_be_larger_than_what_engines_differ_by(plant):
    case = plant([REBOUND], runs=6, rows=120)
    between = between_impacts(case, refined(case, [], []))
    base = refined(case, [], [])
    assert shows(between, refined(case, ["wall_restitution"], [0.6]), base)
    (small,) = case.judge(["wall_restitution"], np.array([*TRUTH, 0.05])[None])
    assert not shows(between, small, base)


def test_a_shifted_picture_shows_by_where_the_rim_is(plant):
    case = plant([{"name": "camera_offset", "x_edges": 0.01, "y_edges": 0.0}], runs=6, rows=120)
    base = refined(case, [], [])
    assert shows(between_impacts(case, base), refined(case, ["camera_offset"], [0.01, 0.0]), base)


def test_nothing_shows_where_the_marble_never_leaves_the_rim(plant):
    case = plant()
    base = refined(case, [], [])
    at_rim = case.only([])
    assert not shows(at_rim, refined(case, ["viscous_drag"], [0.01]), base)
