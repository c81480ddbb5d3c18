from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irt.errors import IrtError
from irt.recording import CMD, Recording
from irt.rig import Board, Commands, Rig
from irt.sessions import pool, session_of


def session(name: str, runs: int = 2, **fields) -> Rig:
    recordings = [
        replace(Recording.from_arrays(commands=np.zeros((9, 2)), marble=np.zeros((9, 2))), name=f"run-{i}")
        for i in range(runs)
    ]
    return Rig.from_recordings(recordings, name=name, **fields)


def test_sessions_become_one_rig_whose_recordings_keep_their_session() -> None:
    pooled = pool([session("day-1"), session("day-2", runs=3)])
    names = [one.name for one in pooled.recordings]
    assert names == ["day-1/run-0", "day-1/run-1", "day-2/run-0", "day-2/run-1", "day-2/run-2"]
    assert [session_of(name) for name in names] == ["day-1"] * 2 + ["day-2"] * 3
    assert pooled.path == Path("day-1+day-2")
    assert session_of("run-1") == ""


def test_ranges_that_follow_the_commands_are_those_of_all_sessions() -> None:
    def played(name: str, amplitude: float) -> Rig:
        commands = np.full((9, 2), amplitude)
        run = Recording.from_arrays(commands=commands, marble=np.zeros((9, 2)), columns=CMD)
        return Rig.from_recordings([run], name=name, commands=Commands("mA"))

    pooled = pool([played("day-1", 100.0), played("day-2", 200.0)])
    assert pooled.ranges == played("both", 200.0).ranges


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"board": Board(edge_x_m=0.3)}, r"day-2: board, edge_x_m is 0\.3, and in day-1 0\.276"),
        ({"start": "moving"}, "day-2: start is moving, and in day-1 rest"),
        ({"ranges": {"gear_x": (0.0, 0.2)}}, r"day-2: ranges, gear_x is \(0\.0, 0\.2\)"),
        ({"commands": Commands("mA")}, "day-2: commands, unit is mA, and in day-1 rad"),
    ],
)
def test_rigs_that_differ_are_refused(fields, message: str) -> None:
    with pytest.raises(IrtError, match=message):
        pool([session("day-1"), session("day-2", **fields)])


@pytest.mark.parametrize(
    ("rigs", "message"),
    [
        ([session("day-1")], "at least two sessions"),
        ([], "at least two sessions"),
        (session("day-1"), "at least two sessions"),
        ([session("day-1"), session("day-1")], "two sessions have the name day-1"),
        ([session("day-1"), 3], "expected irt.Rig"),
    ],
)
def test_what_is_no_list_of_sessions_is_refused(rigs, message: str) -> None:
    with pytest.raises(IrtError, match=message):
        pool(rigs)
