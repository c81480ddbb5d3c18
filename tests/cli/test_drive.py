"""`irt drive`: commands for the first runs, in the format that every other verb reads."""

import numpy as np
import pytest

import irt as package
from irt.recording import load_commands


def test_each_run_is_ready_to_play(irt, tmp_path):
    done = irt("drive", "--out", tmp_path / "drive", "--seconds", "6", "--rate", "25", "--amplitude", "0.08")

    assert (done.status, done.err) == (0, "")
    files = sorted((tmp_path / "drive").iterdir())
    assert [file.name for file in files] == [f"run-{number}.csv" for number in range(1, 7)]
    for file in files:
        commands = load_commands(file)
        np.testing.assert_allclose(commands.stamps, np.arange(150) / 25)
        np.testing.assert_array_equal(commands.knobs[0], 0.0)
        np.testing.assert_array_equal(commands.start, 0.0)
        assert np.abs(commands.knobs).max() <= 0.08
        assert str(file) in done.out


def test_commands_that_were_not_played_are_no_recordings(irt, tmp_path):
    irt("drive", "--out", tmp_path / "drive")
    done = irt("tune", tmp_path / "drive", "--out", tmp_path / "tuned")
    assert done.status == 1
    assert "these look like commands to be played; play each file" in done.err
    assert not (tmp_path / "tuned").exists()


def test_commands_in_another_unit(irt, tmp_path):
    done = irt("drive", "--out", tmp_path, "--unit", "us", "--amplitude", "200", "--runs", "1")

    commands = load_commands(tmp_path / "run-1.csv")
    assert commands.columns == ("cmd_x", "cmd_y")
    assert 150 < np.abs(commands.knobs).max() <= 200
    assert "200 us" in done.out
    assert 'unit = "us"' in done.out


def test_drive_can_be_simulated(irt, tmp_path):
    irt("drive", "--out", tmp_path, "--runs", "1")
    rig = package.load_rig(package.__path__[0] + "/data/demo-rig")
    model = package.Model.from_rig(rig, {name: sum(ends) / 2 for name, ends in rig.ranges.items()})
    package.save_model(tmp_path / "model.toml", model)

    done = irt("simulate", tmp_path / "model.toml", "--commands", tmp_path / "run-1.csv")

    assert done.status == 0
    assert len(done.out.splitlines()) == 161


def test_another_seed_gives_another_drive(irt, tmp_path):
    for folder, seed in (("one", 1), ("again", 1), ("other", 2)):
        irt("drive", "--out", tmp_path / folder, "--runs", "1", "--seed", seed)
    one, again, other = ((tmp_path / name / "run-1.csv").read_bytes() for name in ("one", "again", "other"))
    assert one == again != other


def test_too_short_a_run_is_refused(irt, tmp_path):
    done = irt("drive", "--out", tmp_path / "drive", "--seconds", "1")
    assert done.status == 1
    assert "at least 24 rows, found 20" in done.err
    assert not (tmp_path / "drive").exists()


@pytest.mark.parametrize(
    "words", [["--amplitude", "0"], ["--rate", "-5"], ["--seconds", "nan"], ["--runs", "0"]]
)
def test_wrong_numbers_are_wrong_usage(irt, words):
    done = irt("drive", *words)
    assert done.status == 2
    assert "expected a" in done.err


def test_recordings_are_not_replaced(irt, tmp_path):
    irt("drive", "--out", tmp_path, "--runs", "2")
    lines = (tmp_path / "run-2.csv").read_text().splitlines()
    played = "\n".join([*lines[:2], lines[2][:-1] + "0.01,0.02", *lines[3:]]) + "\n"
    (tmp_path / "run-2.csv").write_text(played)

    done = irt("drive", "--out", tmp_path, "--seed", "1")

    assert (done.status, done.out) == (1, "")
    assert "run-2.csv: holds more than commands, and would be replaced; choose another --out" in done.err
    assert (tmp_path / "run-2.csv").read_text() == played


def test_commands_are_made_again_and_that_is_said(irt, tmp_path):
    irt("drive", "--out", tmp_path, "--runs", "1")
    done = irt("drive", "--out", tmp_path, "--runs", "1", "--seed", "1")
    assert (done.status, done.err) == (0, "")
    assert f"note: this replaces {tmp_path / 'run-1.csv'}" in done.out


def test_an_amplitude_in_degrees_is_refused(irt, tmp_path):
    done = irt("drive", "--out", tmp_path / "drive", "--amplitude", "5.7")
    assert done.status == 1
    assert "no knob of a labyrinth turns by 5.7 rad, more than half a turn" in done.err
    assert not (tmp_path / "drive").exists()
