"""The missing push of a set of effects, and the variables that it depends on."""

import numpy as np
import pytest

from irt.diagnosis.needed import VARIABLES, Needed, smoothed
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import Scores
from irt.engine import GRAVITY

WAVE = {"name": UNLISTED, "push_1_x_m_per_s2": 0.02, "wave_1_x_per_m": 100.0, "phase_1_rad": 0.5}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planted", "variable"),
    [
        ({"name": "viscous_drag", "rate_per_s": 0.8}, "velocity"),
        ({"name": "delay", "delay_s": 0.15}, "command rate"),
        ({"name": "cross_coupling", "x_from_y": 0.2, "y_from_x": -0.1}, "command"),
        (
            {
                "name": "board_warp",
                "curvature_xx_per_m": 0.05,
                "curvature_yy_per_m": -0.03,
                "curvature_xy_per_m": 0.0,
            },
            "position",
        ),
        (WAVE, "position"),
    ],
    ids=["drag", "delay", "coupling", "warp", "wave"],
)
def test_the_push_depends_on_what_was_left_out(plant, planted, variable):
    dataset = plant([planted], runs=6, rows=120, stamped=True)
    needed = Needed(Scores(dataset).base())
    first = needed.dependences[0]
    assert first.variable == variable
    assert first.p_value < 0.01
    assert 0.0 < first.share <= 1.0
    assert needed.repeating(0.01) >= first.share
    finding = needed.findings(0.01)[0]
    assert finding.what.endswith(f"depends on {VARIABLES[variable][0]}")
    assert finding.kind == VARIABLES[variable][1]
    assert finding.p_value == first.p_value


@pytest.mark.slow
def test_a_push_that_never_repeats_depends_on_nothing(plant):
    found = [
        Needed(Scores(plant(runs=4, seed=seed, stamped=True, pushed=0.1)).base()).p_value for seed in range(6)
    ]
    # By chance 1 of 20 p-values is below 0.05.
    assert sorted(found)[1] > 0.05
    assert min(found) > 0.0


@pytest.mark.slow
def test_the_push_of_a_table_that_is_not_level_is_found_in_every_row(plant):
    bias = 0.003
    level = {"name": "tilt_bias", "bias_x_rad": 0.0, "bias_y_rad": bias}
    one = Scores(plant([level], runs=4, rows=120, stamped=True)).base()
    found = smoothed(one)
    push, deviation = (np.concatenate(each)[:, 0] for each in (found.push, found.push_deviation))
    # At the rim a wall holds the marble, and shows no push.
    marble = np.concatenate([run.observed for run in one.dataset.runs])
    seen = np.isfinite(push) & (np.abs(marble) < [0.45, 0.37]).all(axis=1)
    wanted = 5.0 / 7.0 * GRAVITY * bias
    mean = np.average(push[seen], weights=deviation[seen] ** -2)
    assert 0.9 * wanted < mean < 1.1 * wanted
    assert (push[seen] > 0.0).mean() > 0.9
    assert (deviation[seen] > 0.0).all()
    assert all(np.isnan(each[0]).all() for each in found.push)
