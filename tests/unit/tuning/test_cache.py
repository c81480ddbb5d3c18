import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.errors import IrtError
from irt.rig import load_rig
from irt.tuning import cache, pretrain
from irt.tuning.cache import cache_folder, need, obtain
from irt.tuning.drive import Drive
from irt.tuning.tensors import checkpoint_path


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Keep the user's own cache out of the tests."""
    monkeypatch.setenv("IRT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def quick(monkeypatch, recipe):
    """Train for a second only."""
    monkeypatch.setattr(cache, "Recipe", recipe)
    train = pretrain.pretrain
    monkeypatch.setattr(
        pretrain,
        "pretrain",
        lambda drive, path, **options: train(drive, path, **{**options, "recipe": recipe()}),
    )


@pytest.fixture
def needed(write_rig, wave):
    marble = rollouts([[0.05, 0.05, 1e-4, 20.0, 1.0]], wave)[0]
    return need(load_rig(write_rig({"run": (wave, marble)})))


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {}, "home/.cache/irt"),
        ("linux", {"XDG_CACHE_HOME": "/x"}, "/x/irt"),
        ("darwin", {"XDG_CACHE_HOME": "/x"}, "home/Library/Caches/irt"),
        ("win32", {}, "home/AppData/Local/irt/Cache"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/irt/Cache"),
        ("linux", {"IRT_CACHE": "/mine", "XDG_CACHE_HOME": "/x"}, "/mine"),
    ],
)
def test_each_platform_keeps_caches_in_its_place(monkeypatch, platform, variables, expected):
    for name in ("IRT_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(Path, "home", lambda: Path("home"))
    assert cache_folder().as_posix() == expected


@pytest.mark.slow
def test_a_network_is_trained_once(needed, quick, folder):
    steps = []
    first = obtain(needed, progress=lambda *step: steps.append(step))
    assert steps
    assert needed.path().parent == folder
    again = obtain(needed, progress=lambda *_: pytest.fail("trained again"))
    assert again.metadata == {"format": again.metadata["format"], **first.metadata}


def test_another_recording_is_another_place(needed):
    run = needed.rig_drive.runs[0]
    other = replace(needed.rig_drive, runs=(replace(run, knobs=run.knobs + 1e-3),))
    assert replace(needed, rig_drive=other, network_drive=other).path() != needed.path()


@pytest.mark.parametrize("keep", [0, 1000])
def test_a_broken_file_in_the_cache_is_made_anew(needed, quick, keep):
    obtain(needed)
    whole = needed.path().read_bytes()
    needed.path().write_bytes(whole[:keep])
    obtain(needed)
    assert needed.path().read_bytes() == whole


def test_a_stopped_training_goes_on(needed, quick):
    def stop(done, _, text):
        if text.startswith("training") and done == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        obtain(needed, progress=stop)
    steps = []
    obtain(needed, progress=lambda *step: steps.append(step))
    assert min(done for done, _, text in steps if text.startswith("training")) == 6


def test_a_broken_checkpoint_in_the_cache_is_left_behind(needed, quick):
    checkpoint = checkpoint_path(needed.path())
    checkpoint.parent.mkdir()
    checkpoint.write_bytes(b"half")
    assert obtain(needed).metadata["drive"] == needed.network_drive.digest
    assert not checkpoint.exists()


def test_a_cache_that_cannot_be_written_is_reported(needed, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("IRT_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(IrtError, match=r"cannot be made: .*set IRT_CACHE to a folder"):
        obtain(needed)


def test_a_network_of_another_drive_is_refused(needed, quick):
    obtain(needed)
    knobs = np.zeros((40, 2))
    run = replace(needed.rig_drive.runs[0], knobs=knobs)
    other = replace(needed.rig_drive, runs=(run,))
    with pytest.raises(IrtError, match="trained for another drive"):
        obtain(replace(needed, network_drive=other), needed.path())


def test_the_shipped_network_is_for_the_papers_drive():
    paper = Drive.paper()
    shipped = obtain(cache.Need([], paper, paper))
    assert shipped.metadata["drive"] == paper.digest
    assert shipped.metadata["command"].startswith("irt pretrain ")
    assert shipped.network.inputs == 200
