"""Without stamps, paths in slower and faster time are the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.diagnosis.time_symmetry import off_bounds
from irt.engine import rollouts

NAMES = (
    "gear_x",
    "gear_y",
    "rolling_friction",
    "time_scale",
    "observation_scale",
    "delay.delay_s",
    "viscous_drag.rate_per_s",
)
NOISE = np.array([[8e-4, 5e-4, 0.2, 1e-6, 3e-3, 0.2, 0.1, 0.0, 0.01, 0.01, 0.0, 0.0, 0.0, 0.3]])


def test_a_start_at_a_bound_has_the_same_path_inside(plant):
    dataset = plant(runs=2)
    values = np.array([[0.375, 0.3125, 2.5e-3, 12.0, 1.03, 0.05, 0.5]])
    moved, noise = off_bounds(dataset, NAMES, values, NOISE)
    ends = [dataset.rig.ranges[name][1] for name in NAMES[:3]]
    assert (moved[0, :3] <= np.multiply(ends, 1.0 + 1e-9)).all()
    assert moved[0, 3] > 12.0
    knobs = 0.01 * np.sin(np.arange(60)[:, None] / [9.0, 13.0])

    def path(row, rate):
        effects = [{"name": "delay", "delay_s": row[5]}, {"name": "viscous_drag", "rate_per_s": rate}]
        return rollouts(row[None, :5], knobs, effects=effects)[0]

    before = path(values[0], values[0, 6])
    apart = np.abs(path(moved[0], moved[0, 6]) - before).max()
    assert apart < 0.03 * np.abs(before - before[0]).max()
    assert np.abs(path(moved[0], values[0, 6]) - before).max() > 3.0 * apart
    # A push in m^2/s^3 that displaces as much in slower time is smaller.
    slower = moved[0, 3] / values[0, 3]
    assert noise[0, 3] == pytest.approx(NOISE[0, 3] / slower**3)


def test_with_stamps_starts_stay(plant):
    dataset = plant(runs=2, stamped=True)
    values = np.array([[1.0, 1.0, 1.0, 9.0, 1.0, 0.01, 1.0]])
    moved, noise = off_bounds(dataset, NAMES, values, NOISE)
    assert moved is values
    assert noise is NOISE


@settings(max_examples=50)
@given(gears=st.floats(1e-3, 10.0), scale=st.floats(1.0, 49.0))
def test_starts_at_a_bound_are_moved_no_further_than_into_the_ranges(plant, gears, scale):
    dataset = plant(runs=2)
    values = np.array([[gears, -gears / 2.0, 1e-5, scale, 1.0, 0.01, 0.5]])
    moved, _ = off_bounds(dataset, NAMES, values, NOISE)
    again, _ = off_bounds(dataset, NAMES, moved, NOISE)
    assert again == pytest.approx(moved)
    low, high = dataset.rig.ranges["time_scale"]
    assert low <= moved[0, 3] <= max(high, scale) * (1.0 + 1e-9)
    if gears < 2.9 * dataset.rig.ranges["gear_x"][1]:
        assert moved == pytest.approx(values)
    assert moved[0, 0] * moved[0, 3] ** 2 == pytest.approx(gears * scale**2)
    assert moved[0, 5:] * moved[0, 3] ** np.array([-1.0, 1.0]) == pytest.approx(
        values[0, 5:] * scale ** np.array([-1.0, 1.0])
    )
