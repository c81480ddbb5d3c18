"""A held-out recording does not influence the fit that predicts it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from irt.diagnosis.score import Scores
from irt.diagnosis.validation import Validation, skill
from irt.residual import evaluate
from irt.rig import PARAMETERS
from irt.segments import segments

#: gear_x, gear_y, rolling_friction, time_scale, observation_scale.
TRUTH = (0.06, 0.05, 4e-4, 15.0, 1.03)
DRAG = {"name": "viscous_drag", "rate_per_s": 0.8}


def fitted(dataset):
    """Return the planted drag, fitted to all recordings."""
    scores = Scores(dataset)
    base = scores.base()
    begin = np.append(base.top.values, 0.5)[None]
    (found,) = scores.ascend(("viscous_drag",), begin, base.noise[None], base.top.states, iterations=25)
    return found


def with_marble(one, index, marble):
    """Return a set in a dataset where one recording has other marble positions."""
    runs = list(one.dataset.rig.recordings)
    runs[index] = replace(runs[index], marble=marble)
    rig = replace(one.dataset.rig, recordings=tuple(runs))
    whole = tuple(segments(rig))
    return replace(one, dataset=replace(one.dataset, rig=rig, segments=whole, runs=whole))


@pytest.mark.parametrize("free", [False, True], ids=["filter", "free runs"])
@pytest.mark.parametrize("stamped", [True, False])
def test_what_was_seen_of_a_recording_has_no_part_in_the_fit_that_predicts_it(plant, free, stamped):
    one = fitted(plant([DRAG], runs=3, rows=60, stamped=stamped))
    one = Scores.of(one).freed(one) if free else one
    marble = one.dataset.rig.recordings[1].marble
    elsewhere = marble.copy()
    elsewhere[1:] += np.linspace(0.0, 0.03, len(marble) - 1)[:, None]
    before, after = (Validation().of(each) for each in (one, with_marble(one, 1, elsewhere)))
    np.testing.assert_array_equal(before.values[1], after.values[1])
    np.testing.assert_array_equal(before.runs[1].prediction, after.runs[1].prediction)
    assert after.runs[1].mae > 3.0 * before.runs[1].mae
    # The other fits include it.
    assert not np.array_equal(before.values[0], after.values[0])
    assert not np.array_equal(before.values[2], after.values[2])


@pytest.mark.slow
def test_windows_of_held_out_recordings_agree_on_an_effect_that_acts_and_on_no_other(plant):
    dataset = plant([{**DRAG, "rate_per_s": 4.0}], runs=4, rows=120, stamped=True)
    with_drag, base = fitted(dataset), Scores(dataset).base()
    validation = Validation()
    assert validation.windows_agree(with_drag, base)
    assert not validation.windows_agree(base, with_drag)
    assert not validation.windows_agree(base, base)
    assert validation.each_is_likelier(with_drag, base)
    assert not validation.each_is_likelier(base, base)
    for one in (with_drag, base):
        held = validation.of(one)
        windows = np.split(held.errors_of_windows, len(held.runs))
        # The last window of a recording is shorter.
        assert [w.mean() for w in windows] == pytest.approx(held.windowed_errors, rel=0.3)


@given(st.floats(-1.0, 1.0), st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_skill_is_the_share_of_the_motion_that_is_predicted(share, seed, windows):
    random = np.random.default_rng(seed)
    seen = random.standard_normal((40, 2)).cumsum(axis=0)
    firsts = np.linspace(0, 40, windows, endpoint=False).astype(int).tolist()
    began = np.array([max(max(first for first in firsts if first <= row) - 1, 0) for row in range(40)])
    predicted = seen[began] + share * (seen - seen[began])
    lost = random.random(40) < 0.2
    lost[began] = False
    seen[lost] = np.nan
    assert skill([seen], [(predicted, firsts)]) == pytest.approx(share)


def test_skill_is_that_of_all_recordings_and_needs_motion():
    still, moving = np.zeros((9, 2)), np.arange(18.0).reshape(9, 2)
    assert skill([still, moving], [(still, [0]), (moving, [0])]) == 1.0
    assert skill([still], [(still + 1.0, [0])]) == -np.inf
    assert skill([moving], [(np.full((9, 2), np.nan), [0])]) == -np.inf


@pytest.mark.slow
def test_recordings_held_out_are_predicted_as_well_as_noise_allows(plant):
    one = fitted(plant([DRAG], runs=5, stamped=True))
    held = Validation().of(one)
    assert held.is_proof
    assert held.values.shape == (5, len(one.names))
    # The tracker's errors in a row and in the start.
    assert held.mae < 2.0 * np.sqrt(2.0 / np.pi) * one.dataset.noise
    base = Validation().of(Scores(one.dataset).base())
    assert base.mae > 2.0 * held.mae


@pytest.mark.slow
def test_a_recording_in_motion_is_about_as_likely_held_out_as_fitted(plant, in_motion):
    """The start state of a recording is no part of the fit to others, and need not be known for the rest."""
    held = Validation().of(fitted(in_motion(plant([DRAG], runs=4, rows=120, stamped=True), 20)))
    # Each fitted value makes it likelier by half a nat on average; there are seven.
    assert (held.fitted - held.predictive < 12.0).all()
    assert (held.fitted - held.predictive).sum() > 0.0


def test_of_one_recording_nothing_is_held_out(plant):
    held = Validation().of(fitted(plant([DRAG], runs=1, stamped=True)))
    assert not held.is_proof
    assert len(held.values) == 0
    assert len(held.runs) == 1


def test_a_set_is_fitted_once(plant):
    one, validation = fitted(plant([DRAG], runs=2, rows=40, stamped=True)), Validation()
    assert validation.of(one) is validation.of(one)


@pytest.mark.slow
def test_a_set_is_better_where_the_recordings_agree(plant):
    one = fitted(plant([DRAG], runs=4, rows=60, stamped=True))
    base = Scores(one.dataset).base()
    validation = Validation()
    assert validation.is_better(one, base)
    assert not validation.is_better(base, one)
    assert not validation.is_better(one, one)
    alone = fitted(plant([DRAG], runs=1, rows=60, stamped=True))
    assert not validation.is_better(alone, Scores(alone.dataset).base())


@pytest.fixture
def agreed(monkeypatch):
    """Whether recordings with these errors agree that the first predicts better."""

    def agreed(errors, of_other):
        held = {"one": SimpleNamespace(errors=np.array(errors)), "other": SimpleNamespace(errors=of_other)}
        monkeypatch.setattr(Validation, "of", lambda _, name: held[name])
        return Validation().runs_agree("one", "other")

    return agreed


def test_recordings_of_unequal_drives_agree_by_the_ratios_of_their_errors(agreed):
    """All errors are several times smaller, but the differences vary by more than their mean."""
    assert agreed([0.0015, 0.0013, 0.0009, 0.0093, 0.0012], np.array([0.028, 0.012, 0.009, 0.088, 0.004]))
    assert not agreed([0.0015, 0.0013, 0.0009], np.array([0.0013, 0.0015, 0.0009]))


@given(
    errors=st.lists(st.floats(1e-3, 1e-1), min_size=3, max_size=8),
    ratio=st.floats(1.1, 2.0),
    seed=st.integers(0, 1000),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_how_large_the_errors_of_a_recording_are_decides_nothing(agreed, errors, ratio, seed):
    random = np.random.default_rng(seed)
    less, more = np.array(errors), ratio * np.array(errors) * np.exp(random.normal(0.0, 0.3, len(errors)))
    drives = np.exp(random.normal(0.0, 2.0, len(errors)))
    assert agreed(less, more) == agreed(drives * less, drives * more)
    assert not (agreed(less, more) and agreed(more, less))


@pytest.mark.slow
def test_held_out_recordings_are_likelier_with_what_acts(plant):
    one = fitted(plant([DRAG], runs=4, rows=80, stamped=True))
    base = Scores(one.dataset).base()
    validation = Validation()
    assert validation.is_likelier(one, base)
    assert not validation.is_likelier(base, one)
    assert not validation.is_likelier(one, one)
    assert validation.is_likelier(Scores.of(one).freed(one), base)
    assert validation.difference(one, base) > one.dataset.noise
    assert validation.difference(one, one) == 0.0
    alone = fitted(plant([DRAG], runs=1, rows=60, stamped=True))
    assert not validation.is_likelier(alone, Scores(alone.dataset).base())


@pytest.mark.parametrize("stamped", [True, False])
def test_models_with_other_time_scales_are_compared_in_the_same_windows(plant, stamped):
    dataset = plant(runs=2, stamped=stamped)
    models = [
        dataset.model((), {**dict(zip(PARAMETERS, TRUTH, strict=True)), "time_scale": scale})
        for scale in (TRUTH[3], 2.0 * TRUTH[3])
    ]
    first, second = (
        evaluate(model, dataset.rig.recordings, dataset.horizon_s(model)).runs[0].window_rows
        for model in models
    )
    np.testing.assert_array_equal(first, second)
    # A second has 16 rows by the stamps, and 240 / 25 in the middle of the range of time scales.
    assert first[1] - first[0] == (16 if stamped else 10)


@pytest.mark.slow
def test_a_recording_that_the_rim_throws_apart_is_as_likely_held_out(plant):
    """At values fitted to the others the first one is 300 nats less likely with the drag than without."""
    one = fitted(plant([{**DRAG, "rate_per_s": 0.2}], runs=4, rows=240, seed=3, stamped=True))
    here, other = (Validation().of(each) for each in (one, Scores(one.dataset).base()))
    assert (here.predictive - other.predictive > 0.5 * (here.fitted - other.fitted)).all()


class RefittedElsewhere(Validation):
    """A validation in which the fits of the five parameters without a recording end far from the best."""

    def of(self, one):
        found = super().of(one)
        if one.effects:
            return found
        moved = [replace(fit.top, log_evidence=fit.top.log_evidence + 500.0) for fit in found.fits]
        fits = tuple(replace(fit, top=top) for fit, top in zip(found.fits, moved, strict=True))
        return replace(found, fits=fits)


@pytest.mark.slow
def test_no_recording_gains_by_the_refits_of_the_other_set(plant):
    one = fitted(plant([DRAG], runs=4, rows=60, stamped=True))
    base = Scores(one.dataset).base()
    whole = Validation().of(one).fitted - Validation().of(base).fitted
    elsewhere = RefittedElsewhere()
    lost = elsewhere.of(one).predictive - elsewhere.of(base).predictive
    assert lost.sum() > 2.0 * whole.sum()
    assert (elsewhere.likelihood_gains(one, base) <= whole).all()
