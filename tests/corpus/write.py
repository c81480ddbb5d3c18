"""Write the seeds that fuzzing begins with: small valid files of each kind that the package reads.

python tests/corpus/write.py
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from pathlib import Path

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

import lab_logs
import rig_bags
from irt.engine import rollouts
from irt.fitting.unfinished import Unfinished, answered
from irt.recording import CMD, save_recording
from irt.tuning.tensors import write_tensors
from irt.tuning.tunenet import FORMAT

HERE = Path(__file__).parent


def recordings() -> None:
    """A recording with stamps and tilt, one with commands in a unit of its own, and other labs' tables."""
    knobs = 0.05 * np.sin(np.arange(24.0).reshape(12, 2) / 3.0)
    places, tilts = rollouts([[0.08, 0.07, 4e-4, 8.0, 1.0]], knobs, tilt=True)
    marble = places[0]
    marble[4] = np.nan
    save_recording(HERE / "run.csv", knobs, marble, np.arange(12) / 30.0, tilt=tilts[0])
    save_recording(HERE / "cmd.csv", 1000.0 * knobs, marble, columns=CMD)
    rows = np.arange(40)
    waves = np.sin(rows[:, None] / np.array([3.0, 5.0]))
    lab_logs.write_csv(
        HERE / "without-ros.csv",
        {
            "t": np.round(rows / 40.0, 4),
            "episode": rows // 20,
            "step": rows % 20,
            "xb": np.round(0.05 * waves[:, 0], 5),
            "yb": np.round(0.05 * waves[:, 1], 5),
            "alpha": np.round(0.01 * waves[:, 1], 5),
            "beta": np.round(0.01 * waves[:, 0], 5),
            "a0": np.round(waves[:, 0], 4),
            "a1": np.round(waves[:, 1], 4),
            "ball_found": [int(row != 7) for row in rows],
        },
    )


def bags(scratch: Path) -> None:
    """Bags of `rig`, with and without compression, and bags of another lab in MCAP and sqlite3."""
    rig_bags.Writer = lambda stream: Writer(stream, compression=CompressionType.NONE)
    rig_bags.recorded(HERE / "rig.mcap", ticks=40, begin=10, stop=0.35)
    rig_bags.Writer = Writer
    rig_bags.recorded(HERE / "rig-zstd.mcap", ticks=40, begin=10)
    truth = lab_logs.simulate(np.random.default_rng(0), seconds=0.5, spoil=False)
    plain = lab_logs.Convention(np.ones(2), False, np.ones(2), 0.0)
    for name, storage, offset in (("lab", "mcap", 0.01), ("lab", "sqlite3", None)):
        folder = lab_logs.write_bag(scratch / storage, truth, plain, storage=storage, header_offset=offset)
        (file,) = [one for one in folder.iterdir() if one.suffix in {".mcap", ".db3"}]
        shutil.copyfile(file, HERE / f"{name}{file.suffix}")
    with contextlib.closing(sqlite3.connect(HERE / "lab.db3")) as base:
        base.execute("PRAGMA page_size = 512")
        base.execute("VACUUM")


def others(scratch: Path) -> None:
    """A replay, the answers of an unfinished diagnosis, a file of tensors, and videos."""
    states = np.round(0.5 + 0.1 * np.sin(np.arange(80.0).reshape(20, 4)), 3)
    np.savez(
        HERE / "replay.npz",
        states=states,
        action=states[:, :2],
        is_first=np.arange(20) % 10 == 0,
        allow_pickle=False,
    )
    path = scratch / "unfinished.jsonl"
    with Unfinished.of(path, "0" * 64, 0).used():
        answered(np.add, np.zeros(3), np.ones(3))
        answered(dict, value=1.5, names=["a", "b"])
        shutil.copyfile(path, HERE / "unfinished.jsonl")
    shapes = {"input_gain": (), "proposed.weight": (2, 4), "proposed.bias": (2,)}
    tensors = {f"network.{name}": np.ones(shape, dtype=np.float32) for name, shape in shapes.items()}
    write_tensors(HERE / "network.safetensors", tensors, {"format": FORMAT, "drive": "0" * 16})
    for suffix, code in ((".mp4", "mp4v"), (".avi", "MJPG"), (".webm", "VP80")):
        film = cv2.VideoWriter(str(HERE / f"film{suffix}"), cv2.VideoWriter.fourcc(*code), 30.0, (64, 48))
        for index in range(8):
            picture = np.full((48, 64, 3), 90, dtype=np.uint8)
            cv2.circle(picture, (10 + 5 * index, 24), 6, (40, 40, 200), -1)
            film.write(picture)
        film.release()


def main() -> None:
    """Write all seeds beside this file."""
    with tempfile.TemporaryDirectory() as scratch:
        recordings()
        bags(Path(scratch))
        others(Path(scratch))


if __name__ == "__main__":
    main()
