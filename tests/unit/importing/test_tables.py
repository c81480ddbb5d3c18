"""CSV and NPZ logs; nothing is unpickled."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import lab_logs
from irt.errors import IrtError
from irt.importing.tables import (
    read_columns,
    read_replay,
    read_tag_folder,
    read_without_ros,
    refuse_packed,
    refuse_pickle,
)
from lab_logs import Convention, simulate, write_csv


def test_cells_that_are_no_numbers_are_nan_and_columns_of_words_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,x,status,found\r\n0,1.5,ok,True\r\n\r\n1,,held,False\r\n2,nan,ok,True\r\n")
    columns = read_columns(path)
    assert set(columns) == {"t", "x", "found"}
    assert columns["t"].tolist() == [0.0, 1.0, 2.0]
    assert np.isnan(columns["x"][1:]).all()
    assert columns["found"].tolist() == [1.0, 0.0, 1.0]


NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=6),
    st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")]),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_separator_and_decimal_mark_gives_the_same_numbers(tmp_path: Path, rows, style) -> None:
    separator, mark = style
    path = tmp_path / "log.csv"
    cells = [separator.join(f"{value!r}".replace(".", mark) for value in row) for row in rows]
    path.write_text("\n".join([f"t{separator}x", *cells]))
    columns = read_columns(path)
    assert np.array_equal(np.column_stack([columns["t"], columns["x"]]), np.array(rows))


def test_a_comma_beside_decimal_points_is_none(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t;x\n0.5;1,234\n1.0;2\n")
    assert np.array_equal(read_columns(path)["x"], [np.nan, 2.0], equal_nan=True)


def test_dates_and_times_of_the_day_are_seconds(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(
        "naive,zoned,day,note\n"
        "2026-11-28 10:00:00.25,2026-11-28T11:00:00.25+01:00,10:00:00.25,a:b\n"
        ",2026-11-28T10:00:00.75Z,10:00:00.75,\n"
    )
    columns = read_columns(path)
    assert set(columns) == {"naive", "zoned", "day"}
    assert columns["naive"][0] == columns["zoned"][0] == 1795860000.25
    assert np.isnan(columns["naive"][1])
    assert columns["zoned"][1] - columns["zoned"][0] == 0.5
    assert columns["day"].tolist() == [36000.25, 36000.75]


@pytest.mark.parametrize("begin", [b"\x1f\x8b", b"PK\x03\x04"], ids=["gzip", "spreadsheet"])
def test_packed_files_are_refused(tmp_path: Path, begin: bytes) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(begin + bytes(8))
    with pytest.raises(IrtError, match="a packed file; unpack it first"):
        refuse_packed(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no rows below a header"),
        ("a,b\n", "no rows below a header"),
        ("a,b\n1\n", "line 2: 1 cells, but the header has 2"),
        ("a,a\n1,2\n", 'duplicate column "a"'),
        (
            "0,1.5,-2e-3\n1,2.5,3\n",
            "line 1: the columns have no names; add a line with them above the numbers",
        ),
    ],
)
def test_broken_tables(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(IrtError, match=said):
        read_columns(path)


def test_without_ros_a_row_is_seen_after_its_action() -> None:
    columns = {
        "episode": np.array([0.0, 0.0, 0.0, 1.0, 1.0]),
        "a0": np.arange(5.0),
        "a1": -np.arange(5.0),
    }
    shifted, episodes = read_without_ros(Path("log.csv"), columns)
    assert np.array_equal(shifted["a0"], [1.0, 2.0, np.nan, 4.0, np.nan], equal_nan=True)
    assert np.array_equal(shifted["a1"], [-1.0, -2.0, np.nan, -4.0, np.nan], equal_nan=True)
    assert episodes.tolist() == [0.0, 0.0, 0.0, 1.0, 1.0]


def tag(tmp_path: Path, offset: float = 0.0) -> Path:
    truth = simulate(np.random.default_rng(0), seconds=5.0, spoil=False)
    return lab_logs.write_tag_folder(
        tmp_path / "tag", truth, Convention(np.ones(2), False, np.ones(2), offset)
    )


def test_a_tag_folder_is_dated_back_by_the_age_of_its_pictures(tmp_path: Path) -> None:
    states, commands, notes = read_tag_folder(tag(tmp_path, offset=0.25))
    truth = simulate(np.random.default_rng(0), seconds=5.0, spoil=False)
    assert np.allclose(states["t_s"] - 5000.0, truth.stamps, atol=1e-6)
    assert np.allclose(commands["t_s"] - 5000.0, truth.command_stamps, atol=1e-6)
    assert any("20.0 ms" in note for note in notes)
    (note,) = [note for note in notes if "ROS clock" in note]
    assert "+0.2500" in note or "+0.25" in note


def test_tag_files_of_different_runs(tmp_path: Path) -> None:
    folder = tag(tmp_path)
    columns = read_columns(folder / "commands.csv")
    later = {name: values + (1e12 if name.endswith("_ns") else 0.0) for name, values in columns.items()}
    write_csv(folder / "commands.csv", later)
    with pytest.raises(IrtError, match="commands and states do not overlap in time"):
        read_tag_folder(folder)
    # A recorder that was started anew has another monotonic clock, but the ROS clock still agrees.
    write_csv(folder / "commands.csv", {**later, "ros_time_ns": columns["ros_time_ns"]})
    assert any("stamped by the ROS clock" in note for note in read_tag_folder(folder)[2])
    (folder / "commands.csv").unlink()
    with pytest.raises(IrtError, match=r"commands\.csv: no such file"):
        read_tag_folder(folder)


@pytest.mark.parametrize("streams", ["one", "axis", "first axis", "side by side"])
def test_a_replay_is_taken_from_its_first_stream(tmp_path: Path, streams: str) -> None:
    rng = np.random.default_rng(0)
    states, action = rng.uniform(0.2, 0.8, (50, 4)), rng.uniform(-1, 1, (50, 2))
    mirrored = [states, states * [1, -1, 1, -1], states * [-1, 1, -1, 1], -states]
    stacked = {
        "one": states,
        "axis": np.stack(mirrored, axis=1),
        "first axis": np.stack(mirrored),
        "side by side": np.concatenate(mirrored, axis=1),
    }[streams]
    first = np.zeros(50, dtype=bool)
    first[[0, 20]] = True
    np.savez(tmp_path / "replay.npz", states=stacked, action=action, is_first=first)
    columns, episodes = read_replay(tmp_path / "replay.npz")
    assert np.allclose(columns["x_b"], (states[:, 2] - 0.5) * 0.276)
    assert np.allclose(columns["y_b"], (states[:, 3] - 0.5) * 0.231)
    assert np.allclose(columns["alpha"], np.deg2rad(10.0 * states[:, 0]))
    assert np.allclose(columns["action_2"], action[:, 1])
    assert np.flatnonzero(np.diff(episodes)).tolist() == [19]


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"image": np.zeros(3)}, 'no array "states"'),
        ({"states": np.zeros((5, 3))}, "expected \\(rows, 4\\)"),
        ({"states": np.array([{}, []], dtype=object)}, "no NPZ of plain numbers"),
        ({"states": np.zeros((5, 4)), "action": np.zeros((4, 2))}, "5 rows of states, but 4 of actions"),
        ({"states": np.zeros((5, 4), dtype="U3")}, "where numbers were expected"),
    ],
)
def test_replays_that_are_none(tmp_path: Path, arrays: dict[str, np.ndarray], said: str) -> None:
    np.savez(tmp_path / "replay.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(IrtError, match=said):
        read_replay(tmp_path / "replay.npz")


@pytest.mark.parametrize("name", ["data.pkl", "data.npz", "data.csv", "model.pt"])
def test_pickles_are_never_opened(tmp_path: Path, name: str) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (pytest.fail, ("a pickle was opened",))

    path = tmp_path / name
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(IrtError, match="a pickle is never opened"):
        refuse_pickle(path)
