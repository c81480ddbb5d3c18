"""The readers of files from outside: their seeds, and what is done with a file that is accepted."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from irt.bag import load_bag
from irt.engine import rollouts
from irt.errors import IrtError
from irt.fitting.unfinished import Unfinished, answered
from irt.importing import import_bags
from irt.importing.logs import import_logs
from irt.importing.mapping import Expression
from irt.importing.sources import Reading, detect, read_log
from irt.model import load_model, save_model
from irt.recording import load_commands, load_recording
from irt.rig import load_rig
from irt.tracking.calibration import load_lens
from irt.tracking.source import open_source
from irt.tuning.stepnet import load_steps
from irt.tuning.tunenet import load_network

CORPUS = Path(__file__).resolve().parents[1] / "corpus"
DATA = Path(str(resources.files("irt"))) / "data"
RECORDINGS = "0" * 64


@dataclass(frozen=True)
class Reader:
    """A reader of files.

    Attributes
    ----------
    name : str
        In tables and on the command line.
    seeds : function
        Returns the valid files: text or bytes.
    read : function
        Called with an empty folder and the bytes of a changed file; raises `IrtError` where it refuses them.
    isolated : bool
        Whether a library in it may end the process.
    """

    name: str
    seeds: Callable[[], Sequence[str] | Sequence[bytes]]
    read: Callable[[Path, bytes], object]
    isolated: bool = False


def _texts(*names: str) -> Callable[[], list[str]]:
    return lambda: [(CORPUS / name).read_text(encoding="utf-8") for name in names]


def _files(*paths: str | Path) -> Callable[[], list[bytes]]:
    return lambda: [(CORPUS / path).read_bytes() for path in paths]


def _written(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def _recording(folder: Path, data: bytes) -> None:
    path = _written(folder, "run.csv", data)
    found = load_recording(path)
    path.write_text(found.to_csv())
    again = load_recording(path)
    assert np.array_equal(found.knobs, again.knobs)
    assert np.array_equal(found.marble, again.marble, equal_nan=True)
    assert found.way.shape == (len(found.knobs),)


def _commands(folder: Path, data: bytes) -> None:
    assert load_commands(_written(folder, "commands.csv", data)).knobs.shape[1] == 2


def _rig(folder: Path, data: bytes) -> None:
    shutil.copyfile(CORPUS / "cmd.csv", folder / "run.csv")
    _written(folder, "rig.toml", data)
    assert len(load_rig(folder).digest) == 64


def _model(folder: Path, data: bytes) -> None:
    model = load_model(_written(folder, "model.toml", data))
    save_model(folder / "again.toml", model)
    assert load_model(folder / "again.toml") == model
    assert model.predict([[0.01, 0.02]] * 4, threads=1).shape == (4, 2)
    model.sample(2)


def unfinished_seed() -> list[str]:
    """Return a file of answers that fits the engine of today."""
    about, *answers = (CORPUS / "unfinished.jsonl").read_text(encoding="utf-8").splitlines()
    now = Unfinished.of(Path("none"), RECORDINGS, 0).about
    assert json.loads(about).keys() == now.keys()
    return ["\n".join([json.dumps(now), *answers]) + "\n"]


def _unfinished(folder: Path, data: bytes) -> None:
    """A computation gets its right answers beside any file, however broken."""
    found = Unfinished.of(_written(folder, "unfinished.jsonl", data), RECORDINGS, 0)
    with found.used():
        assert np.array_equal(answered(np.add, np.zeros(3), np.ones(3)), np.ones(3))
        assert answered(dict, value=1.5, names=["a", "b"]) == {"value": 1.5, "names": ["a", "b"]}


def _rig_bag(folder: Path, data: bytes) -> None:
    path = _written(folder, "bag.mcap", data)
    load_bag(path)
    import_bags([path], folder / "rig")


def _lab_bag(suffix: str) -> Callable[[Path, bytes], object]:
    def read(folder: Path, data: bytes) -> object:
        path = _written(folder, f"bag{suffix}", data)
        kind = detect(path)
        if kind == "rig":
            return load_bag(path)
        return read_log(path, kind, Reading())

    return read


def _log(folder: Path, data: bytes) -> None:
    path = _written(folder, "log.csv", data)
    read_log(path, detect(path), Reading())


def _import(folder: Path, data: bytes) -> None:
    import_logs([_written(folder, "log.csv", data)], folder / "rig", "cyberrunner", dry_run=True)


def _long_log() -> list[str]:
    """Return the log of a marble that rolls for 20 s: enough for all fits of an import."""
    knobs = 0.05 * np.sin(np.arange(800)[:, None] / np.array([13.0, 17.0]))
    places, tilts = rollouts([[0.9, 0.9, 4e-4, 6.0, 1.0]], knobs, tilt=True, threads=1)
    rows = ["t,episode,step,xb,yb,alpha,beta,a0,a1,ball_found"]
    rows += [
        f"{i / 40:.3f},0,{i},{0.276 * x:.5f},{0.276 * y:.5f},{-b:.5f},{a:.5f},{u:.4f},{v:.4f},1"
        for i, ((x, y), (a, b), (u, v)) in enumerate(zip(places[0], tilts[0], 100.0 * knobs, strict=True))
    ]
    return ["\n".join(rows) + "\n"]


def _expression(folder: Path, data: bytes) -> None:
    found = Expression.parse(data.decode("utf-8", "replace"))
    assert found.evaluate({"xb": np.ones(3), "yb": np.zeros(3)}, 3, "log").shape == (3,)


def _replay(folder: Path, data: bytes) -> None:
    read_log(_written(folder, "replay.npz", data), "cyberrunner", Reading())


def _network(folder: Path, data: bytes) -> None:
    path = _written(folder, "network.safetensors", data)
    refused = []
    for load in (load_network, load_steps):
        try:
            load(path)
        except IrtError as error:
            refused.append(error)
    assert refused, "no file is of both kinds"


def _lens(folder: Path, data: bytes) -> None:
    load_lens(_written(folder, "camera.toml", data))


def _video(folder: Path, data: bytes) -> None:
    source = open_source(str(_written(folder, "film.mp4", data)))
    try:
        source.sample(48)
        stamps = np.array([frame.stamp for frame, _ in zip(source.frames(), range(100), strict=False)])
    finally:
        source.close()
    assert (np.diff(stamps) > 0.0).all()


READERS = (
    Reader("recording", _texts("run.csv", "cmd.csv"), _recording),
    Reader("commands", _texts("run.csv", "cmd.csv"), _commands),
    Reader("rig.toml", _texts("rig.toml"), _rig),
    Reader("model.toml", _texts("model.toml"), _model),
    Reader("unfinished", unfinished_seed, _unfinished),
    Reader("rig-bag", _files("rig.mcap", "rig-zstd.mcap"), _rig_bag),
    Reader("lab-mcap", _files("lab.mcap"), _lab_bag(".mcap")),
    Reader("lab-sqlite3", _files("lab.db3"), _lab_bag(".db3")),
    Reader("lab-csv", _texts("without-ros.csv"), _log),
    Reader("import", cache(_long_log), _import),
    Reader("mapping", lambda: ["rad(xb / 0.276) + -yb * (2 - 1e-3)"], _expression),
    Reader("replay", _files("replay.npz"), _replay),
    Reader(
        "network",
        _files("network.safetensors", DATA / "tunenet-paper.safetensors", DATA / "steps-paper.safetensors"),
        _network,
    ),
    Reader("camera.toml", _texts("camera.toml"), _lens),
    Reader("video", _files("film.mp4", "film.avi", "film.webm"), _video, isolated=True),
)
