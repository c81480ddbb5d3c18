"""Simulations of a training in shards: on threads of this process, or by other processes.

    python -m irt.tuning.shards FOLDER OUT

FOLDER holds a drive and the scaled parameters of a shard; the network's inputs are written into OUT. A
rollout's bits depend on nothing else, so all processes get the same.
"""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.rig import Board, Marble
from irt.tuning.drive import Drive, Run
from irt.workers import FAILED, Files, Workers

Array = NDArray[np.float64]
#: The network's inputs from a shard, (k, inputs).
Inputs = NDArray[np.float32]

_DRIVE, _RUNS, _SCALED, _INPUTS = "drive.json", "runs.npz", "scaled.npy", "inputs.npy"
#: Fields of a drive that are written unchanged.
_PLAIN = ("ranges", "start", "engine", "time_scale", "rows_per_input")


def of_threads(
    drive: Drive, shards: Mapping[int, Array], threads: int | None = None
) -> Iterator[tuple[int, Inputs]]:
    """Yield (key, inputs) of shards of scaled parameters, simulated in this process."""
    for key, scaled in shards.items():
        yield key, _seen(drive, scaled, threads)


def of_workers(workers: Workers, drive: Drive, shards: Mapping[int, Array]) -> Iterator[tuple[int, Inputs]]:
    """Yield (key, inputs) of shards of scaled parameters, simulated by workers.

    Raises
    ------
    IrtError
        If one of them fails.
    """
    common = _written(drive)
    inputs = {f"{key}": {**common, _SCALED: _packed(scaled)} for key, scaled in shards.items()}
    with closing(workers.each(__name__, inputs)) as answers:
        for key, files in answers:
            if FAILED in files:
                raise IrtError(f"simulating pairs: a worker failed: {json.loads(files[FAILED])['error']}")
            yield int(key), np.load(io.BytesIO(files[_INPUTS]))


def _seen(drive: Drive, scaled: Array, threads: int | None) -> Inputs:
    return drive.inputs(drive.simulate(drive.parameters(scaled), threads)).astype(np.float32)


def _written(drive: Drive) -> Files:
    """Return a drive as files, bit for bit."""
    content = {name: getattr(drive, name) for name in _PLAIN}
    content |= {"board": asdict(drive.board), "marble": asdict(drive.marble), "runs": len(drive.runs)}
    arrays = {
        f"{index}.{name}": value
        for index, run in enumerate(drive.runs)
        for name, value in vars(run).items()
        if value is not None
    }
    packed = io.BytesIO()
    np.savez(packed, allow_pickle=False, **arrays)
    return {_DRIVE: json.dumps(content).encode(), _RUNS: packed.getvalue()}


def _read(folder: Path) -> Drive:
    """Return the drive from a folder."""
    content = json.loads((folder / _DRIVE).read_bytes())
    with np.load(folder / _RUNS) as arrays:
        runs = tuple(
            Run(**{name: arrays.get(f"{index}.{name}") for name in Run.__annotations__})
            for index in range(content["runs"])
        )
    ranges = {name: (low, high) for name, (low, high) in content["ranges"].items()}
    plain = {name: content[name] for name in _PLAIN} | {"ranges": ranges}
    return Drive(runs, Board(**content["board"]), Marble(**content["marble"]), **plain)


def _packed(array: Array) -> bytes:
    packed = io.BytesIO()
    np.save(packed, array, allow_pickle=False)
    return packed.getvalue()


def main(words: Sequence[str]) -> int:
    """Simulate the shard of one folder into another; return the exit status."""
    folder, out = (Path(word) for word in words)
    seen = _seen(_read(folder), np.load(folder / _SCALED), threads=1)
    np.save(out / _INPUTS, seen, allow_pickle=False)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
