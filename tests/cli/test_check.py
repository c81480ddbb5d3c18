"""`irt check` as a user runs it, and what `irt tune` does with its warnings."""

import json

import numpy as np
import pytest

from irt.cli.demo import data
from irt.engine import rollouts
from simulated_rigs import STEP_S, TRUTH, drive


@pytest.fixture
def simulated():
    """Return recordings of two runs by name, as `write_rig` takes them."""
    random = np.random.default_rng(0)
    found = {}
    for number in (1, 2):
        knobs = drive(120, number)
        marble = rollouts(TRUTH, knobs, time_step="continuous")[0]
        noisy = marble + 0.001 * random.standard_normal(marble.shape)
        found[f"run-{number}"] = (knobs, noisy, STEP_S * np.arange(120))
    return found


def test_it_prints_a_page(irt, write_rig, simulated):
    done = irt("check", write_rig(simulated))
    assert (done.status, done.err) == (0, "")
    assert max(map(len, done.out.splitlines())) <= 110
    for word in ("run-1", "marble_x", "knob_y_rad -> marble_x", "gear_x", "to record next"):
        assert word in done.out
    assert "warnings" not in done.out


def test_json_holds_all_of_it(irt, write_rig, simulated):
    done = irt("check", write_rig(simulated), "--json")
    found = json.loads(done.out)
    assert set(found) == {"rig", "runs", "signals", "responses", "identified", "findings", "next_recording"}
    assert [one["name"] for one in found["runs"]] == ["run-1", "run-2"]
    assert found["runs"][0]["rate_hz"] == pytest.approx(1.0 / STEP_S)
    assert {one["effect"] for one in found["identified"]["effects"]} >= {"delay", "lag", "backlash"}


def test_recordings_that_identify_nothing_end_with_1_and_one_line(irt, write_rig, simulated):
    still = {name: (knobs, np.zeros_like(marble)) for name, (knobs, marble, _) in simulated.items()}
    rig = write_rig(still)
    done = irt("check", rig)
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "the marble never moves" in done.err
    assert "tilt the board more" in done.err


@pytest.mark.parametrize("verb", ["tune", "diagnose"])
def test_no_fit_begins_on_them(irt, write_rig, simulated, tmp_path, verb):
    still = {name: (knobs, np.zeros_like(marble)) for name, (knobs, marble, _) in simulated.items()}
    done = irt(verb, write_rig(still), "--out", tmp_path / "out")
    assert done.status == 1
    assert "the marble never moves" in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_tune_passes_warnings_on(irt, write_rig, simulated, tmp_path):
    mirrored = {name: (knobs, marble * [-1.0, 1.0], t) for name, (knobs, marble, t) in simulated.items()}
    out = tmp_path / "out"
    done = irt("tune", write_rig(mirrored), "--out", out, "--starts", "1")
    assert done.status == 0
    assert done.out.startswith("warning: axes:")
    (warning,) = json.loads((out / "fit.json").read_text())["warnings"]
    assert "change the sign of marble_x" in warning
    assert "What is wrong with the recordings?" in (out / "report.html").read_text()


@pytest.mark.slow
def test_a_sound_rig_has_no_warnings_in_its_results(irt, tmp_path):
    out = tmp_path / "out"
    done = irt("tune", data("labyrinth"), "--out", out, "--starts", "1")
    assert "warning" not in done.out
    assert json.loads((out / "fit.json").read_text())["warnings"] == []
    assert "What is wrong with the recordings?" not in (out / "report.html").read_text()


def test_endings_in_capitals_are_read(irt, write_rig, simulated):
    rig = write_rig(simulated)
    (rig / "run-2.csv").rename(rig / "run-2.CSV")
    done = irt("check", rig, "--json")
    assert [one["name"] for one in json.loads(done.out)["runs"]] == ["run-1", "run-2"]
