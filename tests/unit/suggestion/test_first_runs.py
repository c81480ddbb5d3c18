"""The first runs respect the limits, cover every family, and identify the five parameters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.engine import rollouts
from irt.errors import IrtError
from irt.recording import save_recording
from irt.rig import load_rig
from irt.suggestion.first_runs import RUNS, first_runs
from irt.tuning import tune


@settings(max_examples=30)
@given(
    rows=st.integers(24, 600),
    runs=st.integers(1, 8),
    amplitude=st.floats(1e-3, 1e3),
    seed=st.integers(0, 2**32),
)
def test_runs_keep_their_limits(rows, runs, amplitude, seed):
    made = first_runs(rows, 0.05, runs=runs, amplitude=amplitude, seed=seed)
    assert len(made) == runs
    for one in made:
        assert one.commands.shape == (rows, 2)
        assert np.abs(one.commands).max() <= amplitude
        assert (np.ptp(one.commands, axis=0) > 0.0).all()
        np.testing.assert_array_equal(one.commands[0], 0.0)


def test_every_family_is_used_before_one_is_used_again():
    families = [one.family for one in first_runs(160, 0.05, runs=7)]
    assert families[:6] == [family for family, *_ in RUNS]
    assert families[6] == families[0]


def test_planted_parameters_are_recovered_from_them(tmp_path):
    truth = (0.05, 0.07, 4e-4, 12.0, 1.02)
    random = np.random.default_rng(0)
    stamps = np.arange(160) / 20
    for number, one in enumerate(first_runs(160, 0.05)):
        (path,) = rollouts([truth], one.commands)
        save_recording(
            tmp_path / f"run-{number}.csv", one.commands, path + 1e-3 * random.normal(size=(160, 2)), stamps
        )
    model = tune(load_rig(tmp_path), "least-squares").model
    # Gears and friction over the observation scale are what paths off the rim show.
    np.testing.assert_allclose(model.values[:2] * model.values[4], np.array(truth[:2]) * truth[4], rtol=0.01)
    np.testing.assert_allclose(model.values[3], truth[3], rtol=0.01)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rows": 23}, "at least 24 rows, found 23"),
        ({"runs": 0}, "runs: expected at least 1"),
        ({"amplitude": 0.0}, "amplitude: expected a number above 0"),
        ({"step_s": float("nan")}, "step_s: expected a number above 0"),
    ],
)
def test_impossible_runs_are_refused(options, message):
    with pytest.raises(IrtError, match=message):
        first_runs(**{"rows": 100, "step_s": 0.05, **options})
