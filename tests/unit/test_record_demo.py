"""The rig of `irt demo`: what it holds, and that the script that made it makes it again."""

from pathlib import Path

import numpy as np
import pytest

from irt.rig import load_rig
from irt.suggestion.first_runs import first_runs

FOLDER = Path(__file__).resolve().parents[2] / "python" / "irt" / "data" / "demo-rig"


def test_script_writes_the_shipped_files_again_byte_for_byte(tmp_path):
    pybullet = pytest.importorskip("pybullet", reason="PyBullet has wheels up to Python 3.11 only")
    del pybullet
    record_demo = pytest.importorskip("record_demo")
    if f"PyBullet {record_demo.version('pybullet')} " not in (FOLDER / "README.md").read_text():
        pytest.skip("the shipped files were recorded by another version of PyBullet")
    record_demo.main(["--out", f"{tmp_path}"])
    shipped, written = (
        {file.name: file.read_bytes() for file in folder.iterdir()} for folder in (FOLDER, tmp_path)
    )
    assert written == shipped


def test_runs_are_those_of_irt_drive_with_stamps():
    recordings = load_rig(FOLDER).recordings
    made = first_runs(160, 0.05)
    assert len(recordings) == len(made) == 6
    for recording, one in zip(recordings, made, strict=True):
        np.testing.assert_allclose(recording.knobs, one.commands, atol=1e-6)
        np.testing.assert_allclose(np.diff(recording.stamps), 0.05, atol=1e-6)
