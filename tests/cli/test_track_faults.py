"""Faults of a video are reported in one line: a displaced board, a frozen camera."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from filmed_runs import RATE, write_commands
from irt.recording import load_recording

pytestmark = pytest.mark.slow

COUNT = 110
Pictures = list[np.ndarray]


@pytest.fixture(scope="module")
def shown(filmed) -> tuple[Pictures, np.ndarray]:
    """Return pictures of a run, and its commands (n, 2) [rad]."""
    folder, knobs, _ = filmed
    return [cv2.imread(str(folder / f"{index}.png")) for index in range(COUNT)], knobs


def moved(picture: np.ndarray, dx: float, scale: float = 1.0, dy: float = 0.0) -> np.ndarray:
    matrix = np.array([[scale, 0, dx], [0, scale, dy]], np.float32)
    return cv2.warpAffine(picture, matrix, (640, 480), borderValue=(40, 40, 40))


@pytest.fixture
def tracked(irt, tmp_path, shown) -> Callable:
    """Return a function that tracks pictures with their commands."""
    knobs = write_commands(tmp_path / "knobs.csv", shown[1])

    def track(pictures: Pictures):
        folder = tmp_path / "run"
        folder.mkdir()
        for index, picture in enumerate(pictures):
            cv2.imwrite(str(folder / f"{index}.png"), picture)
        out = tmp_path / "out"
        return irt("track", folder, "--fps", "30", "--out", out, "--commands", knobs, "--offset", "0"), out

    return track


def warnings(done) -> list[str]:
    return [line for line in done.out.splitlines() if line.startswith("warning: ")]


def test_a_board_that_leaves_the_picture(tracked, shown) -> None:
    done, out = tracked([moved(one, min(0, -8 * (i - 45))) for i, one in enumerate(shown[0])])
    # A warning of half a run's marble may stand beside it.
    assert len([line for line in warnings(done) if "the board is displaced in pictures" in line]) == 1
    ((first, *_),) = json.loads((out / "run.json").read_text())["away"]
    assert 40 <= first <= 60
    assert not load_recording(out / "run.csv").seen[first:].any()


def test_a_camera_that_stands_still(tracked, shown) -> None:
    pictures = shown[0]
    done, out = tracked([pictures[i if i < 40 or i > 70 else 40] for i in range(COUNT)])
    (line,) = warnings(done)
    assert "the camera froze in pictures 42 to 71" in line
    assert not load_recording(out / "run.csv").seen[41:70].any()


@pytest.mark.parametrize(
    ("turn", "said"),
    [
        (lambda one: cv2.rotate(one, cv2.ROTATE_180), "change the sign of marble_x and marble_y"),
        (lambda one: cv2.flip(one, 1), "change the sign of marble_x"),
    ],
    ids=["upside down", "mirrored"],
)
def test_a_picture_that_is_turned(tracked, shown, turn, said) -> None:
    done, _ = tracked([turn(one) for one in shown[0]])
    (line,) = warnings(done)
    assert said in line
    assert "if the picture is upside down, start --corners at the opposite corner" in line


def test_a_board_within_a_frame_before_an_unknown_lens(tracked, shown) -> None:
    """Which outline is the board's is asked, with a picture of all that were found."""

    def framed(picture: np.ndarray) -> np.ndarray:
        seen = moved(picture, 96, 0.7, 72)
        return cv2.rectangle(seen, (199, 136), (441, 344), (90, 150, 200), 8)

    done, out = tracked([framed(one) for one in shown[0][:20]])
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "outlines lie within each other" in done.err
    assert f"{out / 'run-outlines.png'} shows what was found" in done.err
    assert cv2.imread(str(out / "run-outlines.png")) is not None
    assert not (out / "run.csv").exists()


def test_two_boards(tracked, shown) -> None:
    other = moved(shown[0][0], 290, 0.62, 60)
    left = np.arange(640)[None, :, None] < 312
    done, _ = tracked([np.where(left, moved(one, 10, 0.62, 60), other) for one in shown[0]])
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "two things in the picture may be the board, about pixels" in done.err


def boxes(data: bytes, start: int, end: int) -> list[tuple[str, int, int]]:
    """Return kind, start and end of the boxes of an MP4 file between two places."""
    found = []
    while start < end:
        size, kind = struct.unpack_from(">I4s", data, start)
        found.append((kind.decode("latin1"), start, start + size))
        start += size
    return found


def with_durations(path: Path, durations: list[int]) -> None:
    """Give the pictures of an MP4 file, whose index comes last, durations of their own [its ticks]."""
    data = path.read_bytes()
    place, outer = (0, len(data)), []
    for wanted in ("moov", "trak", "mdia", "minf", "stbl", "stts"):
        start, end = next((start, end) for kind, start, end in boxes(data, *place) if kind == wanted)
        outer.append(start)
        place = start + 8, end
    assert max(one[2] for one in boxes(data, 0, len(data))) > outer[0] > data.index(b"mdat")
    table = struct.pack(">II", 0, len(durations)) + b"".join(struct.pack(">II", 1, one) for one in durations)
    new = bytearray(data[: outer[-1]] + struct.pack(">I4s", 8 + len(table), b"stts") + table + data[end:])
    grown = len(new) - len(data)
    for start in outer[:-1]:
        struct.pack_into(">I", new, start, struct.unpack_from(">I", new, start)[0] + grown)
    path.write_bytes(new)


def test_a_variable_frame_rate(irt, tmp_path, shown) -> None:
    path = tmp_path / "run.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE, (640, 480))
    for picture in shown[0]:
        writer.write(picture)
    writer.release()
    plain = cv2.VideoCapture(str(path))
    assert plain.get(cv2.CAP_PROP_FPS) == pytest.approx(RATE)
    plain.release()
    data = path.read_bytes()
    tick = struct.unpack_from(">I", data, data.index(b"stts") + 16)[0]
    # Every third picture is held twice as long as the others, and the whole as long as before.
    durations = [tick * 3 // (2 if i % 3 == 2 else 4) for i in range(COUNT)]
    with_durations(path, durations)
    done = irt("track", path, "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert "the frame rate varies" in done.out
    assert "times are from the file's own stamps" in done.out
    table = np.genfromtxt(tmp_path / "out" / "run.csv", delimiter=",", names=True)
    expected = np.concatenate([[0], np.cumsum(durations[:-1])]) / tick / RATE
    np.testing.assert_allclose(table["t_s"], expected, atol=2e-3)


def test_a_frame_rate_that_a_converter_doubled(irt, tmp_path, shown) -> None:
    """Each picture twice, which the encoder makes differ: the second is no place of the marble."""
    pictures, knobs = shown
    path = tmp_path / "run.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 2 * RATE, (640, 480))
    for picture in pictures:
        writer.write(picture)
        writer.write(picture)
    writer.release()
    commands = write_commands(tmp_path / "knobs.csv", knobs)
    out = tmp_path / "out"
    done = irt("track", path, "--commands", commands, "--offset", "0", "--out", out)
    assert (done.status, done.err) == (0, "")
    facts = json.loads((out / "run.json").read_text())
    # An encoder's pictures that depend on no other differ from those before as new ones do.
    assert 0.9 * COUNT <= facts["gaps"]["repeated"] <= COUNT
    assert facts["detection"] > 0.99
    assert facts["noise"] * facts["pixels_per_edge"] < 0.15
    recording = load_recording(out / "run.csv")
    assert len(recording.knobs) >= COUNT - 1
    assert recording.seen.mean() > 0.99
