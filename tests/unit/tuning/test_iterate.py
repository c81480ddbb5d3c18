from dataclasses import dataclass, replace

import numpy as np
import pytest

from irt.tuning.iterate import STEP_DECAY, Tuner, without_spikes
from irt.tuning.outcome import noise_left


@dataclass
class Oracle:
    """Returns the true difference by a lookup of known simulations, in both orders alike."""

    inputs: np.ndarray
    scaled: np.ndarray

    def __call__(self, proposed, target):
        return self.find(target) - self.find(proposed)

    both_orders = __call__

    def find(self, observed):
        distances = np.abs(observed[:, None] - self.inputs).sum(axis=2)
        return self.scaled[distances.argmin(axis=1)]


@dataclass
class Constant:
    """Estimates a constant difference."""

    difference: tuple[float, ...]

    def __call__(self, proposed, target):
        return np.tile(self.difference, (len(proposed), 1))

    both_orders = __call__


def test_steps_decay_and_stop_at_the_ranges(small_drive):
    tuner = Tuner(small_drive, Constant((0.1, -0.2, 0.0, 0.9, 0.05)), joint=True)
    start = np.array([[0.2, 0.1, 0.3, 0.5, 0.4]])
    trace = tuner.iterate(start, [np.zeros((40, 2)), np.zeros((25, 2))], 4)
    assert trace.scaled.shape == (5, 1, 5)
    reached = 0.2 + 0.1 * np.cumsum(STEP_DECAY ** np.arange(4))
    np.testing.assert_allclose(trace.scaled[1:, 0, 0], reached, rtol=1e-6)
    assert trace.scaled[1:, 0, 1].tolist() == [0.0] * 4
    assert trace.scaled[1:, 0, 3].tolist() == [1.0] * 4
    np.testing.assert_allclose(trace.scaled[:, 0, 2], 0.3)


def test_a_network_that_knows_finds_the_target_in_one_step(small_drive):
    scaled = np.random.default_rng(0).random((2, 5))
    observed = small_drive.simulate(small_drive.parameters(scaled))
    oracle = Oracle(small_drive.inputs(observed), scaled)
    trace = Tuner(small_drive, oracle, joint=True).iterate(scaled[:1], [o[1] for o in observed], 1)
    np.testing.assert_allclose(trace.scaled[1, 0], scaled[1])
    assert trace.mae[0, 0] == pytest.approx(
        np.concatenate([np.abs(o[1] - o[0]).ravel() for o in observed]).mean()
    )
    assert trace.mae[1, 0] < 1e-6


def test_the_difference_is_the_mean_over_recordings_where_each_is_seen_by_itself(small_drive):
    class ByStart:
        """Sees from which run an observation is: the second one's starts off the centre."""

        def both_orders(self, proposed, target):
            return np.repeat(np.where(target[:, :1] == 0.0, 0.2, 0.4), 5, axis=1)

    same_length = replace(
        small_drive,
        runs=(small_drive.runs[0], replace(small_drive.runs[0], start=np.array([0.1, 0.0]))),
    )
    observed = [o[0] for o in same_length.simulate(np.array([[0.05, 0.05, 0.0, 10.0, 1.0]]))]
    trace = Tuner(same_length, ByStart(), joint=False).iterate(np.full((1, 5), 0.1), observed, 1)
    np.testing.assert_allclose(trace.scaled[1], 0.1 + 0.3, rtol=1e-6)


def test_a_stamped_time_scale_is_not_changed(stamped_drive):
    tuner = Tuner(stamped_drive, Constant((0.1,) * 5), joint=True)
    trace = tuner.iterate(np.full((2, 5), 0.5), [np.zeros((40, 2))], 2)
    assert not trace.scaled[..., 3].any()
    assert (trace.scaled[-1][:, [0, 1, 2, 4]] > 0.5).all()


def test_lost_rows_neither_count_nor_mislead(small_drive):
    """The network sees the target as if nothing were lost, where proposal and target differ smoothly."""
    seen = []

    class Witness(Constant):
        def both_orders(self, proposed, target):
            seen.append(target)
            return self(proposed, target)

    tuner = Tuner(small_drive, Witness((0.0,) * 5), joint=True)
    start = np.full((1, 5), 0.5)
    proposed = small_drive.simulate(small_drive.parameters(start))
    ramp = [np.linspace(0.0, 0.02, len(o[0]))[:, None] for o in proposed]
    whole = [o[0] + r for o, r in zip(proposed, ramp, strict=True)]
    holed = [o.copy() for o in whole]
    holed[0][[7, 8, 9, 30]] = np.nan
    for observed in (whole, holed):
        tuner.iterate(start, observed, 1)
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-6)
    error = tuner.iterate(start, holed, 0).mae[0, 0]
    kept = np.isfinite(np.concatenate([o[:, 0] for o in holed]))
    assert error == pytest.approx(np.concatenate(ramp)[kept].mean())


def test_where_marbles_move_the_error_is_what_no_start_state_takes_up(stamped_drive):
    tuner = Tuner(stamped_drive, Constant((0.0,) * 5), joint=True)
    start = np.full((1, 5), 0.5)
    observed = stamped_drive.simulate(stamped_drive.parameters(start))[0][0]
    line = 0.03 - 1e-3 * np.arange(40)[:, None]
    assert tuner.iterate(start, [observed + line], 0).mae[0, 0] < 1e-12


def test_noise_left_is_robust(small_drive):
    parameters = np.array([0.05, 0.04, 2e-4, 20.0, 1.0])
    random = np.random.default_rng(0)
    observed = [
        o[0] + 0.003 * random.standard_normal(o[0].shape) for o in small_drive.simulate(parameters[None])
    ]
    observed[0][::9] += 0.5
    assert noise_left(small_drive, parameters, observed) == pytest.approx(0.003, rel=0.35)


def test_spikes_are_taken_out_and_nothing_else():
    random = np.random.default_rng(1)
    time = np.linspace(0.0, 2.0 * np.pi, 100)
    clean = 0.3 * np.stack([np.sin(time), np.cos(time)], axis=1) + 0.002 * random.standard_normal((100, 2))
    clean[60:64] = np.nan
    spiked = clean.copy()
    spiked[[20, 45, 46, 80]] += [[0.2, 0.0], [0.0, -0.1], [-0.3, 0.1], [0.05, 0.05]]
    np.testing.assert_array_equal(without_spikes(clean), clean)
    lost = np.flatnonzero(np.isnan(without_spikes(spiked)[:, 0]))
    assert lost.tolist() == [20, 45, 46, 60, 61, 62, 63, 80]


def test_a_marble_that_meets_the_wall_makes_no_spike():
    fall = np.minimum(np.arange(50) * 0.02, 0.48)
    observed = np.stack([fall, np.zeros(50)], axis=1)
    np.testing.assert_array_equal(without_spikes(observed), observed)


def test_too_short_for_spikes():
    observed = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.0]])
    np.testing.assert_array_equal(without_spikes(observed), observed)
