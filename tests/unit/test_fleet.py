"""Marbles whose commands come one by one go where a batch has them."""

from __future__ import annotations

import numpy as np
import pytest

from irt.engine import SUBSTEP_S, rollouts
from irt.errors import IrtError
from irt.fleet import Fleet
from irt.model import Effect, Model, Parameter
from irt.rig import PARAMETERS, RANGES, Board, Marble

ROWS, ROW_S = 30, 12 * SUBSTEP_S


def model(gear: float, *effects: Effect) -> Model:
    values = (gear, 0.05, 3e-4, 12.0, 1.0)
    return Model(
        board=Board(),
        marble=Marble(),
        start="rest",
        ranges=dict(RANGES),
        parameters={name: Parameter(value) for name, value in zip(PARAMETERS, values, strict=True)},
        effects=effects,
    )


MODELS = [
    model(0.06),
    model(0.08, Effect("delay", {"delay_s": 0.12})),
    model(0.04, Effect("backlash", {"width_x_rad": 0.02}), Effect("tilt_bias", {"bias_x_rad": 0.001})),
]


@pytest.mark.parametrize("threads", [1, 3, None])
def test_each_marble_and_its_board_are_those_of_a_rollout(threads: int | None) -> None:
    knobs = 0.05 * np.random.default_rng(1).standard_normal((3, ROWS, 2))
    fleet = Fleet(3, threads)
    start = (0.1, -0.05)
    for place, one in enumerate(MODELS):
        fleet.begin(place, one, start=start, rows=ROWS, row_s=ROW_S)
    seen, tilt = [fleet.rows[0]], [fleet.rows[1]]
    for row in range(ROWS - 1):
        fleet.play(knobs[:, row])
        places, angles = fleet.rows
        seen.append(places)
        tilt.append(angles)
    for place, one in enumerate(MODELS):
        durations = np.full(ROWS, ROW_S)
        expected, angles = rollouts(one, knobs[place], start=start, durations=durations, tilt=True)
        np.testing.assert_array_equal([row[place] for row in seen], expected[0])
        np.testing.assert_array_equal([row[place] for row in tilt], angles[0])


def test_marbles_that_are_not_asked_wait() -> None:
    fleet = Fleet(2)
    for place in range(2):
        fleet.begin(place, MODELS[0], start=(0.0, 0.0), rows=9, row_s=ROW_S)
    for _ in range(9):
        fleet.play(np.full((2, 2), 0.1), np.array([True, False]))
    (moved, waiting), _ = fleet.rows
    assert np.linalg.norm(moved) > 0.01
    assert not waiting.any()
    with pytest.raises(IrtError, match="a row that is left"):
        fleet.play(np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        (np.zeros((3, 2)), r"commands: expected shape \(2, 2\), got \(3, 2\)"),
        (np.full((2, 2), np.nan), "commands: expected finite numbers"),
        ("left", "commands"),
    ],
)
def test_wrong_commands_are_one_line(commands, message: str) -> None:
    fleet = Fleet(2)
    for place in range(2):
        fleet.begin(place, MODELS[0], start=(0.0, 0.0), rows=3, row_s=ROW_S)
    with pytest.raises(IrtError, match=message):
        fleet.play(commands)


def test_a_place_that_is_none_is_refused() -> None:
    fleet = Fleet(2)
    with pytest.raises(IrtError, match="one of 2 places"):
        fleet.begin(2, MODELS[0], start=(0.0, 0.0), rows=3, row_s=ROW_S)
    with pytest.raises(IrtError, match="a row that is left"):
        fleet.play(np.zeros((2, 2)))
    assert np.isnan(fleet.rows[0]).all()
