"""Residuals of a fit in short windows, compared with noise."""

import numpy as np
import pytest

from irt.diagnosis.windows import Windows

PARALLAX = {"name": "parallax", "height_m_per_rad": 0.4}


def misfit(dataset):
    """Return the sum of squared residuals, and the range of that of nulls."""
    misfits, nulls = Windows(dataset.fit()).squared(99, 0, dataset.noise)
    return misfits.sum(), nulls.sum(axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_noise_leaves_what_noise_does(plant, seed):
    misfits, nulls = misfit(plant(seed=seed))
    assert misfits == pytest.approx(nulls.mean(), rel=0.25)


def test_what_a_model_lacks_leaves_more_than_noise_ever_does(plant):
    misfits, nulls = misfit(plant([PARALLAX], runs=6))
    assert misfits > 1.2 * nulls.max()


def test_windows_are_cut_from_the_recordings(plant):
    dataset = plant(rows=80)
    windows = Windows(dataset.fit(), 20).windows()
    assert len(windows) == 4 * 4
    for one in windows:
        recording = dataset.rig.recordings[one.run]
        own = slice(one.first, one.first + 20)
        np.testing.assert_array_equal(one.knobs, recording.knobs[own])
        np.testing.assert_allclose(one.place + one.residual, recording.marble[own], atol=1e-12)
        np.testing.assert_array_equal(one.turned[:, 0], one.turn)
        # Histories of successive rows overlap.
        np.testing.assert_array_equal(one.turned[1:, 1], one.turned[:-1, 0])


def test_the_same_seed_makes_the_same_nulls(plant):
    dataset = plant(runs=2)
    windows = Windows(dataset.fit())
    first, second = (windows.squared(5, 3, dataset.noise)[1] for _ in range(2))
    np.testing.assert_array_equal(first, second)
