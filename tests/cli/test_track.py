"""`irt track` as a user types it, on rendered runs whose truth is known."""

from __future__ import annotations

import io
import json
import re
import shutil
from contextlib import redirect_stderr
from pathlib import Path

import cv2
import numpy as np
import pytest

import irt as package
from filmed_runs import BACKLASH, LENS, RATE, VIEW, film, played, write_commands
from irt.cli.__main__ import main
from irt.recording import load_recording
from irt.tracking.calibration import save_lens
from irt.tracking.geometry import Lens
from tracking.board import Paint
from tracking.scene import Look, Scene


@pytest.fixture(scope="module")
def tracked(filmed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a rig with the filmed run, tracked through a calibrated lens."""
    pictures, knobs, _ = filmed
    out = tmp_path_factory.mktemp("tracked") / "rig"
    out.mkdir()
    save_lens(out / "camera.toml", LENS, 12)
    commands = write_commands(out.parent / "knobs.csv", knobs, 100.0)
    words = ("--fps", "30", "--out", out, "--commands", commands, "--offset", "-100")
    said = io.StringIO()
    with redirect_stderr(said):
        status = main([str(word) for word in ("track", pictures, *words)])
    assert (status, said.getvalue()) == (0, "")
    return out


@pytest.mark.slow
def test_images_become_a_recording(irt, filmed, tracked) -> None:
    _, knobs, scene = filmed
    out = tracked
    recording = load_recording(out / "run-1.csv")
    np.testing.assert_array_equal(recording.knobs, knobs)
    missed_mm = 276 * (recording.marble - scene.places)
    assert recording.seen.mean() > 0.99
    assert np.sqrt(np.nanmean(missed_mm**2)) < 0.5
    written = json.loads((out / "run-1.json").read_text())
    assert written["detection"] > 0.99
    assert written["height"].startswith("corrected")
    assert written["tilt"].startswith("measured in each picture by the board's sides, noise ")
    assert recording.tilt is not None
    apart = recording.tilt - scene.tilts
    assert (apart.std(axis=0) < 2.0 * np.array(written["tilt_noise_rad"])).all()
    assert irt("check", out).status == 0
    assert written["corners_mm"] < 0.5
    assert written["shadow"] < 0.01
    assert written["corners"]["found_by"] == "found in the first picture"
    page = (out / "run-1-report.html").read_text()
    # Four letters of a picture's data may spell it, too.
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert f"{written['budget_mm']['total']:.2f} mm" in words
    assert "What may be wrong with this track?" not in words
    assert "http" not in words.replace("http-equiv", "").replace("http://www.w3.org", "")
    assert cv2.imread(str(out / "run-1-unsure.png")) is not None
    video = cv2.VideoCapture(str(out / "run-1-overlay.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 110
    assert not list(out.glob("*.partial"))


@pytest.mark.slow
def test_a_video_alone_is_enough(irt, filmed, tmp_path) -> None:
    pictures, _, scene = filmed
    writer = cv2.VideoWriter(str(tmp_path / "run.avi"), cv2.VideoWriter_fourcc(*"MJPG"), RATE, (640, 480))
    for index in range(60):
        writer.write(cv2.imread(str(pictures / f"{index}.png")))
    writer.release()
    done = irt("track", tmp_path / "run.avi", "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert "no commands are known" in done.out
    table = np.genfromtxt(tmp_path / "out" / "run.csv", delimiter=",", names=True)
    seen = np.column_stack([table["marble_x"], table["marble_y"]])
    np.testing.assert_allclose(table["t_s"], np.arange(60) / RATE, atol=1e-3)
    assert np.nanmax(np.abs(seen - scene.places[:60])) < 0.03


@pytest.mark.slow
def test_bad_input_is_one_line(irt, filmed, tmp_path) -> None:
    pictures = filmed[0]
    out = tmp_path / "out"
    text = tmp_path / "notes.mp4"
    text.write_text("this is no video")
    save_lens(tmp_path / "small.toml", Lens(VIEW.matrix, VIEW.distortion, (320, 240), 0.1), 12)
    still = tmp_path / "still"
    still.mkdir()
    for index in range(8):
        shutil.copy(pictures / "0.png", still / f"{index}.png")
    empty = tmp_path / "empty"
    empty.mkdir()
    for words, said in (
        ((tmp_path / "none.mp4",), "no such file"),
        ((text,), "no video that can be opened"),
        ((empty,), "holds no images"),
        ((still,), "nothing like a marble moves"),
        ((pictures, "--lens", tmp_path / "small.toml"), "calibration is of pictures of 320 x 240"),
        ((pictures, "--corners", "170,390", "470,390", "470,140", "170,140"), "anticlockwise"),
    ):
        done = irt("track", *words, "--out", out)
        assert done.status == 1, words
        assert said in done.err
        assert done.err.count("\n") == 1
        assert not list(out.glob("*.csv"))


@pytest.mark.slow
def test_a_track_that_fits_no_commands_is_kept(irt, filmed, tmp_path) -> None:
    pictures, knobs, _ = filmed
    commands = write_commands(tmp_path / "knobs.csv", knobs)
    words = ("--fps", "30", "--commands", commands, "--offset", "500")
    done = irt("track", pictures, "--out", tmp_path / "out", *words)
    assert done.status == 1
    kept = tmp_path / "out" / "run-1.partial"
    assert "the commands and the pictures do not overlap" in done.err
    assert done.err.endswith(f"; the positions found before are kept in {kept}\n")
    assert done.err.count("\n") == 1
    assert len(kept.read_text().splitlines()) == 111
    assert not list((tmp_path / "out").glob("*.csv"))


@pytest.mark.slow
def test_the_package_tracks_as_the_verb_does(filmed, tracked, tmp_path) -> None:
    pictures, _, _ = filmed
    lens, commands = tracked / "camera.toml", tracked.parent / "knobs.csv"
    found = package.track(
        pictures, fps=30.0, out=tmp_path / "out", lens=lens, commands=commands, offset=-100.0
    )
    assert found.recording is not None
    assert found.summary.pictures == 110
    assert found.page.exists()
    assert found.path.read_text() == (tracked / "run-1.csv").read_text()
    with pytest.raises(package.IrtError, match='unknown option of track "colr"; did you mean "colour"'):
        package.track(pictures, colr=(0, 0, 0))


@pytest.mark.slow
def test_two_marbles_are_said(irt, tmp_path) -> None:
    _, places, tilts = played(45, 3)
    _, others, _ = played(45, 8)
    film(tmp_path / "two", tilts, places + np.array([0.15, 0.1]), second=others - np.array([0.15, 0.1]))
    done = irt("track", tmp_path / "two", "--out", tmp_path / "out")
    assert done.status == 1
    assert "two marbles move on the board" in done.err


@pytest.mark.slow
def test_a_picture_that_cannot_be_read_keeps_what_was_seen(irt, filmed, tmp_path) -> None:
    pictures = filmed[0]
    broken = tmp_path / "broken"
    broken.mkdir()
    for index in range(60):
        shutil.copy(pictures / f"{index}.png", broken / f"{index}.png")
    cv2.imwrite(str(broken / "50.png"), np.zeros((240, 320, 3), np.uint8))
    # The sample that is learned from passes over it.
    done = irt("track", broken, "--out", tmp_path / "out")
    assert done.status == 1
    assert done.err.count("\n") == 1
    if "is kept" in done.err:
        assert len((tmp_path / "out" / "broken.csv").read_text().splitlines()) == 51


@pytest.mark.slow
def test_markers_on_the_board_take_its_tilt_away(irt, tmp_path) -> None:
    _, places, tilts = played(60, 4)
    steep = 6.0 * tilts
    scene = Scene(VIEW, Paint(lines=0, holes=0, markers=0.03), Look("red"), places * 0.6, steep, seed=6)
    folder = tmp_path / "marked"
    folder.mkdir()
    for index, (picture, _) in enumerate(scene.frames()):
        cv2.imwrite(str(folder / f"{index}.png"), picture)
    lens = tmp_path / "lens.toml"
    save_lens(lens, LENS, 12)
    done = irt("track", folder, "--lens", lens, "--out", tmp_path / "out", "--fps", "30")
    assert (done.status, done.err) == (0, "")
    assert "in each picture" in done.out, done.out
    table = np.genfromtxt(tmp_path / "out" / "marked.csv", delimiter=",", names=True)
    missed = np.column_stack([table["marble_x"], table["marble_y"]]) - scene.places
    assert np.sqrt(np.nanmean(missed**2)) * 276 < 0.4
    facts = json.loads((tmp_path / "out" / "marked.json").read_text())
    assert facts["tilt_written"]
    apart = np.column_stack([table["tilt_x_rad"], table["tilt_y_rad"]]) - scene.tilts
    ratio = np.nanstd(apart, axis=0) / facts["tilt_noise_rad"]
    assert (ratio < 2.0).all(), ratio


@pytest.mark.slow
def test_the_whole_story(irt, tracked, tmp_path) -> None:
    """Frames of a tilting board with backlash in its knobs: tracked, diagnosed, named."""
    out = tmp_path / "rig"
    out.mkdir()
    for name in ("camera.toml", "run-1.csv"):
        shutil.copy(tracked / name, out / name)
    for seed in (20, 21):
        knobs, places, tilts = played(60, seed, BACKLASH)
        film(tmp_path / f"run-{seed}", tilts, places)
        commands = write_commands(tmp_path / f"knobs-{seed}.csv", knobs)
        words = ("--fps", "30", "--commands", commands, "--offset", "0", "--out", out)
        assert irt("track", tmp_path / f"run-{seed}", *words).status == 0
    done = irt("diagnose", out, "--out", tmp_path / "diagnosed")
    assert done.status == 0, done.err
    found = json.loads((tmp_path / "diagnosed" / "diagnosis.json").read_text())
    assert "backlash" in [effect["name"] for effect in found["effects"]]
