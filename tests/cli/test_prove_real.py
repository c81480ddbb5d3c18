"""`irt prove --real`: a rig with a measured tilt, as its owner proves a diagnosis on it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from irt.proof.real import run as real
from irt.recording import load_recording, save_recording
from tilted_rigs import RANGES, ROW_S, TILT_NOISE_RAD, VALUES, tilted_recordings

TOML = '[recordings]\nstart = "moving"\n[parameters]\n' + "".join(
    f"{name} = {{ range = [{low}, {high}] }}\n" for name, (low, high) in RANGES.items()
)
DELAY_S, PLAY_RAD, BIAS_RAD = 2.5 * ROW_S, (0.02, 0.012), (0.006, -0.004)
EFFECTS = [
    {"name": "delay", "delay_s": DELAY_S},
    {"name": "backlash", "width_x_rad": PLAY_RAD[0], "width_y_rad": PLAY_RAD[1]},
    {"name": "tilt_bias", "bias_x_rad": BIAS_RAD[0], "bias_y_rad": BIAS_RAD[1]},
]


def written(folder: Path, *, tilts: int, runs: int = 3, rows: int = 110) -> Path:
    """Write a rig whose first recordings have a measured tilt."""
    folder.mkdir()
    for number, one in enumerate(tilted_recordings(EFFECTS, runs=runs, rows=rows, seed=1)):
        tilt = one.tilt if number < tilts else None
        save_recording(folder / f"{one.name}.csv", one.knobs, one.marble, one.stamps, tilt=tilt)
    (folder / "rig.toml").write_text(TOML)
    return folder


@pytest.mark.slow
def test_planted_delay_play_and_zero_hold_under_the_measured_tilt(irt, tmp_path, monkeypatch) -> None:
    rig, out = written(tmp_path / "rig", tilts=3), tmp_path / "proof"
    asked = ("prove", "--real", rig, "--out", out, "--jobs", "1")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    # Ctrl-C once the answer is sealed: nothing of the diagnosis is repeated.
    monkeypatch.setattr(real, "least_squares", interrupted)
    done = irt(*asked)
    assert done.status == 130
    assert "the same command resumes it" in done.err
    assert not (out / "proof.json").exists()
    monkeypatch.undo()
    monkeypatch.setattr(real, "diagnose", interrupted)
    done = irt(*asked)
    assert (done.status, done.err) == (0, "")

    content = json.loads((out / "proof.json").read_text())
    assert set(content["effects"]) >= {"delay", "backlash", "tilt_bias"}
    found = {(one["quantity"], one["axis"]): one for one in content["quantities"]}
    for axis, gear, width, bias in zip("xy", VALUES, PLAY_RAD, BIAS_RAD, strict=False):
        truth = {"gain": gear, "delay": DELAY_S, "late": DELAY_S, "play": gear * width, "zero": bias}
        for quantity, value in truth.items():
            one = found[quantity, axis]
            assert one["intervals_overlap"], one
            for kind in ("predicted", "measured"):
                assert one[kind]["low"] <= value <= one[kind]["high"], (kind, one)
        errors = content["rms_rad"]
        assert errors["diagnosed"][axis]["zero"] < 1.5 * TILT_NOISE_RAD
        assert errors["tuned"][axis]["zero"] > 5.0 * TILT_NOISE_RAD
    assert all(run["held_out"] for run in content["runs"])

    page = (out / "report.html").read_text()
    assert page.count("<svg") == 1 + 3
    assert "12 of 12" in page
    assert f"SHA-256 {json.loads((out / 'answer.json').read_text())['seal']}" in page
    assert (
        irt("prove", "--verify", "--out", out)
        .out.strip()
        .endswith("answer are unchanged, and the copy is the rig without its tilt")
    )
    path = out / "answer" / "model.toml"
    path.write_text(path.read_text() + "\n")
    done = irt("prove", "--verify", "--out", out)
    assert done.status == 1
    assert "they were altered afterwards" in done.err


@pytest.mark.parametrize(
    ("tilts", "words", "message"),
    [
        (0, [], "no tilt measured about both axes (columns tilt_x_rad, tilt_y_rad)"),
        (1, [], "run-2: the tilt is not measured about both axes, as it is in the other recordings"),
        (2, ["--rigs", "3"], "--rigs belongs to simulated rigs; leave it out with --real"),
        (2, ["--full"], "--full belongs to simulated rigs; leave it out with --real"),
    ],
)
def test_what_cannot_be_proved_is_one_line(irt, tmp_path, tilts, words, message) -> None:
    rig = written(tmp_path / "rig", tilts=tilts, runs=2, rows=40)
    done = irt("prove", "--real", rig, *words, "--out", tmp_path / "proof")
    assert done.status == 1
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert not (tmp_path / "proof").exists()


def test_the_diagnosis_gets_no_tilt(irt, tmp_path, monkeypatch) -> None:
    rig, seen = written(tmp_path / "rig", tilts=2, runs=2, rows=40), []

    def watch(given, **_: object) -> None:
        seen.append(given)
        raise KeyboardInterrupt

    monkeypatch.setattr(real, "diagnose", watch)
    assert irt("prove", "--real", rig, "--out", tmp_path / "proof").status == 130
    (blind,) = seen
    assert not blind.has_tilt
    for one in blind.recordings:
        np.testing.assert_array_equal(one.marble, load_recording(rig / f"{one.name}.csv").marble)
        assert "tilt" not in one.path.read_text()
