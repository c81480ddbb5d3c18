"""Locating the residuals of the base model."""

from irt.diagnosis.locate import locate


def found_in(case):
    base = case.fit()
    return locate(base, min(base.noise, 1.1 * case.noise))


def test_noise_is_hardly_ever_anywhere(plant):
    found = [found_in(plant(runs=6, seed=seed)) for seed in range(1, 6)]
    assert sum(bool(one) for one in found) <= 1


def test_a_bump_is_a_region(plant):
    bump = {"name": "bump", "x_m": 0.0, "y_m": 0.0, "height_m": 4e-4, "width_m": 0.02}
    case = plant([bump], runs=6)
    regions = [one for one in found_in(case) if one.kind == "region"]
    assert regions[0].what == "the middle of the board"
    assert 0.0 < regions[0].strength <= 1.0
    assert regions[0].p_value <= 0.05


def test_drag_shows_where_the_marble_is_fast(plant):
    case = plant([{"name": "quadratic_drag", "coefficient_per_m": 15.0}], runs=6)
    regimes = [one.what for one in found_in(case) if one.kind == "regime"]
    assert "rolling fast" in regimes
