"""Locating the residuals of the base model."""

import pytest

from irt.catalogue import effects
from irt.diagnosis.latent_force import Source
from irt.diagnosis.locate import locate, stages


def found_in(dataset):
    base = dataset.fit()
    return locate(base, min(base.noise, 1.1 * dataset.noise))


def test_noise_is_hardly_ever_anywhere(plant):
    found = [found_in(plant(runs=6, seed=seed)) for seed in range(1, 6)]
    assert sum(bool(one) for one in found) <= 1


def test_a_bump_is_a_region(plant):
    bump = {"name": "bump", "x_m": 0.0, "y_m": 0.0, "height_m": 4e-4, "width_m": 0.02}
    dataset = plant([bump], runs=6)
    regions = [one for one in found_in(dataset) if one.kind == "region"]
    assert regions[0].what == "the middle of the board"
    assert 0.0 < regions[0].strength <= 1.0
    assert regions[0].p_value <= 0.05


def test_drag_shows_where_the_marble_is_fast(plant):
    dataset = plant([{"name": "quadratic_drag", "coefficient_per_m": 15.0}], runs=6)
    regimes = [one.what for one in found_in(dataset) if one.kind == "regime"]
    assert "rolling fast" in regimes


@pytest.fixture
def sources():
    """Return sources at all stages, the likeliest first, one of them not clear."""
    found = [
        ("velocity", "force", 400.0, 0.01),
        ("command", "command", 360.0, 0.01),
        ("time", "force", 9.0, 0.3),
    ]
    return [Source(name, stage, gain, chance, 1e-4) for name, stage, gain, chance in found]


def test_stages_of_equal_likelihood_are_as_strong(plant, sources):
    found = stages(plant(runs=1).fit(), sources)
    assert [one.what.split(":")[0] for one in found] == [
        "between board and marble",
        "between command and board",
    ]
    assert [one.strength for one in found] == [1.0, 0.9]


def test_stages_of_effects_that_explain_all_stand_alone(plant, sources):
    (found,) = stages(plant(runs=1).fit(), sources, {"actuation"})
    assert (found.what.split(":")[0], found.strength) == ("between command and board", 1.0)


def test_the_stage_of_each_effect_may_be_asked_for(plant, sources):
    base = plant(runs=1).fit()
    for one in effects():
        assert len(stages(base, sources, {one.stage})) <= 1
