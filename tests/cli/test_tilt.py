"""Rigs with a measured tilt, as a user tunes, evaluates and simulates them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from irt.recording import CMD, load_recording, save_recording
from tilted_rigs import RANGES, tilted_recordings

TOML = '[recordings]\nstart = "moving"\n[parameters]\n' + "".join(
    f"{name} = {{ range = [{low}, {high}] }}\n" for name, (low, high) in RANGES.items()
)
EFFECTS = [{"name": "delay", "delay_s": 0.08}]


def written(folder, recordings, toml=TOML, *, marble=True, unit=1.0):
    folder.mkdir()
    for one in recordings:
        places = one.marble if marble else np.full_like(one.marble, np.nan)
        columns = {} if unit == 1.0 else {"columns": CMD}
        save_recording(
            folder / f"{one.name}.csv", one.knobs * unit, places, one.stamps, tilt=one.tilt, **columns
        )
    (folder / "rig.toml").write_text(toml)
    return folder


@pytest.fixture(scope="module")
def recordings():
    return tilted_recordings(EFFECTS, runs=3, rows=120)


@pytest.mark.slow
def test_tune_evaluate_and_simulate(irt, tmp_path, recordings) -> None:
    rig = written(tmp_path / "rig", recordings)
    out = tmp_path / "tuned"
    done = irt("tune", rig, "--effect", "delay", "--starts", "2", "--out", out)
    assert (done.status, done.err) == (0, "")
    numbers = json.loads((out / "fit.json").read_text())
    delay = numbers["effects"]["delay"]["delay_s"]
    assert delay["low"] < 0.08 < delay["high"]
    assert numbers["after"]["overall"]["tilt"]["mae_x_rad"] < 0.002
    assert "tilt predicted from commands" in done.out
    assert (out / "tilt.svg").is_file()
    assert "The tilt" in (out / "report.html").read_text()
    shown = irt("evaluate", out / "model.toml", rig, "--window", "1", "--out", tmp_path / "evaluated")
    assert shown.status == 0
    assert "windows of 1 s, played" in shown.out
    assert shown.out.count("mrad") == 2 * (len(recordings) + 1)
    predicted = tmp_path / "predicted.csv"
    assert (
        irt("simulate", out / "model.toml", "--commands", rig / "run-1.csv", "--out", predicted).status == 0
    )
    tilt = load_recording(predicted).tilt
    assert np.abs(tilt - recordings[0].tilt)[15:].mean() < 0.002


@pytest.mark.slow
def test_currents_of_either_sign(irt, tmp_path, recordings) -> None:
    toml = TOML.replace("[0.3, 2.0]", "[-0.02, 0.02]") + '[commands]\nunit = "mA"\n'
    rig = written(tmp_path / "rig", recordings, toml, unit=-100.0)
    out = tmp_path / "tuned"
    assert irt("tune", rig, "--effect", "delay", "--starts", "4", "--out", out).status == 0
    gears = json.loads((out / "fit.json").read_text())["parameters"]
    assert gears["gear_x"]["value"] == pytest.approx(-0.009, rel=0.05)
    assert gears["gear_y"]["value"] == pytest.approx(-0.011, rel=0.05)
    assert 'unit = "mA"' in (out / "model.toml").read_text()


@pytest.mark.slow
def test_commands_that_move_both_axes(irt, tmp_path) -> None:
    mixed = {"name": "gear_matrix", "x_from_y": 0.5, "y_from_x": -0.4}
    rig = written(
        tmp_path / "rig",
        tilted_recordings([mixed], runs=3, rows=120, seed=5),
        TOML + '[commands]\nunit = "PWM"\nmatrix = true\n',
        unit=2.0,
    )
    out = tmp_path / "tuned"
    assert irt("tune", rig, "--starts", "4", "--out", out).status == 0
    numbers = json.loads((out / "fit.json").read_text())
    assert numbers["parameters"]["gear_x"]["value"] == pytest.approx(0.45, rel=0.05)
    matrix = {name: one["value"] for name, one in numbers["effects"]["gear_matrix"].items()}
    assert matrix == pytest.approx({"x_from_y": 0.25, "y_from_x": -0.2}, rel=0.05)


@pytest.mark.slow
def test_runs_without_a_marble(irt, tmp_path, recordings) -> None:
    rig = written(tmp_path / "rig", recordings, marble=False)
    out = tmp_path / "tuned"
    done = irt("tune", rig, "--effect", "delay", "--starts", "2", "--out", out)
    assert (done.status, done.err) == (0, "")
    assert "No recording has both a moving marble" in done.out
    assert json.loads((out / "fit.json").read_text())["after"]["overall"]["free_run"] is None
    shown = irt("evaluate", out / "model.toml", rig, "--out", tmp_path / "evaluated")
    assert shown.status == 0
    assert "mrad" in shown.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--effect", "glue"], "glue"),
        (
            ["--effect", "delay.delay_s"],
            'unknown optional parameter of delay "delay_s"; possible: y_minus_x_s',
        ),
        (["--method", "es", "--effect", "delay"], "--effect belongs to --method least-squares; leave it out"),
    ],
)
def test_effects_that_cannot_be_asked_for(irt, tmp_path, recordings, words, message) -> None:
    rig = written(tmp_path / "rig", recordings)
    done = irt("tune", rig, *words, "--out", tmp_path / "tuned")
    assert done.status == 1
    assert message in done.err
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize(
    "words",
    [["diagnose"], ["suggest"], ["tune", "--method", "cma-es"]],
    ids=" ".join,
)
def test_places_alone_need_a_marble(irt, tmp_path, recordings, words) -> None:
    rig = written(tmp_path / "rig", recordings, marble=False)
    done = irt(words[0], rig, *words[1:], "--out", tmp_path / "out")
    assert done.status == 1
    assert "no recording has a marble" in done.err
    assert len(done.err.splitlines()) == 1
