from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.maze import Maze
from irt.model import Effect, Model, Parameter, save_model
from irt.recording import Recording, load_recording, save_recording
from irt.rig import PARAMETERS, RANGES, Board, Marble

VALUES = (0.07, 0.06, 0.0005, 24.3, 1.05)
MODEL = Model(
    board=Board(edge_x_m=0.3, edge_y_m=0.25),
    marble=Marble(),
    start="rest",
    ranges=dict(RANGES),
    parameters={name: Parameter(value) for name, value in zip(PARAMETERS, VALUES, strict=True)},
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    save_model(tmp_path / "model.toml", MODEL)
    return tmp_path / "model.toml"


@pytest.fixture
def commands(tmp_path: Path, wave) -> Path:
    """A recording whose row 0 says where the marble starts."""
    marble = np.full((40, 2), np.nan)
    marble[0] = [0.1, -0.2]
    save_recording(tmp_path / "run.csv", wave, marble)
    return tmp_path / "run.csv"


def test_predicts_what_the_model_says(irt, tmp_path: Path, model: Path, commands: Path, wave) -> None:
    out = tmp_path / "predicted.csv"
    assert irt("simulate", model, "--commands", commands, "--out", out) == (0, "", "")
    predicted = load_recording(out)
    np.testing.assert_array_equal(predicted.knobs, wave)
    np.testing.assert_array_equal(predicted.marble, rollouts([VALUES], wave, rig=MODEL, start=[0.1, -0.2])[0])
    assert predicted.stamps is None


def test_to_standard_output_it_says_the_same(irt, tmp_path: Path, model: Path, commands: Path) -> None:
    irt("simulate", model, "--commands", commands, "--out", tmp_path / "predicted.csv")
    status, out, err = irt("simulate", model, "--commands", commands)
    assert (status, err) == (0, "")
    assert out == (tmp_path / "predicted.csv").read_text()


def test_without_a_start_the_marble_begins_in_the_centre(irt, tmp_path: Path, model: Path) -> None:
    commands = tmp_path / "commands.csv"
    commands.write_text("step,knob_x_rad,knob_y_rad\n0,0,0.1\n1,0,0.1\n2,0,0.1\n")
    lines = irt("simulate", model, "--commands", commands).out.splitlines()
    assert lines[0] == "step,knob_x_rad,knob_y_rad,marble_x,marble_y,tilt_x_rad,tilt_y_rad"
    assert lines[1] == "0,0.0,0.1,0.0,0.0,0.0,0.0"
    x, y = (float(cell) for cell in lines[3].split(",")[3:5])
    assert x > 0  # by the right-hand rule, a turn about y drives along x
    assert y == 0


def test_stamps_are_kept_and_followed(irt, tmp_path: Path, model: Path, wave) -> None:
    stamps = np.cumsum(np.random.default_rng(1).uniform(0.05, 0.15, 40))
    run = Recording("run", tmp_path, wave, np.zeros((40, 2)), stamps)
    save_recording(tmp_path / "run.csv", wave, run.marble, stamps)
    irt("simulate", model, "--commands", tmp_path / "run.csv", "--out", tmp_path / "out.csv")
    predicted = load_recording(tmp_path / "out.csv")
    np.testing.assert_array_equal(predicted.stamps, stamps)
    expected = rollouts([VALUES], wave, rig=MODEL, durations=run.durations)[0]
    np.testing.assert_array_equal(predicted.marble, expected)


def test_the_time_step_is_the_model_s(irt, tmp_path: Path, commands: Path, wave) -> None:
    save_model(tmp_path / "model.toml", dataclasses.replace(MODEL, time_step="continuous"))
    irt("simulate", tmp_path / "model.toml", "--commands", commands, "--out", tmp_path / "out.csv")
    expected = rollouts([VALUES], wave, rig=MODEL, start=[0.1, -0.2], time_step="continuous")[0]
    np.testing.assert_array_equal(load_recording(tmp_path / "out.csv").marble, expected)


def test_a_prediction_may_take_the_place_of_its_commands(irt, model: Path, commands: Path) -> None:
    assert irt("simulate", model, "--commands", commands, "--out", commands).status == 0
    assert load_recording(commands).seen.all()


def test_effects_of_the_model_act(irt, tmp_path: Path, commands: Path, wave) -> None:
    effects = (Effect("delay", {"delay_s": 0.13}), Effect("bump", {"x_m": 0.03, "height_m": 2e-4}))
    save_model(tmp_path / "model.toml", dataclasses.replace(MODEL, effects=effects))
    assert (
        irt("simulate", tmp_path / "model.toml", "--commands", commands, "--out", tmp_path / "out.csv").status
        == 0
    )
    named = [{"name": effect.name, **effect.parameters} for effect in effects]
    expected = rollouts([VALUES], wave, rig=MODEL, start=[0.1, -0.2], effects=named)[0]
    np.testing.assert_array_equal(load_recording(tmp_path / "out.csv").marble, expected)


def test_an_effect_that_the_engine_does_not_know(irt, tmp_path: Path, commands: Path) -> None:
    save_model(tmp_path / "m.toml", dataclasses.replace(MODEL, effects=(Effect("backlsh", {"width": 1.0}),)))
    status, out, err = irt("simulate", tmp_path / "m.toml", "--commands", commands)
    assert (status, out) == (1, "")
    assert 'm.toml, [[effects]] 1: unknown effect "backlsh"; ' in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("none.toml", "--commands", "run.csv"),
            "irt: none.toml: no such file; give a model.toml, as `irt tune`",
        ),
        (
            ("model.toml", "--commands", "none.csv"),
            "irt: none.csv: no such file; give a CSV file of commands, ",
        ),
        (("run.csv", "--commands", "run.csv"), "irt: run.csv: broken TOML: "),
        (("model.toml", "--commands", "model.toml"), "irt: model.toml, line 1: column step is missing; "),
        (
            ("model.toml", "--commands", "run.csv", "--out", "."),
            "irt: .: cannot be written: it is a folder; name a file\n",
        ),
        (
            ("model.toml", "--commands", "run.csv", "--out", "a/b.csv"),
            "irt: a/b.csv: cannot be written: there is no folder",
        ),
    ],
)
@pytest.mark.usefixtures("model", "commands")
def test_what_cannot_be_done(irt, monkeypatch, tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = irt("simulate", *words)
    assert (status, out) == (1, "")
    assert err.startswith(message)
    assert err.count("\n") == 1


def test_a_marble_that_falls_is_noted_and_leaves_its_place_empty(irt, tmp_path: Path) -> None:
    maze = Maze(holes=((0.03, 0.0),), start=(-0.03, 0.0))
    save_model(tmp_path / "model.toml", dataclasses.replace(MODEL, maze=maze))
    commands = tmp_path / "commands.csv"
    commands.write_text("step,knob_x_rad,knob_y_rad\n" + "".join(f"{i},0,0.2\n" for i in range(40)))
    status, out, err = irt("simulate", tmp_path / "model.toml", "--commands", commands)
    assert status == 0
    row = int(err.rsplit("from row ", 1)[1].split()[0])
    assert err == f"note: the marble falls through hole 1 at [0.03, 0]; it is gone from row {row} on\n"
    cells = [line.split(",") for line in out.splitlines()[1:]]
    assert float(cells[0][3]) == pytest.approx(-0.03 / 0.3 * 1.05)
    assert all((cell[3] == "") == (i >= row) for i, cell in enumerate(cells))
