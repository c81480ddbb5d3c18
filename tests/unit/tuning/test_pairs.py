import numpy as np
import pytest

from irt.tuning import pairs as pairs_module
from irt.tuning.pairs import simulate_pairs


def test_observations_belong_to_their_parameters(small_drive):
    pairs = simulate_pairs(small_drive, 20, seed=1)
    assert pairs.heldout == 2
    assert pairs.scaled.shape == (44, 5)
    assert pairs.inputs.shape == (44, small_drive.input_count)
    scaled = np.random.default_rng([1, 0]).random((44, 5))
    expected = small_drive.inputs(small_drive.simulate(small_drive.parameters(scaled)))
    np.testing.assert_allclose(pairs.scaled, scaled, rtol=1e-6)
    np.testing.assert_allclose(pairs.inputs, expected, rtol=1e-5, atol=1e-7)


def test_parameters_fill_their_ranges(small_drive):
    scaled = simulate_pairs(small_drive, 400, seed=0).scaled.numpy()
    assert scaled.min() >= 0.0
    assert scaled.max() < 1.0
    np.testing.assert_allclose(scaled.mean(axis=0), 0.5, atol=0.05)
    np.testing.assert_allclose(scaled.std(axis=0), 12**-0.5, atol=0.03)


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_the_seed_alone_decides(small_drive, monkeypatch, threads):
    reference = simulate_pairs(small_drive, 30, seed=5)
    monkeypatch.setattr(pairs_module, "_ROWS_AT_ONCE", 400)
    assert simulate_pairs(small_drive, 30, seed=5, threads=threads).digest == reference.digest
    assert simulate_pairs(small_drive, 30, seed=6, threads=threads).digest != reference.digest


def test_joint_observations_are_brought_to_the_size_of_one(small_drive):
    pairs = simulate_pairs(small_drive, 200, seed=0)
    assert float((pairs.gain * pairs.inputs[:400]).std()) == pytest.approx(1.0, rel=1e-3)


def test_the_time_scale_is_not_varied_with_stamps(stamped_drive):
    assert not simulate_pairs(stamped_drive, 10, seed=0).scaled[:, 3].any()


def test_progress_ends_at_the_total(small_drive):
    steps = []
    simulate_pairs(small_drive, 30, seed=0, progress=lambda *step: steps.append(step))
    assert steps[-1] == (66, 66, "simulating pairs")
