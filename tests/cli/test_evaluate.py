from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.maze import Maze
from irt.model import Model, save_model
from irt.residual import evaluate
from irt.rig import load_rig

VALUES = (0.07, 0.06, 0.0005, 24.0, 1.0)
OTHER = (0.05, 0.07, 0.0003, 24.0, 1.0)


@pytest.fixture
def rig(write_rig, wave) -> Path:
    """Two runs of 40 rows of 0.1 s, and one too short for a window of 1 s."""
    starts = {"run-1": [0.1, 0.0], "run-2": [0.0, -0.1], "run-10": [0.0, 0.0]}
    marble = {name: rollouts([VALUES], wave, start=start)[0] for name, start in starts.items()}
    marble["run-2"][5] = np.nan
    runs = {name: (wave, path) for name, path in marble.items()}
    runs["run-10"] = (wave[:8], marble["run-10"][:8])
    return write_rig(runs)


@pytest.fixture
def model(tmp_path: Path, rig: Path) -> Path:
    save_model(tmp_path / "model.toml", Model.from_rig(load_rig(rig), OTHER))
    return tmp_path / "model.toml"


def test_prints_and_writes_the_errors_of_each_run(irt, tmp_path: Path, rig: Path, model: Path) -> None:
    status, out, err = irt("evaluate", model, rig, "--window", "1", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    loaded = load_rig(rig)
    expected = evaluate(Model.from_rig(loaded, OTHER), loaded.recordings, 1.0)
    rows = {line.rsplit(maxsplit=6)[0].strip(): line.split()[-6:] for line in out.splitlines()[3:7]}
    assert list(rows) == ["run-1", "run-2", "run-10", "all runs"]
    for run, cells in zip((*expected.runs, expected), rows.values(), strict=True):
        shown = [f"{100 * value:.2f}" for value in (run.free_run.mae, run.free_run.max)]
        shown += (
            ["-", "-"]
            if run.windowed is None
            else [f"{100 * v:.2f}" for v in (run.windowed.mae, run.windowed.max)]
        )
        assert cells == [f"{run.free_run.rows}", f"{run.free_run.lost}", *shown]
    written = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert written == {"model": str(model), "rig": str(rig), **expected.as_dict()}
    assert b"<svg" in (tmp_path / "out" / "evaluation.svg").read_bytes()
    assert str(tmp_path / "out" / "evaluation.json") in out


def test_the_truth_is_without_error(irt, tmp_path: Path, rig: Path) -> None:
    save_model(tmp_path / "truth.toml", Model.from_rig(load_rig(rig), VALUES))
    out = irt("evaluate", tmp_path / "truth.toml", rig, "--window", "1", "--out", tmp_path / "out").out
    assert out.splitlines()[6].split()[-4:] == ["0.00"] * 4


def test_by_default_windows_of_two_seconds_into_a_folder_here(irt, monkeypatch, tmp_path, rig, model) -> None:
    monkeypatch.chdir(tmp_path)
    assert irt("evaluate", model, rig).status == 0
    found = json.loads((tmp_path / "irt-evaluate" / "evaluation.json").read_text())
    # Without stamps: two seconds of the model's time scale.
    assert (found["window_s"], found["window_rows"]) == (None, round(2.0 * 240 / round(VALUES[3])))


@pytest.mark.parametrize("window", ["0", "-1", "nan", "inf", "long"])
def test_a_window_that_is_none_is_wrong_usage(irt, rig: Path, model: Path, window: str) -> None:
    status, out, err = irt("evaluate", model, rig, "--window", window)
    assert (status, out) == (2, "")
    assert f"argument --window: expected a number above 0, found {window}" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("none.toml", "rig"), "irt: none.toml: no such file; give a model.toml, as `irt tune`"),
        (
            ("rig", "rig"),
            "irt: rig: is a folder, where a file was expected; give a model.toml, as `irt tune`",
        ),
        (("model.toml", "none"), "irt: none: no such folder; give a folder with recordings (*.csv)\n"),
        (("model.toml", "model.toml"), "irt: model.toml: a rig is a folder, and this is a file; "),
        (("model.toml", "."), "irt: .: the rig holds no recording; "),
        (
            ("model.toml", "rig", "--out", "model.toml"),
            "irt: model.toml: the folder cannot be made: model.toml is a file; choose another\n",
        ),
    ],
)
@pytest.mark.usefixtures("rig", "model")
def test_what_cannot_be_done(irt, monkeypatch, tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    status, out, err = irt("evaluate", *words)
    assert (status, out) == (1, "")
    assert err.startswith(message)
    assert err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_ball_table(irt, tmp_path: Path, shared: Path) -> None:
    folder = shared / "real" / "ball-table"
    save_model(tmp_path / "m.toml", Model.from_rig(load_rig(folder), [0.77, 0.84, 0.001, 48.0, 1.0]))
    assert irt("evaluate", tmp_path / "m.toml", folder, "--window", "2", "--out", tmp_path).status == 0
    written = json.loads((tmp_path / "evaluation.json").read_text())
    assert len(written["runs"]) == 6
    assert 0.02 < written["overall"]["windowed"]["mae"] < 0.07


def test_a_predicted_marble_that_falls_is_noted(irt, tmp_path: Path, rig: Path) -> None:
    x, y = 0.276 * load_rig(rig).recordings[0].marble[20]
    maze = Maze(holes=((float(x), float(y)),))
    save_model(tmp_path / "model.toml", dataclasses.replace(Model.from_rig(load_rig(rig), VALUES), maze=maze))
    status, out, _ = irt("evaluate", tmp_path / "model.toml", rig, "--window", "1", "--out", tmp_path / "out")
    assert status == 0
    line = next(line for line in out.splitlines() if "falls" in line)
    row = int(line.split("rows from ")[1].split()[0])
    assert line == f"run-1: the predicted marble falls; rows from {row} on do not count"
    assert 3 < row < 24
    written = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert written["runs"][0]["free_run"]["rows"] == row
    assert written["runs"][0]["free_run"]["mae"] < 0.02
