"""The tilt under seal: what the diagnosis may read, what is refused, and what a check finds."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irt.errors import IrtError
from irt.model import Effect, Model
from irt.proof.real.seal import Folders, close, measured, seal, verify
from irt.recording import save_recording
from irt.rig import load_rig
from irt.tilt_errors import comparable, errors, predicted
from tilted_rigs import RANGES, ROW_S, TILT_NOISE_RAD, VALUES, ZERO, rig_of, tilted_recordings

TOML = '[recordings]\nstart = "moving"\n[parameters]\n' + "".join(
    f"{name} = {{ range = [{low}, {high}] }}\n" for name, (low, high) in RANGES.items()
)
DELAY = {"name": "delay", "delay_s": 2.5 * ROW_S}


@pytest.fixture(scope="module")
def recordings():
    return tilted_recordings([DELAY], runs=2, rows=60)


@pytest.fixture
def rig(tmp_path: Path, recordings):
    """Return a rig of two recordings and a sweep of the tilt without a marble."""
    folder = tmp_path / "rig"
    folder.mkdir()
    (folder / "rig.toml").write_text(TOML)
    for one in recordings:
        save_recording(folder / f"{one.name}.csv", one.knobs, one.marble, one.stamps, tilt=one.tilt)
    none = np.full_like(recordings[0].marble, np.nan)
    save_recording(
        folder / "sweep.csv", recordings[0].knobs, none, recordings[0].stamps, tilt=recordings[0].tilt
    )
    return load_rig(folder)


@pytest.fixture
def sealed(tmp_path: Path, rig) -> Folders:
    """Return a proof whose answer is one model."""
    folders = Folders(tmp_path / "proof")
    seal(folders, rig, "this code")
    folders.models.mkdir()
    (folders.models / "model.toml").write_text("")
    close(folders)
    return folders


def test_the_copy_has_commands_and_marble_and_no_tilt(tmp_path: Path, rig) -> None:
    folders = Folders(tmp_path / "proof")
    blind = seal(folders, rig, "this code")
    assert [one.name for one in blind.recordings] == ["run-1", "run-2"]
    assert blind.ranges == rig.ranges
    for one, other in zip(blind.recordings, rig.recordings, strict=False):
        assert one.tilt is None
        for field in ("knobs", "marble", "stamps"):
            np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    assert not any("tilt" in path.read_text() for path in folders.blind.glob("*.csv"))
    assert json.loads(folders.seal.read_text())["code"] == "this code"


def test_a_finished_proof_is_verified(sealed: Folders, rig) -> None:
    said = "3 recordings: seal, copy without tilt and answer are unchanged"
    assert verify(sealed.out) == f"{said}, and the copy is the rig without its tilt"
    rig.path.rename(rig.path.with_name("elsewhere"))
    assert verify(sealed.out) == f"{said}; the rig is not at {rig.path}, so the copy was not compared with it"


@pytest.mark.parametrize(
    ("altered", "message"),
    [
        ("seal.json", "not the seal of this answer"),
        ("answer/model.toml", "they were altered afterwards"),
        ("blind/run-1.csv", "not the recordings of the seal"),
        ("../rig/run-2.csv", "not the recordings of the seal"),
    ],
)
def test_what_was_altered_is_found(sealed: Folders, altered: str, message: str) -> None:
    path = sealed.out / altered
    path.write_text(path.read_text() + "\n")
    with pytest.raises(IrtError, match=message):
        verify(sealed.out)


def test_a_copy_that_was_never_the_rig_is_found(sealed: Folders) -> None:
    """Another blind copy with a seal of its own is self-consistent; the rig betrays it."""
    from irt.proof.seal import canonical, digests  # noqa: PLC0415

    path = sealed.blind / "run-1.csv"
    path.write_text(path.read_text() + "\n")
    content = json.loads(sealed.seal.read_text())
    sealed.seal.write_bytes(canonical({**content, "blind": digests(sealed.blind)}))
    close(sealed)
    with pytest.raises(IrtError, match=r"not the recordings of .*rig without their tilt"):
        verify(sealed.out)


def test_another_rig_in_the_same_folder_is_refused(sealed: Folders, rig) -> None:
    (rig.path / "run-2.csv").unlink()
    with pytest.raises(IrtError, match="another rig or other recordings; choose another --out"):
        seal(sealed, load_rig(rig.path), "this code")


def without_tilt(one):
    return replace(one, tilt=None)


def about_one_axis(one):
    return replace(one, tilt=one.tilt * [1.0, np.nan])


def without_stamps(one):
    return replace(one, stamps=None)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ([without_tilt, without_tilt], "no tilt measured about both axes"),
        ([about_one_axis, about_one_axis], "no tilt measured about both axes"),
        ([lambda one: one, without_tilt], "run-2: the tilt is not measured about both axes, as it is in"),
        ([without_stamps, without_stamps], "run-1, run-2: no stamps; add a column t_s"),
        ([lambda one: one, lambda one: one.cut(10)], "run-2: no tilt about both axes after the first 0.5 s"),
    ],
)
def test_rigs_without_a_label_are_refused(recordings, changed, message: str) -> None:
    rig = rig_of([change(one) for change, one in zip(changed, recordings, strict=True)])
    with pytest.raises(IrtError, match=re.escape(message)) as caught:
        measured(rig)
    assert "\n" not in str(caught.value)


def test_errors_separate_the_zero_from_shape_and_time(recordings) -> None:
    late = Model.from_rig(rig_of(recordings), VALUES, effects=[Effect("delay", {"delay_s": 2.5 * ROW_S})])
    prompt = Model.from_rig(rig_of(recordings), VALUES)
    right = errors([predicted(late, one) for one in recordings])
    wrong = errors([predicted(prompt, one) for one in recordings])
    for axis in range(2):
        assert right[axis].raw == pytest.approx(np.hypot(ZERO[axis], TILT_NOISE_RAD), rel=0.05)
        assert right[axis].zero == pytest.approx(TILT_NOISE_RAD, rel=0.15)
        assert wrong[axis].zero > 5.0 * right[axis].zero
        assert right[axis].gain <= right[axis].zero <= right[axis].raw


def test_a_gain_is_taken_away_last(recordings) -> None:
    steeper = np.array(VALUES) * [1.3, 1.3, 1.0, 1.0, 1.0]
    steep = Model.from_rig(rig_of(recordings), steeper, effects=[Effect("delay", {"delay_s": 2.5 * ROW_S})])
    x, _ = errors([predicted(steep, one) for one in recordings])
    assert x.gain == pytest.approx(TILT_NOISE_RAD, rel=0.15)
    assert x.zero > 3.0 * x.gain


def test_the_start_and_hidden_markers_are_not_compared(recordings) -> None:
    tilt = recordings[0].tilt.copy()
    tilt[30:33, 0] += 0.2
    kept = comparable(replace(recordings[0], tilt=tilt))
    assert np.isnan(kept[recordings[0].stamps < 0.5]).all()
    assert np.isnan(kept[30:33, 0]).all()
    assert np.isfinite(kept[34:]).all()


def test_a_real_labyrinth(shared: Path, tmp_path: Path) -> None:
    """Delays and lags fitted to other recordings of this rig explain most of its tilt."""
    rig = measured(load_rig(shared / "real" / "labyrinth"))
    blind = seal(Folders(tmp_path), rig, "this code")
    assert not blind.has_tilt
    five = [1.07, 1.10, 0.006, 7.97, 1.0]
    late = [Effect("delay", {"delay_s": 0.065, "y_minus_x_s": 0.02}), Effect("lag", {"time_constant_s": 0.1})]
    found = []
    for effects in ((), late):
        model = Model.from_rig(rig, five, effects=effects, time_step="continuous")
        found.append(errors([predicted(model, one) for one in rig.recordings]))
    for before, after in zip(*found, strict=True):
        assert after.zero < 0.55 * before.zero
        assert 0.0015 < after.zero < 0.006
