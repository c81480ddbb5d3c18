from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.errors import IrtError
from irt.model import Effect, Model, Parameter, load_model, save_model
from irt.posterior import SPINNING, Component, Spread
from irt.rig import PARAMETERS, RANGES, Board, Marble

VALUES = (0.05, 0.06, 0.0005, 25.0, 1.0)
GEAR = Spread(0.05, 0.0, 0.1, (0.001, 0.0), (0.0, -0.4))
SCALE = Spread(25.0, 0.0, 50.0, (0.0, 0.0), (0.0, 0.2))
WIDTH = Spread(0.02, 0.0, 10.0, (0.0, 0.004), (0.0, 0.0))


def model(*components: Component, **changes) -> Model:
    plain = Model(
        board=Board(),
        marble=Marble(),
        start="rest",
        ranges=dict(RANGES),
        parameters={
            name: Parameter(value, 0.0, 60.0) for name, value in zip(PARAMETERS, VALUES, strict=True)
        },
    )
    return dataclasses.replace(plain, posterior=components, **changes)


TWO = (
    Component(0.75, ("backlash",), {"gear_x": GEAR, "time_scale": SCALE, "backlash.width_x_rad": WIDTH}),
    Component(0.25, (), {"gear_x": Spread(0.04)}),
)


def test_draws_are_models_with_effects_by_their_probability() -> None:
    drawn = model(*TWO, effects=(Effect("backlash", {"width_y_rad": 0.01}),)).sample(400, seed=1)
    with_it = [one for one in drawn if one.effects]
    assert 270 < len(with_it) < 330
    assert all(one.effects[0].parameters["width_y_rad"] == 0.01 for one in with_it)
    widths = [one.effects[0].parameters["width_x_rad"] for one in with_it]
    assert np.mean(widths) == pytest.approx(0.02, abs=0.001)
    assert np.std(widths) == pytest.approx(0.004, rel=0.15)
    without = next(one for one in drawn if not one.effects)
    assert without.values.tolist() == [0.04, *VALUES[1:]]
    assert without.parameters["gear_x"].low is None
    assert without.posterior == ()


def test_the_symmetry_of_the_motion_is_kept() -> None:
    gear = dataclasses.replace(GEAR, linear=(0.0, 0.0))
    drawn = model(Component(1.0, (), {"gear_x": gear, "time_scale": SCALE})).sample(200)
    gears, scales = np.array([[one.values[0], one.values[3]] for one in drawn]).T
    assert np.ptp(np.log(scales)) > 0.5
    np.testing.assert_allclose(gears * scales**2, VALUES[0] * VALUES[3] ** 2)


def test_the_same_seed_gives_the_same_draws_however_many() -> None:
    few, many = model(*TWO).sample(3, seed=5), model(*TWO).sample(8, seed=5)
    assert many[:3] == few
    assert model(*TWO).sample(3, seed=6) != few


def test_a_draw_predicts() -> None:
    knobs = 0.05 * np.sin(np.linspace(0.0, 6.0, 40))[:, None] * [1.0, -0.5]
    paths = [one.predict(knobs) for one in model(*TWO).sample(4)]
    assert np.ptp([path[-1] for path in paths], axis=0).max() > 0.0


def test_the_board_s_friction_against_spins_is_drawn_too() -> None:
    spin = Spread(0.0005, 0.0, 0.01, (0.0002,), (0.0,))
    drawn = model(Component(1.0, (), {SPINNING: spin})).sample(50)
    assert np.ptp([one.board.spinning_friction for one in drawn]) > 1e-4


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    value=st.floats(0.0, 0.1),
    linear=st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=4),
    power=st.floats(-2.0, 2.0),
)
def test_no_draw_leaves_the_bounds(seed: int, value: float, linear: list[float], power: float) -> None:
    spread = Spread(value, 0.0, 0.1, tuple(linear), (power,) * len(linear))
    if not any(linear):
        return
    drawn = model(Component(1.0, (), {"gear_x": spread})).sample(20, seed=seed)
    assert all(0.0 <= one.values[0] <= 0.1 for one in drawn)


def test_a_posterior_comes_back_from_its_file(tmp_path: Path) -> None:
    kept = model(*TWO, effects=(Effect("backlash", {"width_x_rad": 0.02}),))
    save_model(tmp_path / "model.toml", kept)
    read = load_model(tmp_path / "model.toml")
    assert read == kept
    assert read.sample(5, seed=2) == kept.sample(5, seed=2)


def test_a_model_without_posterior_says_what_to_do() -> None:
    with pytest.raises(IrtError, match=r"no posterior.*\[\[posterior\]\].*irt tune or irt diagnose"):
        model().sample(1)


@pytest.mark.parametrize(("n", "seed"), [(0, 0), (-1, 0), (1.5, 0), (3, -1)])
def test_wrong_counts_and_seeds_are_refused(n, seed) -> None:
    with pytest.raises(IrtError, match="whole number"):
        model(*TWO).sample(n, seed)


def test_bounds_that_no_draw_meets_are_one_line() -> None:
    apart = Component(
        1.0,
        (),
        {
            "gear_x": Spread(0.05, 0.05, 0.1, (1.0,), (0.0,)),
            "gear_y": Spread(0.05, 0.0, 0.05, (1.0,), (0.0,)),
        },
    )
    with pytest.raises(IrtError, match="no draw lies within the bounds of all parameters; fit again"):
        model(apart).sample(1)


def near_bounds(bounds: tuple[float, float], names: Sequence[str]) -> Component:
    """Return independent parameters whose values are on one of their bounds."""
    axes = np.eye(len(names)).tolist()
    effects = tuple(dict.fromkeys(name.split(".")[0] for name in names if "." in name))
    low, high = bounds
    spreads = {
        name: Spread(1.0, low, high, tuple(axis), (0.0,) * len(axis))
        for name, axis in zip(names, axes, strict=True)
    }
    return Component(1.0, effects, spreads)


@pytest.mark.parametrize(("bounds", "sign"), [((1.0, np.inf), 1.0), ((-np.inf, 1.0), -1.0)])
def test_many_parameters_near_their_bounds_are_drawn_from_the_normal_within_them(bounds, sign) -> None:
    """On a real rig one draw in ten thousand lay within all bounds, and `Model.sample` gave up."""
    names = [*PARAMETERS, "lag.time_constant_s", "backlash.width_x_rad", "backlash.width_y_rad"]
    names += [f"friction_patch.{one}" for one in ("x_m", "y_m", "radius_m", "factor")]
    names += [f"bump.{one}" for one in ("x_m", "y_m", "height_m", "width_m")]
    kept = near_bounds(bounds, names)
    random = [np.random.default_rng([1, index]) for index in range(150)]
    drawn = np.array([list(kept.draw(one).values()) for one in random])
    away = sign * (drawn - 1.0)
    assert (away >= 0.0).all()
    # A half-normal distribution, in each of 16 parameters.
    error = np.sqrt((1.0 - 2.0 / np.pi) / away.size)
    assert away.mean() == pytest.approx(np.sqrt(2.0 / np.pi), abs=5.0 * error)
    assert away.std() == pytest.approx(np.sqrt(1.0 - 2.0 / np.pi), rel=0.06)
    assert np.abs(np.corrcoef(away.T) - np.eye(len(names))).max() < 5.0 / np.sqrt(len(away))
    again = [list(kept.draw(np.random.default_rng([1, index])).values()) for index in range(3)]
    np.testing.assert_array_equal(drawn[:3], again)


def test_what_moves_together_is_drawn_together_near_bounds() -> None:
    """A walk along axes alone would not cross a narrow wedge; independent draws do, where they can."""
    first, second = np.linalg.cholesky([[1.0, 0.95], [0.95, 1.0]]).tolist()
    wedge = {
        "gear_x": Spread(0.0, 0.0, np.inf, tuple(first), (0.0, 0.0)),
        "gear_y": Spread(0.0, -np.inf, 0.0, tuple(second), (0.0, 0.0)),
    }
    kept = Component(1.0, (), wedge)
    walked = np.array([kept.walked(np.random.default_rng([2, index])) for index in range(400)])
    drawn = np.array([list(kept.draw(np.random.default_rng([3, i])).values()) for i in range(400)])
    error = np.sqrt(2.0) * drawn.std(axis=0) / np.sqrt(len(drawn))
    assert (np.abs(walked.mean(axis=0) - drawn.mean(axis=0)) < 5.0 * error).all()
    assert walked.std(axis=0) == pytest.approx(drawn.std(axis=0), rel=0.2)


HEAD = """
[parameters]
gear_x = 0.07
gear_y = 0.06
rolling_friction = 0.0005
time_scale = 25
observation_scale = 1.0
[[posterior]]
"""
GOOD = """probability = 1.0
effects = ["backlash"]
[posterior.parameters]
gear_x = { value = 0.07, low = 0.0, high = inf, linear = [0.001] }
"""


def read(tmp_path: Path, text: str) -> Model:
    path = tmp_path / "model.toml"
    path.write_text(text)
    return load_model(path)


def test_a_posterior_that_a_person_wrote_is_read(tmp_path: Path) -> None:
    (found,) = read(tmp_path, HEAD + GOOD).posterior
    assert found.parameters["gear_x"] == Spread(0.07, 0.0, np.inf, (0.001,), (0.0,))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "probability = 1.0",
            "probability = 0.4",
            r"posterior: the probabilities add up to 0\.4, expected 1",
        ),
        (
            "probability = 1.0",
            "probability = -1",
            r"\[\[posterior\]\] 1: probability: expected a number above 0",
        ),
        ("probability = 1.0", "", r"\[\[posterior\]\] 1: probability is missing"),
        ("linear = [0.001]", "linear = []", "one point, of which every draw would be the same"),
        ("linear = [0.001]", "linear = 0.001", r"gear_x, linear: expected \[a, b, \.\.\.\]"),
        ("linear = [0.001]", "linear = [nan]", "gear_x, linear: expected a finite number"),
        ("linear = [0.001]", "linear = [1.0], power = [1.0, 2.0]", "linear has 1 numbers, power 2"),
        ("low = 0.0", "low = 0.08", r"the value 0\.07 lies outside its bounds"),
        ("gear_x =", "gear_z =", "gear_z"),
        ("gear_x =", '"backlash.wdth_x_rad" =', "width_x_rad"),
        ("gear_x =", '"delay.delay_s" =', "delay.delay_s"),
        ('["backlash"]', '["backslash"]', "backlash"),
        ('["backlash"]', "3", "effects: expected a list of names"),
        ("effects", "efects", "effects"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(IrtError, match=message) as caught:
        read(tmp_path, HEAD + GOOD.replace(old, new, 1))
    assert "\n" not in str(caught.value)
    assert "model.toml" in str(caught.value)
