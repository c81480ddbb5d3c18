"""Where the base model and recordings disagree."""

from irt.diagnose.locate import locate


def test_noise_is_nowhere(plant):
    case = plant(runs=6)
    assert locate(case, case.fit()) == []


def test_a_bump_is_a_region(plant):
    bump = {"name": "bump", "x_m": 0.0, "y_m": 0.0, "height_m": 4e-4, "width_m": 0.02}
    case = plant([bump], runs=6)
    regions = [one for one in locate(case, case.fit()) if one.kind == "region"]
    assert regions[0].what == "the middle of the board"
    assert 0.0 < regions[0].strength <= 1.0
    assert regions[0].p_value <= 0.05


def test_drag_shows_where_the_marble_is_fast(plant):
    case = plant([{"name": "quadratic_drag", "coefficient_per_m": 15.0}], runs=6)
    regimes = [one.what for one in locate(case, case.fit()) if one.kind == "regime"]
    assert "rolling fast" in regimes
