"""MuJoCo loads what is exported, and its marbles roll where ours do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irt.export.mjcf import to_mjcf
from irt.maze import Maze

pytest.importorskip("mujoco", reason="mujoco is an optional package: labsim-irt[mujoco]")


@pytest.mark.parametrize(
    ("effects", "second", "whole"),
    [
        ((), 2e-3, 6e-3),
        (("delay", "lag", "backlash"), 1e-3, 4e-3),
        (("second_order_lag", "gear_matrix", "tilt_bias", "viscous_drag"), 1e-3, 6e-3),
        (("latency", "camera_rotation", "camera_offset", "gear_nonlinearity"), 2e-3, 6e-3),
    ],
    ids=["plain", "play", "coupled", "camera"],
)
def test_marbles_roll_alike(effects: tuple[str, ...], second: float, whole: float) -> None:
    from mjcf_agreement import compared  # noqa: PLC0415

    first, everything, *_ = compared(effects, seed=0)
    assert first < second
    assert everything < whole


def test_a_rim_returns_what_the_model_says() -> None:
    import mujoco  # noqa: PLC0415

    from mjcf_agreement import drawn  # noqa: PLC0415

    plain = drawn((), np.random.default_rng(0))
    lively = replace(plain, board=replace(plain.board, wall_restitution=0.6))
    model = mujoco.MjModel.from_xml_string(to_mjcf(lively).text)
    returned = []
    for offset in np.linspace(0.0, 0.05, 5):
        data = mujoco.MjData(model)
        marble = data.joint("marble")
        marble.qpos[0] = 12.0 + offset
        # Rolling: the speed over the radius is the rate of its turn.
        marble.qvel[0], marble.qvel[4] = 30.0, 30.0 / 0.685
        speeds = []
        for _ in range(400):
            mujoco.mj_step(model, data)
            speeds.append(marble.qvel[0])
        turned = int(np.argmax(np.array(speeds) < -1.0))
        returned.append(-min(speeds[turned : turned + 60]) / 30.0)
    assert np.mean(returned) == pytest.approx(0.6, abs=0.06)


def test_a_marble_lies_at_an_inner_wall_where_ours_does() -> None:
    import mujoco  # noqa: PLC0415

    from mjcf_agreement import drawn  # noqa: PLC0415

    plain = drawn((), np.random.default_rng(0))
    walled = replace(plain, maze=Maze(walls=((0.05, -0.04, 0.05, 0.04),)))
    command = 0.03 / walled.values[1]
    ours = walled.predict(np.tile([0.0, command], (60, 1)))[-1, 0]
    model = mujoco.MjModel.from_xml_string(to_mjcf(walled).text)
    data = mujoco.MjData(model)
    data.ctrl[1] = command
    mujoco.mj_step(model, data, 4000)
    edges_per_cm = model.numeric("edges_per_cm").data[0]
    theirs = data.sensor("marble").data[0] * edges_per_cm
    assert theirs == pytest.approx(ours, abs=2e-3)
    assert theirs < 0.5 * 0.05 / 0.138
