"""Simulations in shards: processes see the drive as it is, and find the same bits."""

import numpy as np
import pytest

from irt.errors import IrtError
from irt.rig import RANGES, Board, Marble
from irt.tuning import shards
from irt.tuning.drive import Drive, Run
from irt.tuning.pairs import simulate_pairs
from irt.workers import FAILED
from irt.workers.processes import LocalWorkers

KNOBS = 0.03 * np.sin(np.arange(60).reshape(30, 2) / 3.0)
STAMPED = Drive(
    (
        Run(KNOBS, np.full(30, 0.1), np.array([0.1, -0.2]), np.array([0.01, 0.0])),
        Run(KNOBS[:20], np.full(20, 0.07), np.zeros(2), np.zeros(2)),
    ),
    Board(edge_x_m=0.3, sliding_friction=0.1),
    Marble(damping_per_s=0.2),
    RANGES | {"gear_x": (0.01, 0.09)},
    "moving",
    "rolling",
    time_scale=24.0,
    rows_per_input=3,
)


@pytest.mark.slow
@pytest.mark.parametrize("drive", [Drive.paper(), STAMPED], ids=["paper", "stamped"])
def test_processes_find_the_same_bits(drive, monkeypatch):
    monkeypatch.setattr("irt.tuning.pairs._ROWS_AT_ONCE", 2_500)
    here = simulate_pairs(drive, 20, seed=1)
    assert simulate_pairs(drive, 20, seed=1, workers=LocalWorkers(2)).digest == here.digest


def test_a_drive_read_back_is_the_same_drive(tmp_path):
    for name, data in shards._written(STAMPED).items():
        (tmp_path / name).write_bytes(data)
    again = shards._read(tmp_path)
    assert again.digest == STAMPED.digest
    assert np.array_equal(again.runs[0].start_velocity, STAMPED.runs[0].start_velocity)


def test_a_worker_that_fails_is_reported():
    class Broken:
        def each(self, module, inputs, words=()):
            yield "0", {FAILED: b'{"error": "no room"}'}

    with pytest.raises(IrtError, match="a worker failed: no room"):
        simulate_pairs(Drive.paper(), 5, seed=0, workers=Broken())
