"""`irt prove --transfer` as a user runs it: what is there is kept, and every refusal is one line."""

import json

import pytest

import irt as package
from irt.environment.vector import default_model
from irt.errors import IrtError
from irt.proof.transfer import prove

pytest.importorskip("mujoco", reason="the concealed rigs are moved by MuJoCo")
pytest.importorskip("gymnasium", reason="the controller plans along the path of an environment's task")

ARMS = ("tuned", "delayed", "randomised", "diagnosed", "truth")


@pytest.fixture
def finished(tmp_path):
    """Return the folder of a proof of one rig, of which all but the page is there."""
    folder = tmp_path / "transfer" / "rig-0"
    folder.mkdir(parents=True)
    label = {"values": [0.05, 0.05, 4e-4, 14.0, 1.0], "noise": 1e-3, "effects": []}
    (folder / "label.json").write_text(json.dumps(label))
    (folder / "errors.json").write_text(json.dumps(dict.fromkeys(ARMS, 0.01)))
    for name in ("tuned", "delayed", "diagnosed"):
        package.save_model(folder / f"{name}.toml", default_model())
    for arm in ARMS:
        ended = "fell" if arm == "tuned" else "arrived"
        runs = [{"ended": ended, "progress": 1.0, "seconds": 9.0, "beside_mm": 4.0}] * 5
        for task in ("bare", "cyberrunner-easy"):
            (folder / f"{task}-{arm}.json").write_text(json.dumps(runs))
    return folder.parent


@pytest.mark.slow
def test_a_finished_proof_is_written_again_from_its_files(irt, finished):
    was = {path: path.stat().st_mtime_ns for path in finished.rglob("*.json")}
    done = irt("prove", "--transfer", "--rigs", "1", "--jobs", "1", "--out", finished)
    assert (done.status, done.err) == (0, "")
    assert done.out.endswith(f"\nwrote {finished / 'transfer.md'}\n")
    page = (finished / "transfer.md").read_text()
    assert "| Labyrinth with 8 holes, planned, 1 rig | 0 %, 4.0 mm | 100 %, 4.0 mm |" in page
    assert "learned policy" not in page
    assert {path: path.stat().st_mtime_ns for path in finished.rglob("*.json")} == was


@pytest.mark.slow
def test_a_broken_file_of_an_earlier_run_is_one_line(irt, finished):
    broken = finished / "rig-0" / "label.json"
    broken.write_text("{")
    done = irt("prove", "--transfer", "--rigs", "1", "--jobs", "1", "--out", finished)
    assert done.status == 1
    assert done.err.startswith(f"irt: the proof by transfer: {broken}: broken JSON: ")
    assert done.err.count("\n") == 1
    assert not (finished / "transfer.md").exists()


def test_an_installed_package_has_no_concealed_rigs(tmp_path):
    with pytest.raises(IrtError, match="run it from a checkout of the project"):
        prove(tmp_path / "out", tmp_path / "page.md", rigs=1, jobs=1, checkout=tmp_path)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--full",), "--full belongs to the proof by concealment; leave it out with --transfer"),
        (("--seed", "1"), "--seed belongs to the proof by concealment; leave it out with --transfer"),
        (("--nulls", "2"), "--nulls belongs to the proof by concealment; leave it out with --transfer"),
        (("--rigs", "0"), "--rigs: a proof by transfer needs at least one rig"),
        (("--real", "rig"), "--transfer belongs to simulated rigs; leave it out with --real"),
    ],
)
def test_what_does_not_belong_to_it_is_refused(irt, words, message):
    done = irt("prove", "--transfer", *words)
    assert (done.status, done.err) == (1, f"irt: {message}\n")
