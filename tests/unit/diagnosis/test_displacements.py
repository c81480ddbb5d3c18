"""Residuals in free motion are weighted by the noise that the filter estimates."""

import numpy as np
import pytest

from irt.diagnosis.displacements import Displacements, row_variances
from irt.diagnosis.free_motion import Rows, integrator
from irt.diagnosis.score import SCALE_OF_NORMAL, with_less_push

ROW_S, EDGE_M = 0.06, 0.276
LENGTHS = (40, 25, 60)
#: Tracker noise [board edges], density of the white push [m^2/s^3], correlated push [m/s^2] and its time [s].
TRACKER, PUSH, PULL, PULL_S = 1e-3, 1e-5, 5e-3, 0.3
NOISE = np.array([TRACKER * SCALE_OF_NORMAL, 1e-6, 0.1, PUSH, PULL, PULL_S, 0.0, 0.0, 0.0, 0.3])


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
        along = found.moved(0, wave[:, None])[:, 0]
        information = along @ along
        errors.append((along @ found.residual(0) / information - strength) * np.sqrt(information))
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
    assert np.abs(strong.moved(0, wave[:, None])).max() < 1e-6


def test_outliers_of_the_tracker_get_variances_of_their_own():
    segments, residuals, fixed = free(0)
    residuals[[10, 70], [0, 1]] += 30.0 * TRACKER
    variances = row_variances((segments, residuals, fixed), NOISE, ROW_S, EDGE_M)
    assert variances[10, 0] > 50.0 * TRACKER**2
    assert variances[70, 1] > 50.0 * TRACKER**2
    assert np.median(variances) == pytest.approx(TRACKER**2, rel=0.5)
