"""The missing push of a set of effects, and the variables that it depends on."""

import numpy as np
import pytest

from irt.diagnosis.needed import VARIABLES, FreeRows, Needed, Regression, memory, smoothed, undisturbed
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


def _runs(push_of, rows=400, runs=6, memory=8.0):
    """Return free rows of marbles that leave the rim every 100 rows, commanded away from it, under a push."""
    random = np.random.default_rng(0)
    for _ in range(runs):
        since = np.arange(rows) % 100
        side = np.repeat(random.choice([-1.0, 1.0], rows // 100), 100)
        command = np.stack([-side, np.zeros(rows)], axis=1) + 0.5 * random.standard_normal((rows, 2))
        noise = np.zeros((rows, 2))
        for row in range(1, rows):
            noise[row] = np.exp(-1.0 / memory) * noise[row - 1] + 0.02 * random.standard_normal(2)
        left = np.stack([-side * np.exp(-since / memory), np.zeros(rows)], axis=1)
        variables = {name: random.standard_normal((rows, 2)) for name in VARIABLES}
        distance = np.minimum(since, 100 - since).astype(float)
        yield FreeRows(noise + push_of(left, command), {**variables, "command": command}, distance)


def test_a_push_that_follows_impacts_depends_on_nothing_where_none_disturbs():
    parts = list(_runs(lambda left, _: left))
    pushes = [one.push for one in parts]
    every, quiet = Regression(parts, 0), Regression(list(undisturbed(parts, pushes)), 0)
    (found,) = [one for one in every.dependences() if one.variable == "command"]
    assert found.p_value < 0.01
    assert all(one.p_value > 0.01 for one in quiet.dependences())
    assert 4 <= memory(pushes) <= 16


def test_a_push_by_the_command_is_found_between_impacts():
    parts = list(_runs(lambda left, command: left + 0.1 * command))
    found = Regression(list(undisturbed(parts, [one.push for one in parts])), 0).dependences()
    assert found[0].variable == "command"
    assert found[0].p_value < 0.01
    assert found[0].share > 0.3


def test_without_rows_far_from_the_rim_nothing_is_undisturbed():
    parts = [FreeRows(one.push, one.against, np.ones(400)) for one in _runs(lambda left, _: left)]
    assert not list(undisturbed(parts, [one.push for one in parts]))
    assert not Regression([], 0).dependences()
