"""The sample rigs: what they hold, and that the script that made them makes them again."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.rig import PARAMETERS, load_rig

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "python" / "irt" / "data"
SCRIPT = ROOT / "benches" / "record_pybullet.py"
FOLDERS = ("labyrinth", "labyrinth-heldout")


@pytest.fixture(scope="module")
def script():
    pytest.importorskip("pybullet", reason="PyBullet has wheels up to Python 3.11 only: pip install pybullet")
    spec = importlib.util.spec_from_file_location("record_pybullet", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["record_pybullet"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["record_pybullet"]


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_script_writes_the_shipped_files_again_byte_for_byte(script, tmp_path):
    readme = (DATA / "labyrinth" / "README.md").read_text()
    if f"PyBullet {script.version('pybullet')} " not in readme:
        pytest.skip("the shipped files were recorded by another version of PyBullet")
    script.main(["--out", f"{tmp_path}"])
    shipped = {Path(name) / path: data for name in FOLDERS for path, data in files(DATA / name).items()}
    assert files(tmp_path) == shipped


def test_another_seed_gives_another_recording(script, tmp_path):
    script.main(["--out", f"{tmp_path}", "--seed", "2"])
    one, other = (load_rig(folder / "labyrinth").recordings[0].marble for folder in (DATA, tmp_path))
    assert 0 < np.abs(one - other).max() < 0.02


def test_help_says_what_it_does(script, capsys):
    with pytest.raises(SystemExit) as exit_:
        script.main(["--help"])
    assert exit_.value.code == 0
    assert "Record the sample rigs in PyBullet" in capsys.readouterr().out


@pytest.mark.parametrize("friction", [1e-4, 4e-4, 1e-3])
def test_rolling_friction_is_the_tilt_at_which_the_marble_starts(script, friction):
    truth = script.Truth(gear_x=0.1, gear_y=0.1, rolling_friction=friction)

    def travel(share):
        tilted = np.full((21, 2), [0.0, share * friction / truth.gear_y])
        return script.simulate(truth, tilted, (0.0, 0.0))[-1, 0]

    time = 20 * truth.time_scale * script.SUBSTEP_S

    # What Bullet's solver leaves of a marble that sticks is a creep of micrometres a second.
    assert abs(travel(0.97)) < 5e-6
    assert travel(1.03) == pytest.approx(5 / 14 * script.GRAVITY * 0.03 * friction * time**2, rel=0.1)


def test_marble_accelerates_as_theory_says(script):
    truth = script.Truth(time_scale=1)
    commands = np.tile([0.1, 0.1], (40, 1))
    position = script.simulate(truth, commands, (0.0, 0.0))
    acceleration = np.diff(position, 2, axis=0).mean(axis=0) * 240**2
    drive = np.array([np.sin(0.1 * truth.gear_y), -np.sin(0.1 * truth.gear_x)])
    direction = drive / np.hypot(*drive)
    expected = 5 / 7 * script.GRAVITY * (drive - truth.rolling_friction * direction)
    np.testing.assert_allclose(acceleration, expected, rtol=1e-3)


def test_walls_give_way_by_less_than_the_tracker_sees(script):
    truth = script.Truth()
    for run in script.training_runs()[:1] + script.heldout_runs(np.random.default_rng(0)):
        position = script.simulate(truth, run.knobs, run.start_m)
        reach = np.array(script.EDGES_M) / 2 - script.RADIUS_M
        assert (np.abs(position) < reach + 2e-4).all()


def test_sample_is_the_papers_drive_from_the_centre():
    recordings = load_rig(DATA / "labyrinth").recordings
    phase = 2 * np.pi * np.arange(100) / 100
    assert len(recordings) == 4
    for recording in recordings:
        np.testing.assert_allclose(recording.knobs[:, 0], 0.1 * np.sin(phase), atol=1e-6)
        np.testing.assert_allclose(recording.knobs[:, 1], 0.1 * np.cos(phase), atol=1e-6)
        assert np.abs(recording.marble[0]).max() < 0.01
        assert recording.stamps is None
    noise = np.diff([recording.marble for recording in recordings], axis=0)
    assert np.nanmedian(np.abs(noise)) > 1e-3


def test_runs_held_out_have_other_drives_and_starts():
    shown, heldout = (load_rig(DATA / name) for name in FOLDERS)
    assert len(heldout.recordings) == 4
    seen = [recording.knobs[:100] for recording in shown.recordings]
    for recording in heldout.recordings:
        assert all(np.abs(recording.knobs[:100] - knobs).max() > 0.05 for knobs in seen)
        assert np.hypot(*recording.marble[0]) > 0.05
        seen.append(recording.knobs[:100])


def test_trackers_lose_the_marble_and_take_something_else_for_it():
    rigs = [load_rig(DATA / name) for name in FOLDERS]
    recordings = {recording.name: recording for rig in rigs for recording in rig.recordings}
    assert (~recordings["run-2"].seen).sum() == 8
    assert (~recordings["multisine"].seen).sum() == 3
    jumps = np.abs(np.diff(recordings["run-3"].marble, 2, axis=0)).max(axis=1)
    assert (jumps > 0.05).sum() == 6  # two rows, each in three second differences


def test_sample_is_small():
    assert sum(len(data) for name in FOLDERS for data in files(DATA / name).values()) < 100_000


def test_simulation_with_the_truth_agrees_while_the_marble_rolls_slowly_off_the_rim(script):
    """Two engines, one physics: what tuning recovers is the truth, not something that makes up for Bullet."""
    truth = script.Truth()
    values = [[*(getattr(truth, name) for name in PARAMETERS)]]
    reach = np.array(script.EDGES_M) / 2 - script.RADIUS_M
    for run in script.training_runs()[:1] + script.heldout_runs(np.random.default_rng(0)):
        position = script.simulate(truth, run.knobs, run.start_m)
        recorded = position / script.EDGES_M[0] * truth.observation_scale
        (simulated,) = rollouts(values, run.knobs, start=recorded[0])
        speed = np.hypot(*np.diff(position, axis=0, prepend=position[:1]).T) / truth.time_scale * 240
        other = (speed > 0.055) | (np.abs(position) > reach - 1e-3).any(axis=1)
        alike = np.argmax(other) if other.any() else len(position)
        assert alike > 25
        np.testing.assert_allclose(simulated[:alike], recorded[:alike], atol=2e-4)
