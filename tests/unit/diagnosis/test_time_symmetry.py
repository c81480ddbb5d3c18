"""Without stamps, paths in slower and faster time are the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.diagnosis.score import Scores
from irt.diagnosis.time_symmetry import into_ranges

NAMES = (
    "gear_x",
    "gear_y",
    "rolling_friction",
    "time_scale",
    "observation_scale",
    "delay.delay_s",
    "viscous_drag.rate_per_s",
)
NOISE = np.array([[8e-4, 5e-4, 0.2, 1e-6, 3e-3, 0.2, 0.1, 0.0, 0.01, 0.3]])


@pytest.mark.parametrize("effects", [(), ("viscous_drag",)])
def test_starts_beyond_the_ranges_are_as_likely_inside(plant, effects):
    dataset = plant([{"name": "viscous_drag", "rate_per_s": 0.8}], runs=2)
    problem = Scores(dataset).problem(effects)
    # Substeps are a part of a row: fewer are coarser.
    values = np.array([[0.2, 0.16, 1.2e-3, 9.0, 1.0, 1e-3, 1e-4, *[1.2] * len(effects)]])
    moved, noise = into_ranges(dataset, problem.names, values, NOISE)
    ends = [dataset.rig.ranges[name][1] for name in NAMES[:3]]
    assert (moved[0, :3] <= np.multiply(ends, 1.0 + 1e-9)).all()
    assert moved[0, 3] > 9.0
    before, after = (
        problem.filter(at, sizes)[0].log_likelihood.sum() for at, sizes in ((values, NOISE), (moved, noise))
    )
    fixed = problem.filter(moved * np.where(np.arange(values.shape[1]) == 3, 9.0 / moved[0, 3], 1.0), NOISE)
    assert abs(after - before) < 0.02 * abs(fixed[0].log_likelihood.sum() - before)


def test_with_stamps_starts_stay(plant):
    dataset = plant(runs=2, stamped=True)
    values = np.array([[1.0, 1.0, 1.0, 9.0, 1.0, 0.01, 1.0]])
    moved, noise = into_ranges(dataset, NAMES, values, NOISE)
    assert moved is values
    assert noise is NOISE


@settings(max_examples=50)
@given(gears=st.floats(1e-3, 10.0), scale=st.floats(1.0, 49.0))
def test_starts_are_moved_no_further_than_needed(plant, gears, scale):
    dataset = plant(runs=2)
    values = np.array([[gears, -gears / 2.0, 1e-5, scale, 1.0, 0.01, 0.5]])
    moved, _ = into_ranges(dataset, NAMES, values, NOISE)
    again, _ = into_ranges(dataset, NAMES, moved, NOISE)
    assert again == pytest.approx(moved)
    low, high = dataset.rig.ranges["time_scale"]
    assert low <= moved[0, 3] <= max(high, scale) * (1.0 + 1e-9)
    if gears <= dataset.rig.ranges["gear_x"][1]:
        assert moved == pytest.approx(values)
    assert moved[0, 0] * moved[0, 3] ** 2 == pytest.approx(gears * scale**2)
    assert moved[0, 5:] * moved[0, 3] ** np.array([-1.0, 1.0]) == pytest.approx(
        values[0, 5:] * scale ** np.array([-1.0, 1.0])
    )
