"""What stretches between impacts ask for beside a hypothesis."""

import pytest

from irt.diagnose.impacts import between_impacts
from irt.diagnose.partners import likeliest_partner, seeds

BIAS = {"name": "tilt_bias", "bias_x_rad": 0.0004, "bias_y_rad": -0.0003}
LAG = {"name": "lag", "time_constant_s": 0.4}


def said(_text: str) -> None:
    """Keep quiet."""


@pytest.mark.parametrize("known", [LAG, BIAS])
def test_the_effect_that_a_hypothesis_lacks_is_found_between_impacts(plant, known):
    case = plant([LAG, BIAS], runs=5)
    parent = case.fit([known["name"]])
    found = likeliest_partner(between_impacts(case, case.fit()), parent, case.noise, said)
    assert found is not None
    assert set(found.effects) == {"lag", "tilt_bias"}, found


def test_a_hypothesis_that_lacks_nothing_gets_no_partner(plant):
    case = plant([LAG], runs=5)
    parent = case.fit(["lag"])
    assert likeliest_partner(between_impacts(case, case.fit()), parent, case.noise, said) is None


def test_seeds_begin_where_the_hypothesis_led(plant):
    case = plant([BIAS])
    base = case.fit(starts=2, rounds=1)
    explained, points = seeds(case, base, ["tilt_bias"], said)["tilt_bias"]
    assert 0.3 < explained <= 1.0
    assert points[:, :5] == pytest.approx(base.values[None].repeat(len(points), axis=0))
