from __future__ import annotations

import json

import pytest

from irt.export.jsonfile import VERSION, to_json
from irt.maze import Maze
from irt.model import Effect, Model, Parameter
from irt.posterior import Component, Spread
from irt.rig import PARAMETERS, RANGES, Board, Commands, Marble

VALUES = (0.07, 0.05, 3e-4, 24.0, 1.1)
SPREAD = Spread(0.07, linear=(0.001,), power=(0.0,))


def model(**changes) -> Model:
    parameters = {name: Parameter(value) for name, value in zip(PARAMETERS, VALUES, strict=True)}
    parameters["gear_x"] = Parameter(0.07, 0.06, float("inf"))
    fields = {
        "board": Board(),
        "marble": Marble(),
        "start": "rest",
        "ranges": dict(RANGES),
        "parameters": parameters,
    }
    return Model(**{**fields, **changes})


def test_all_that_a_model_holds_is_there_with_units() -> None:
    given = model(
        effects=(Effect("delay", {"delay_s": 0.1}), Effect("slew_limit", {})),
        posterior=(Component(1.0, ("delay",), {"gear_x": SPREAD}),),
        commands=Commands("mA", True),
        maze=Maze.of_layout("cyberrunner-easy"),
    )
    read = json.loads(to_json(given))
    assert (read["format"], read["version"]) == ("labsim-model", VERSION)
    assert read["board"]["edge_x_m"] == 0.276
    gear = {"value": 0.07, "low": 0.06, "high": None, "unit": "rad/(mA)", "range": [0.0, 0.1]}
    assert read["parameters"]["gear_x"] == gear
    delay, slew = read["effects"]
    assert delay["parameters"]["delay_s"]["value"] == 0.1
    assert delay["parameters"]["delay_s"]["unit"] == "s"
    assert delay["parameters"]["y_minus_x_s"]["value"] == 0.0
    assert slew["parameters"]["rate_rad_per_s"]["value"] is None
    assert read["posterior"][0]["parameters"]["gear_x"]["linear"] == [0.001]
    assert read["simulation"]["substep_s"] == pytest.approx(1 / 240)
    assert read["commands"] == {"unit": "mA", "matrix": True}
    assert len(read["maze"]["holes"]) == 8
    assert read["maze"]["hole_radius_m"] == 0.0075


def test_numbers_come_back_bit_for_bit() -> None:
    read = json.loads(to_json(model()))
    assert [read["parameters"][name]["value"] for name in PARAMETERS] == list(VALUES)
