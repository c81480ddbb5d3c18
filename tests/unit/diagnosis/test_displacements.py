"""Residuals in free motion are weighted by the noise that the filter estimates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.diagnosis.displacements import Displacements, row_variances
from irt.diagnosis.free_motion import Rows, integrator
from irt.diagnosis.score import SCALE_OF_NORMAL, with_less_push

ROW_S, EDGE_M = 0.06, 0.276
LENGTHS = (40, 25, 60)
#: Tracker noise [board edges], density of the white push [m^2/s^3], correlated push [m/s^2] and its time [s].
TRACKER, PUSH, PULL, PULL_S = 1e-3, 1e-5, 5e-3, 0.3
NOISE = np.array([TRACKER * SCALE_OF_NORMAL, 1e-6, 0.1, PUSH, PULL, PULL_S, 0.0, 0.0, 0.0, 0.0, 0.3])


def rows():
    stretch = np.repeat(np.arange(len(LENGTHS)), LENGTHS)
    time = np.concatenate([np.arange(one, dtype=float) for one in LENGTHS])
    empty = np.zeros((len(stretch), 2))
    return Rows(empty, empty, empty, np.zeros((len(stretch), 10, 2)), time, stretch, stretch)


def moved(pushes):
    """Return the displacements by pushes [m/s^2] from rest, segment by segment [board edges]."""
    ends = np.cumsum(LENGTHS)
    parts = [
        ROW_S**2 / EDGE_M * integrator(size) @ pushes[end - size : end]
        for size, end in zip(LENGTHS, ends, strict=True)
    ]
    return np.concatenate(parts)


def free(seed, push=0.0):
    """Return segments with random pushes, tracker noise and start states, and an (n,) `push` along x."""
    random, segments = np.random.default_rng(seed), rows()
    count = len(segments.time)
    fading = np.exp(-ROW_S / PULL_S)
    lasting = PULL * random.standard_normal((count, 2))
    for row in range(1, count):
        if segments.time[row] > 0.0:
            lasting[row] = fading * lasting[row - 1] + np.sqrt(1.0 - fading**2) * lasting[row]
    pushes = np.sqrt(PUSH / ROW_S) * random.standard_normal((count, 2)) + lasting
    pushes[:, 0] += push
    starts = [(segments.stretch == one).astype(float) for one in range(len(LENGTHS))]
    starts += [one * segments.time for one in starts]
    fixed = np.linalg.qr(np.column_stack(starts))[0]
    residuals = (
        moved(pushes) + TRACKER * random.standard_normal((count, 2)) + 0.1 * fixed.sum(axis=1)[:, None]
    )
    return segments, residuals, [fixed, fixed]


def displacements(segments, noise=NOISE):
    return Displacements(segments, noise, np.full((len(segments[0].time), 2), TRACKER**2), ROW_S, EDGE_M)


def test_residuals_have_unit_variance_without_start_states():
    totals = [displacements(free(seed)).total for seed in range(40)]
    degrees = 2 * (sum(LENGTHS) - 2 * len(LENGTHS))
    # The mean of 40 chi-squared numbers, within four standard deviations.
    assert np.mean(totals) == pytest.approx(degrees, abs=4.0 * np.sqrt(2.0 * degrees / 40))


def test_the_likeliest_push_is_the_one_that_acts():
    shares = (100.0, 1.0, 0.01)
    likelihoods = np.array(
        [
            [displacements(free(seed), with_less_push(NOISE, share)).log_likelihood for share in shares]
            for seed in range(20)
        ]
    ).mean(axis=0)
    assert likelihoods.argmax() == 1


def test_the_strength_of_a_push_is_known_as_well_as_it_says():
    """A wave of known shape is fitted within its standard deviation, beside a random push."""
    wave, strength = np.sin(1.3 * rows().time), 0.01
    errors = []
    for seed in range(40):
        found = displacements(free(seed, strength * wave))
        information = found.information(0, [wave[:, None]])[0, 0, 0]
        fitted = found.products(0, [wave[:, None]])[0, 0] / information
        errors.append((fitted - strength) * np.sqrt(information))
    assert np.abs(np.mean(errors)) < 4.0 / np.sqrt(40)
    assert np.std(errors) == pytest.approx(1.0, abs=4.0 / np.sqrt(80))


def test_what_is_explained_is_gone_at_any_strength():
    wave = np.sin(1.3 * rows().time)
    pushes = np.stack([wave, wave], axis=-1)[:, None]
    weak, strong = (displacements(free(0, strength * wave)) for strength in (0.0, 1.0))
    assert strong.total > 10.0 * weak.total
    for one in (weak, strong):
        one.explain(pushes)
    assert strong.total == pytest.approx(weak.total, rel=1e-6)
    assert strong.information(0, [wave[:, None]]) == 0.0


@given(seed=st.integers(0, 10_000), shares=st.tuples(*[st.floats(0.0, 1.0)] * 2))
def test_less_random_push_never_takes_information_away(seed, shares):
    """With this bound a search leaves pushes out that cannot win."""
    random = np.random.default_rng(seed)
    parts = list(random.standard_normal((2, len(rows().time), 3)))
    small, large = (
        displacements(free(seed), with_less_push(NOISE, share)).information(0, parts)
        for share in sorted(shares)
    )
    least = np.linalg.eigvalsh(small - large).min(axis=1)
    assert (least > -1e-9 * np.trace(large, axis1=1, axis2=2)).all()


def test_parts_of_a_push_do_not_depend_on_the_others_tried():
    """Pushes are displaced in blocks; each has the information of its own."""
    random = np.random.default_rng(0)
    pushes = random.standard_normal((len(rows().time), 150))
    found = displacements(free(0))
    alone = np.array([found.information(0, [pushes[:, [one]]])[0] for one in (0, 63, 64, 149)])
    assert found.information(0, [pushes])[[0, 63, 64, 149]] == pytest.approx(alone, rel=1e-9)


def test_outliers_of_the_tracker_get_variances_of_their_own():
    segments, residuals, fixed = free(0)
    residuals[[10, 70], [0, 1]] += 30.0 * TRACKER
    variances = row_variances((segments, residuals, fixed), NOISE, ROW_S, EDGE_M)
    assert variances[10, 0] > 50.0 * TRACKER**2
    assert variances[70, 1] > 50.0 * TRACKER**2
    assert np.median(variances) == pytest.approx(TRACKER**2, rel=0.5)
