from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from irt.engine import rollouts
from irt.model import Effect, Model, load_model, save_model
from irt.recording import load_commands
from irt.rig import load_rig

VALUES = (0.07, 0.06, 0.0005, 20.0, 1.0)
NOISE = 0.001


@pytest.fixture
def rig(write_rig, wave: np.ndarray) -> Path:
    """Two runs of a rig whose board lags."""
    lag = [{"name": "lag", "time_constant_s": 0.08}]
    runs = {}
    for number, sign in enumerate((1.0, -1.0)):
        knobs = wave * [1.0, sign]
        marble = rollouts([VALUES], knobs, effects=lag, time_step="continuous")[0]
        runs[f"run-{number}"] = (knobs, marble + NOISE * np.random.default_rng(number).normal(size=(40, 2)))
    return write_rig(runs)


@pytest.fixture
def models(tmp_path: Path, rig: Path) -> tuple[Path, Path]:
    paths = []
    for effect in (Effect("lag", {"time_constant_s": 0.08}), Effect("delay", {"delay_s": 0.08})):
        model = Model.from_rig(load_rig(rig), VALUES, effects=[effect], time_step="continuous")
        save_model(tmp_path / f"{effect.name}.toml", model)
        paths.append(tmp_path / f"{effect.name}.toml")
    return paths[0], paths[1]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search less: how good the outcome is belongs to other tests."""
    search = import_module("irt.suggestion.search")
    monkeypatch.setattr(search, "_DRAWN", 6)
    monkeypatch.setattr(search, "_ROUNDS", 2)


def test_commands_ready_to_play_and_what_they_are_for(irt, tmp_path: Path, rig: Path, models) -> None:
    out = tmp_path / "next.csv"
    status, said, err = irt("suggest", rig, "--models", *models, "--out", out, "--threads", "1")
    assert (status, err) == (0, "")
    lines = said.splitlines()
    assert lines[0].startswith("Place the marble at rest in the centre, with level knobs, and play 40 rows: ")
    assert lines[1].startswith("This run is expected to resolve ")
    assert " of the uncertainty about the true model (0.69 nats), " in lines[1]
    assert lines[2].startswith("Separated: lag and delay. ")
    assert lines[-1] == f"wrote {out}: play it, put the recording into {rig}, and diagnose again"
    rows = out.read_text().splitlines()
    assert rows[0] == "step,knob_x_rad,knob_y_rad,marble_x,marble_y"
    assert rows[1] == "0,0.0,0.0,0.0,0.0"
    assert all(row.endswith(",,") for row in rows[2:])
    largest = max(np.abs(one.knobs).max() for one in load_rig(rig).recordings)
    assert 0.0 < np.abs(load_commands(out).knobs).max() <= largest
    predicted = irt("simulate", models[0], "--commands", out)
    assert (predicted.status, len(predicted.out.splitlines())) == (0, 41)


def test_the_same_command_writes_the_same_file(irt, monkeypatch, tmp_path: Path, rig: Path, models) -> None:
    monkeypatch.chdir(tmp_path)
    for name, seed in (("a.csv", "3"), ("b.csv", "3"), ("c.csv", "4")):
        assert irt("suggest", rig, "--models", models[0], "--seed", seed, "--out", name).status == 0
    assert Path("a.csv").read_bytes() == Path("b.csv").read_bytes()
    assert Path("a.csv").read_bytes() != Path("c.csv").read_bytes()


def test_without_models_it_diagnoses(irt, monkeypatch, tmp_path: Path, rig: Path, models) -> None:
    asked = {}

    def diagnose(given, **options):
        asked.update(options, rig=given.path)
        return SimpleNamespace(
            summary="The board lags.",
            warnings=("run-1: fewer than 8 rows; remove it",),
            plausible=[SimpleNamespace(model=load_model(path), probability=0.5) for path in models[:2]],
            noise=NOISE,
        )

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(import_module("irt.diagnosis"), "diagnose", diagnose)
    status, said, _ = irt("suggest", rig, "--seed", "5", "--threads", "1")
    assert status == 0
    assert (asked["rig"], asked["seed"], asked["threads"]) == (rig, 5, 1)
    assert said.startswith("warning: run-1: fewer than 8 rows; remove it\nThe board lags.\nPlace the marble ")
    assert "lag and delay" in said
    assert (tmp_path / "suggest.csv").exists()


def test_the_folder_of_a_diagnosis_is_enough(irt, tmp_path: Path, rig: Path, models) -> None:
    """The plausible models are read from the folder, without another diagnosis."""
    folder = tmp_path / "diagnosed"
    folder.mkdir()
    for path in models:
        path.rename(folder / path.name)
    plausible = [{"model": "lag.toml", "probability": 0.9}, {"model": "delay.toml", "probability": 0.1}]
    content = {"summary": "The board lags.", "fit": {"noise": NOISE}, "plausible": plausible}
    (folder / "diagnosis.json").write_text(json.dumps(content))
    out = tmp_path / "next.csv"
    status, said, err = irt("suggest", rig, "--models", folder, "--out", out, "--threads", "1")
    assert (status, err) == (0, "")
    assert said.startswith("The board lags.\nPlace the marble ")
    assert "uncertainty about the true model (0.33 nats), " in said
    assert out.exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("rig", "--models", "rig"), "irt: rig: no diagnosis with plausible models; run irt diagnose again"),
        (("rig", "--models", "rig", "lag.toml"), "irt: --models: expected one folder of a diagnosis, "),
        (("none",), "irt: none: no such folder"),
        (("rig", "--models", "none.toml"), "irt: none.toml: no such file"),
        (("rig", "--models", "rig/run-0.csv"), "irt: rig/run-0.csv: broken TOML: "),
        (
            ("rig", "--models", "lag.toml", "--out", "rig/new.csv"),
            "irt: rig/new.csv: a file in the rig's folder ",
        ),
        (("rig", "--models", "lag.toml", "--out", "a/b.csv"), "irt: a/b.csv: cannot be written: "),
    ],
)
@pytest.mark.usefixtures("models")
def test_what_cannot_be_done(irt, monkeypatch, tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = irt("suggest", *words)
    assert (status, out) == (1, "")
    assert err.startswith(message)
    assert err.count("\n") == 1
