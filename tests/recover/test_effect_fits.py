"""Effects fitted along with the five parameters: hidden by another simulator, or by the other engine."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.fitting.least_squares import least_squares
from irt.model import Effect, Model
from irt.recording import Recording
from irt.residual import free_run_error
from irt.rig import RANGES, Board, Marble, Rig, load_rig

TRUTH = (0.06, 0.05, 4e-4, 15.0, 1.03)
NOISE = 1e-3


def error_on(model: Model, runs: Sequence[Recording]) -> float:
    return float(np.mean([free_run_error(model, run) for run in runs]))


def recorded_by_rapier(name: str, values: dict[str, float]) -> tuple[Rig, list[Recording]]:
    """Return a rig of six runs and two runs held out: sums of sinusoids, seen by a noisy camera."""
    rng = np.random.default_rng(4)
    rows = np.arange(110)[:, None, None]
    runs = []
    for index in range(8):
        waves = np.sin(2 * np.pi * (rows / 110 * rng.uniform(0.7, 5.0, (2, 3)) + rng.random((2, 3))))
        knobs = (waves * rng.uniform(0.02, 0.08, (2, 3))).sum(axis=2)
        start = rng.uniform(-0.25, 0.25, 2)
        hidden = [{"name": name, **values}]
        marble = rollouts([TRUTH], knobs, effects=hidden, start=start, engine="rapier")[0]
        marble += NOISE * rng.standard_normal(marble.shape)
        runs.append(Recording(f"run-{index}", Path(f"run-{index}.csv"), knobs, marble))
    rig = Rig(Path("rig"), Board(), Marble(), "rest", dict(RANGES), tuple(runs[:6]))
    return rig, runs[6:]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("backlash", {"width_x_rad": 0.04, "width_y_rad": 0.06}),
        ("cross_coupling", {"x_from_y": 0.2, "y_from_x": -0.1}),
        ("viscous_drag", {"rate_per_s": 0.5}),
        ("parallax", {"height_m_per_rad": 0.4}),
        ("eccentric_marble", {"offset": 0.002, "phase_rad": 3.1, "lean_rad": 0.1, "follows_path": 0.0}),
    ],
)
def test_an_effect_of_the_reference_engine_explains_runs_held_out(
    name: str, values: dict[str, float]
) -> None:
    rig, unseen = recorded_by_rapier(name, values)
    without = error_on(least_squares(rig).model, unseen)
    found = least_squares(rig, effects=[Effect(name, {})])
    error = error_on(found.model, unseen)
    floor = NOISE * np.sqrt(2 / np.pi)
    assert error < 2.0 * floor
    assert error < 0.5 * without
    (effect,) = found.model.effects
    assert set(effect.parameters) == set(values)


RIGS = {
    "rig-10": ["backlash"],
    "rig-13": ["lag", "board_warp"],
    "rig-16": ["spring_hysteresis"],
    "rig-25": ["side_force"],
    "rig-29": ["friction_patch"],
    "rig-34": ["gear_nonlinearity"],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_what_another_simulator_hid_is_found_by_its_name(shared: Path, name: str) -> None:
    label = json.loads((shared / "rigs" / "labels.json").read_text(encoding="utf-8"))[name]
    rig = load_rig(shared / "rigs" / name)
    seen = tuple(run for run in rig.recordings if run.name.startswith("train"))
    unseen = [run for run in rig.recordings if run.name.startswith("test")]
    found = least_squares(replace(rig, recordings=seen), effects=[Effect(kind, {}) for kind in RIGS[name]])
    won = (label["base"] - error_on(found.model, unseen)) / (label["base"] - label["oracle"])
    assert won > 0.97
