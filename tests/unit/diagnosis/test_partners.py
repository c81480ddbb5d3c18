"""Where the fit of an effect beside a hypothesis begins."""

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis import partners
from irt.diagnosis.partners import moved_in, seeds
from irt.diagnosis.screen import Draws

BIAS = {"name": "tilt_bias", "bias_x_rad": 0.0004, "bias_y_rad": -0.0003}


def said(_text: str) -> None:
    """Keep quiet."""


def test_seeds_begin_where_the_hypothesis_led(plant):
    case = plant([BIAS])
    base = case.fit(starts=2, rounds=1)
    explained, points = seeds(case, base, ["tilt_bias"], said)["tilt_bias"]
    assert 0.3 < explained <= 1.0
    assert points[:, :5] == pytest.approx(base.values[None].repeat(len(points), axis=0))


def test_short_windows_say_what_is_tried_first(plant, monkeypatch):
    """In whole runs the marble has gone astray: what seems to explain most there may be anything."""
    shares = {24: [0.3, 0.2, 0.1, 0.4], 60: [0.1, 0.6, 0.3, 0.2], 80: [0.1, 0.2, 0.9, 0.3]}
    names = ["lag", "delay", "tilt_bias", "viscous_drag"]

    class Told:
        def __init__(self, case, parent, rows):
            self.rows = rows

        def draws(self, name):
            values = np.full((1, len(effect(name).parameters)), 0.1)
            return Draws(values, np.array([shares[self.rows][names.index(name)]]))

    monkeypatch.setattr(partners, "Screen", Told)
    case = plant(rows=80)
    found = seeds(case, case.fit(starts=2, rounds=1), names, said)
    # The best of each length, and then as short windows have them.
    assert list(found) == ["viscous_drag", "delay", "tilt_bias", "lag"]
    assert [share for share, _ in found.values()] == [0.4, 0.6, 0.9, 0.3]


@pytest.mark.slow
def test_what_pushes_at_a_place_is_looked_for_where_something_else_was_found(plant):
    """A point that catches the marble shows its place only to what is put there."""
    truth = {"x_m": -0.1, "y_m": -0.05, "strength_m3_per_s2": 3e-4}
    case = plant([{"name": "point_field", **truth}], runs=6, rows=120)
    base = case.fit(starts=8)
    bump = case.refine(["bump"], np.array([[*base.values, -0.09, -0.042, -1e-4, 0.04]]))[0]
    names, points = moved_in(case, bump, "bump", "point_field")
    assert names == ("point_field",)
    found = case.fit(names, points=points, rounds=0)
    assert found.noise < 2.0 * case.noise < bump.noise
    assert found.value_of("point_field")["x_m"] == pytest.approx(truth["x_m"], abs=0.003)
    assert found.value_of("point_field")["y_m"] == pytest.approx(truth["y_m"], abs=0.003)
