"""Marbles of MuJoCo whose commands come one by one go where those of whole recordings go."""

import numpy as np
import pytest

import irt

VALUES = np.array([0.07, 0.06, 5e-4, 12.0, 1.0])
HIDDEN = [
    {"name": "delay", "delay_s": 0.13},
    {"name": "lag", "time_constant_s": 0.1},
    {"name": "backlash", "width_x_rad": 0.03, "width_y_rad": 0.02},
    {"name": "delay_jitter", "sd_s": 0.02},
    {"name": "latency", "latency_s": 0.08},
]


@pytest.fixture(scope="module")
def mujoco_world():
    pytest.importorskip("mujoco")
    import mujoco_world  # noqa: PLC0415
    import mujoco_world.live  # noqa: PLC0415

    return mujoco_world


def driven(live, commands):
    """Return the pictures (n, rows, 2) under commands (n, rows, 2), the first of which is level."""
    seen = [live.see()]
    for row in range(1, commands.shape[1]):
        live.play(commands[:, row])
        seen.append(live.see())
    return np.stack(seen, axis=1)


@pytest.mark.parametrize("hidden", [[], HIDDEN], ids=["five parameters", "hidden effects"])
def test_pictures_are_those_of_whole_recordings(mujoco_world, hidden):
    commands = np.random.default_rng(0).normal(0.0, 0.06, (2, 30, 2))
    commands[:, 0] = 0.0
    live = mujoco_world.live.Live(VALUES, hidden, np.zeros((2, 2)), np.arange(2))
    whole = mujoco_world.simulate(VALUES, commands, hidden, start=None, seeds=np.arange(2))
    assert np.ptp(whole) > 0.02
    assert np.abs(driven(live, commands) - whole).max() < 1e-12


def test_an_inner_wall_stops_a_marble_and_a_hole_takes_it(mujoco_world):
    walled = irt.Maze(walls=((0.04, -0.05, 0.04, 0.05),))
    holed = irt.Maze(holes=((0.04, 0.0),))
    commands = np.zeros((1, 40, 2))
    commands[0, 1:, 1] = 0.15
    seen = {}
    for name, maze in (("wall", walled), ("hole", holed), ("bare", None)):
        live = mujoco_world.live.Live(VALUES, [], np.zeros((1, 2)), np.zeros(1, dtype=int), maze)
        seen[name] = driven(live, commands)[0, :, 0] * 0.276
        assert live.fallen.tolist() == [name == "hole"]
    assert np.nanmax(seen["bare"]) > 0.1
    # The marble's centre stops a radius and half a wall before the wall's middle.
    assert seen["wall"].max() == pytest.approx(0.04 - 0.00685 - 0.0025, abs=5e-4)
    assert np.isnan(seen["hole"][-1])
    assert np.nanmax(seen["hole"]) < 0.04


def test_a_row_too_short_to_turn_the_plate_is_refused(mujoco_world):
    with pytest.raises(ValueError, match="shorter"):
        mujoco_world.live.Live(
            np.array([*VALUES[:3], 5.0, 1.0]), [], np.zeros((1, 2)), np.zeros(1, dtype=int)
        )
