"""Distinct maxima of the likelihood, and the effects that show at each of them."""

from dataclasses import replace

import numpy as np
import pytest

from irt.diagnosis import config
from irt.diagnosis.hypotheses import hypotheses
from irt.diagnosis.maxima import distinct, promising, without_pull
from irt.diagnosis.score import PULL, PULL_S, Scores
from irt.diagnosis.screening import Screening
from irt.diagnosis.selection import Selection

BIAS = {"name": "tilt_bias", "bias_x_rad": 0.0015, "bias_y_rad": -0.001}
#: A field stronger than the drive, under which the five parameters have many maxima.
FIELD = {"name": "point_field", "x_m": 0.2, "y_m": -0.17, "strength_m3_per_s2": 0.0028}


def test_fits_that_reach_one_maximum_count_once(plant):
    scores = Scores(plant(runs=3))
    base = scores.base()
    values = np.tile(base.top.values, (3, 1)) * np.array([[1.0], [1.002], [0.998]])
    fits = scores.ascend((), values, np.tile(base.noise, (3, 1)), base.top.states, iterations=30)
    assert len(distinct(scores, [*fits, base])) == 1


def test_distinct_maxima_come_the_best_first_and_never_without_a_score(plant):
    scores = Scores(plant([FIELD], runs=3))
    base = scores.base()
    lost = replace(base, price=float("inf"))
    found = distinct(scores, [*scores.fits_of_base, lost])
    assert 1 < len(found) <= config.MAXIMA
    assert found[0] is base
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)
    shown = [promises[0].name for _, promises in promising(scores, ["point_field", "tilt_bias", "bump"], {})]
    assert len(shown) == len(set(shown))


@pytest.mark.slow
def test_a_lean_shows_once_no_slow_push_absorbs_it(plant):
    scores = Scores(plant([BIAS], runs=4))
    base = scores.base()
    noise = base.noise[None].copy()
    noise[:, [PULL, PULL_S]] = 0.02, 5.0
    (slow,) = scores.ascend((), base.top.values[None], noise, base.top.states, iterations=40)
    (hidden,) = Screening(scores, slow).promises(["tilt_bias"])
    still, (shown,) = without_pull(scores, slow, ["tilt_bias"])
    assert still.noise[PULL] == 0.0
    assert shown.gain > 2.0 * hidden.gain
    assert (shown.noise[:, [PULL, PULL_S]] == (config.PULL, config.PULL_S)).all()


@pytest.mark.slow
def test_effects_are_found_where_the_highest_maximum_hides_them(plant):
    """At the highest maximum of the five parameters, a point field gains 5 nats and all else nothing."""
    planted = [
        {"name": "camera_offset", "x_edges": -0.018, "y_edges": 0.092},
        {"name": "camera_rotation", "angle_rad": 0.158},
        {"name": "lens_distortion", "k_per_edge2": -0.19},
        {"name": "tilt_bias", "bias_x_rad": 0.002, "bias_y_rad": -0.0006},
    ]
    scores = Scores(plant(planted, runs=5, rows=100, pushed=0.1, seed=2))
    best = Selection(scores, hypotheses(), lambda _text: None).run().best
    assert {"camera_rotation", "tilt_bias"} <= set(best.effects)
    assert best.score > scores.base().score + 200.0
