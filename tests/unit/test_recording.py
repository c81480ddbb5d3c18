from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from irt.errors import IrtError
from irt.recording import CMD, Recording, load_commands, load_recording, save_recording

GOOD = [
    "step,t_s,knob_x_rad,knob_y_rad,marble_x,marble_y",
    "0,0.0,0.01,0.02,0.1,-0.1",
    "1,0.1,0.02,0.03,0.11,-0.12",
    "2,0.2,0.03,0.04,,",
    "3,0.3,0.04,0.05,0.13,-0.14",
]


def write(tmp_path: Path, text: str | bytes, name: str = "run.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def with_line(number: int, line: str) -> str:
    """GOOD with the line of this number (from 1) replaced."""
    lines = list(GOOD)
    lines[number - 1] = line
    return "\n".join(lines) + "\n"


def test_reads_what_stands_there(tmp_path: Path) -> None:
    recording = load_recording(write(tmp_path, "\n".join(GOOD)))
    assert recording.name == "run"
    assert recording.path == tmp_path / "run.csv"
    np.testing.assert_array_equal(recording.knobs, [[0.01, 0.02], [0.02, 0.03], [0.03, 0.04], [0.04, 0.05]])
    np.testing.assert_array_equal(
        recording.marble, [[0.1, -0.1], [0.11, -0.12], [np.nan, np.nan], [0.13, -0.14]]
    )
    np.testing.assert_array_equal(recording.stamps, [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(recording.seen, [True, True, False, True])


def test_the_last_command_holds_as_long_as_the_one_before() -> None:
    recording = Recording("run", Path(), np.zeros((3, 2)), np.zeros((3, 2)), np.array([0.0, 0.1, 0.4]))
    np.testing.assert_allclose(recording.durations, [0.1, 0.3, 0.3])


def test_without_stamps_there_are_no_durations() -> None:
    assert Recording("run", Path(), np.zeros((3, 2)), np.zeros((3, 2))).durations is None


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + "\n".join(GOOD),
        "\r\n".join(GOOD) + "\r\n",
        "\r".join(GOOD),
        "\n\n" + "\n\n".join(GOOD) + "\n\n\n",
        "\n".join(GOOD).replace(",,", ",nan,NaN"),
        "\n".join(GOOD).replace(",", " , "),
        "\n".join(f'"{line}"'.replace(",", '","') for line in GOOD),
    ],
    ids=["mark", "windows", "old mac", "blank lines", "nan", "spaces", "quotes"],
)
def test_other_ways_to_write_the_same(tmp_path: Path, text: str) -> None:
    found = load_recording(write(tmp_path, text))
    expected = load_recording(write(tmp_path, "\n".join(GOOD), "plain.csv"))
    for field in ("knobs", "marble", "stamps"):
        np.testing.assert_array_equal(getattr(found, field), getattr(expected, field))


def test_columns_in_any_order_and_others_ignored(tmp_path: Path) -> None:
    text = "note,marble_y,marble_x,knob_y_rad,knob_x_rad,step,note\na,4,3,2,1,0,b\n,8,7,6,5,1,\n"
    text = text.replace("4,3", ".4,.3").replace("8,7", ".8,.7")
    recording = load_recording(write(tmp_path, text))
    np.testing.assert_array_equal(recording.knobs, [[1, 2], [5, 6]])
    np.testing.assert_array_equal(recording.marble, [[0.3, 0.4], [0.7, 0.8]])


BAD = {
    "empty": ("", r"run\.csv: the file is empty"),
    "blank": ("\n \n", r"run\.csv: the file is empty"),
    "header only": (GOOD[0], r"run\.csv: the file has a header, but no rows"),
    "one row": ("\n".join(GOOD[:2]), r"run\.csv: only one row; at least two are needed"),
    "column missing": (
        "\n".join(GOOD).replace("marble_y", "y"),
        r"run\.csv, line 1: column marble_y is missing; rename the column that holds it; the header .*, y$",
    ),
    "column misspelt": (
        "\n".join(GOOD).replace("knob_x_rad", "knob_x"),
        r"run\.csv, line 1: column knob_x_rad is missing; rename knob_x; the header has step, t_s, knob_x, ",
    ),
    "header missing": (
        "\n".join(GOOD[1:]),
        r"run\.csv, line 1: the columns have no names; name them step, knob_x_rad, knob_y_rad, marble_x, ",
    ),
    "column twice": (
        with_line(1, GOOD[0].replace("t_s", "step")),
        r"line 1: column step appears 2 times",
    ),
    "semicolons": ("\n".join(GOOD).replace(",", ";"), r"run\.csv, line 1: cells must be separated by commas"),
    "row too short": (with_line(3, "1,0.1,0.02,0.03,0.11"), r"line 3: 5 cells, but the header has 6"),
    "row too long": (with_line(3, GOOD[2] + ","), r"line 3: 7 cells, but the header has 6"),
    "quote left open": (with_line(3, '1,0.1,"0.02'), r"broken CSV: unexpected end of data"),
    "text": (
        with_line(3, "1,0.1,left,0.03,0.11,-0.12"),
        r'run\.csv, line 3, column knob_x_rad: expected a number, found "left"',
    ),
    "text for a lost marble": (
        with_line(4, "2,0.2,0.03,0.04,NA,NA"),
        r'line 4, column marble_x: expected a number, found "NA"',
    ),
    "grouped digits": (
        with_line(3, "1,0.1,1_0,0.03,0.11,-0.12"),
        'column knob_x_rad: expected a number, found "1_0"',
    ),
    "knob lost": (
        with_line(3, "1,0.1,,0.03,0.11,-0.12"),
        r"line 3, column knob_x_rad: .* found an empty cell",
    ),
    "knob nan": (
        with_line(3, "1,0.1,0.02,nan,0.11,-0.12"),
        r"line 3, column knob_y_rad: expected a knob angle in radians, found nan; no command may be lost",
    ),
    "knob infinite": (
        with_line(3, "1,0.1,0.02,-inf,0.11,-0.12"),
        r"line 3, column knob_y_rad: expected a knob angle in radians, found -inf",
    ),
    "position infinite": (
        with_line(3, "1,0.1,0.02,0.03,0.11,inf"),
        r"line 3, column marble_y: inf is not a position .*leave both cells empty where the marble was lost",
    ),
    "only y lost": (
        with_line(3, "1,0.1,0.02,0.03,0.11,"),
        r"line 3, column marble_y: empty, but marble_x is not",
    ),
    "only x lost": (
        with_line(3, "1,0.1,0.02,0.03,nan,0.1"),
        r"line 3, column marble_x: empty, but marble_y is not",
    ),
    "always lost": (
        "\n".join([GOOD[0], *(",".join([*line.split(",")[:4], "", ""]) for line in GOOD[1:])]),
        r"run\.csv: the marble is lost in every row",
    ),
    "lost at first": (
        with_line(2, "0,0.0,0.01,0.02,,"),
        r"line 2, column marble_x: the marble is lost in the first row, .* cut the rows until it is seen",
    ),
    "step repeated": (
        with_line(4, "1,0.2,0.03,0.04,,"),
        r"line 4, column step: expected 2, found 1, which line 3 has already; no step may repeat",
    ),
    "step skipped": (
        with_line(4, "3,0.2,0.03,0.04,,"),
        r"line 4, column step: expected 2, found 3; steps count 0, 1, 2, .*keep rows in which",
    ),
    "step not from 0": (
        with_line(2, "1,0.0,0.01,0.02,0.1,-0.1"),
        r"line 2, column step: expected 0, found 1",
    ),
    "step negative": (
        with_line(3, "-1,0.1,0.02,0.03,0.1,0.1"),
        r"line 3, column step: expected 1, found -1; steps",
    ),
    "step broken": (
        with_line(3, "0.5,0.1,0.02,0.03,0.1,0.1"),
        r"line 3, column step: expected 1, found 0\.5; steps",
    ),
    "step nan": (
        with_line(3, "nan,0.1,0.02,0.03,0.1,0.1"),
        r"line 3, column step: expected 1, found nan; steps",
    ),
    "stamps backwards": (
        with_line(4, "2,0.05,0.03,0.04,,"),
        r"line 4, column t_s: stamps must rise from row to row, but 0\.05 follows 0\.1",
    ),
    "stamps equal": (with_line(4, "2,0.1,0.03,0.04,,"), r"line 4, column t_s: stamps must rise"),
    "stamp missing": (
        with_line(4, "2,,0.03,0.04,,"),
        r"line 4, column t_s: expected a number, found an empty cell",
    ),
    "stamp nan": (with_line(4, "2,nan,0.03,0.04,,"), r"line 4, column t_s: a stamp must be a finite number"),
    "stamps in ms": (
        with_line(5, "3,200.0,0.03,0.04,,"),
        r"line 5, column t_s: 199\.8 s after the row before; are the stamps in seconds\?",
    ),
    "millimetres": (
        "\n".join([GOOD[0], "0,0,0,0,27.6,-27.6", "1,1,0,0,30,-33", "2,2,0,0,,", "3,3,0,0,35,-38"]),
        r"line 2, column marble_x: positions go from .* more than 2 edges from .*pixels or millimetres",
    ),
    "not UTF-8": ("\n".join(GOOD).encode("utf-16"), r"run\.csv, line 1: not UTF-8 text"),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_bad_recording(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(IrtError, match=message):
        load_recording(write(tmp_path, text))


def test_a_line_is_counted_as_an_editor_does(tmp_path: Path) -> None:
    text = "\n\n" + "\n".join(GOOD[:2]) + '\n\n1,0.1,0.02,0.03,"0.\n11",-0.12\n2,0.2,0,0,,\n'
    with pytest.raises(IrtError, match="line 7, column marble_x"):
        load_recording(write(tmp_path, text))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(IrtError, match=r"none\.csv: no such file"):
        load_recording(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("knobs", "marble", "stamps", "message"),
    [
        (np.zeros((3, 3)), np.zeros((3, 2)), None, r"run: knobs must have shape \(n, 2\), not \(3, 3\)"),
        (np.zeros((3, 2)), np.zeros((4, 2)), None, r"run: marble must have shape \(3, 2\), not \(4, 2\)"),
        (
            np.zeros((3, 2)),
            np.zeros((3, 2)),
            np.arange(4.0),
            r"run: stamps must have shape \(3,\), not \(4,\)",
        ),
        (0.0, 0.0, None, r"run: knobs must have shape \(n, 2\), not \(\)"),
        ("left", np.zeros((3, 2)), None, "run: knobs must be an array of numbers"),
        (np.zeros((1, 2)), np.zeros((1, 2)), None, "run: only one row"),
        (
            np.full((3, 2), np.nan),
            np.zeros((3, 2)),
            None,
            "run, row 0, column knob_x_rad: expected a knob angle",
        ),
        (np.zeros((3, 2)), np.full((3, 2), np.nan), None, "run: the marble is lost in every row"),
    ],
)
def test_arrays_that_are_no_recording(tmp_path: Path, knobs, marble, stamps, message: str) -> None:
    with pytest.raises(IrtError, match=message):
        save_recording(tmp_path / "run.csv", knobs, marble, stamps)
    assert not (tmp_path / "run.csv").exists()


def test_a_recording_stays_what_was_checked() -> None:
    knobs = np.zeros((3, 2))
    recording = Recording("run", Path(), knobs, np.zeros((3, 2)))
    knobs[0] = np.nan
    assert not recording.knobs.any()
    with pytest.raises(ValueError, match="read-only"):
        recording.knobs[0] = np.nan


POSITION = st.floats(-2, 2, allow_nan=False)
ANGLE = st.floats(-1e6, 1e6, allow_nan=False)


@st.composite
def recordings(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    rows = draw(st.integers(2, 12))
    knobs = draw(hnp.arrays(np.float64, (rows, 2), elements=ANGLE))
    marble = draw(hnp.arrays(np.float64, (rows, 2), elements=POSITION))
    lost = draw(hnp.arrays(np.bool_, rows))
    marble[1:][lost[1:]] = np.nan
    steps = draw(st.none() | hnp.arrays(np.float64, rows, elements=st.floats(1e-3, 20)))
    return knobs, marble, None if steps is None else np.cumsum(steps)


@given(recordings(), st.none() | hnp.arrays(np.float64, 1000, elements=st.floats(-0.4, 0.4)), st.booleans())
def test_round_trip_bit_for_bit(tmp_path_factory: pytest.TempPathFactory, arrays, tilt, are_angles) -> None:
    path = tmp_path_factory.getbasetemp() / "round-trip.csv"
    rows = len(arrays[0])
    tilt = None if tilt is None else tilt[: 2 * rows].reshape(rows, 2)
    save_recording(path, *arrays, tilt=tilt, **({} if are_angles else {"columns": CMD}))
    read = load_recording(path)
    written = (*arrays, tilt)
    for before, after in zip(written, (read.knobs, read.marble, read.stamps, read.tilt), strict=True):
        assert (before is None) == (after is None)
        if before is not None:
            assert before.tobytes() == after.tobytes()


TILTED = [
    "step,cmd_x,cmd_y,tilt_x_rad,tilt_y_rad",
    "0,100,-20,0.01,-0.02",
    "1,50,-20,,-0.02",
    "2,0,-20,nan,-0.02",
]


class TestTilt:
    def test_a_run_of_tilt_alone(self, tmp_path: Path) -> None:
        recording = load_recording(write(tmp_path, "\n".join(TILTED)))
        assert recording.columns == CMD
        np.testing.assert_array_equal(recording.knobs[0], [100.0, -20.0])
        np.testing.assert_array_equal(recording.tilt, [[0.01, -0.02], [np.nan, -0.02], [np.nan, -0.02]])
        assert recording.has_tilt
        assert not recording.has_marble
        assert np.isnan(recording.marble).all()

    def test_without_a_tilt_there_is_none(self, tmp_path: Path) -> None:
        recording = load_recording(write(tmp_path, "\n".join(GOOD)))
        assert recording.tilt is None
        assert not recording.has_tilt

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("tilt_y_rad", "beta", "line 1: column tilt_y_rad is missing"),
            (
                "step",
                "step,knob_y_rad",
                "line 1: there are commands in both knob_x_rad, knob_y_rad and cmd_x, cmd_y",
            ),
            ("-0.02", "-2.0", r"line 2, column tilt_y_rad: most tilts exceed 0\.5 rad .* divide degrees"),
            ("0.01", "inf", "line 2, column tilt_x_rad: inf is not an angle; leave the cell empty"),
            ("0.01", "flat", 'line 2, column tilt_x_rad: expected a number, found "flat"'),
            ("50", "", "line 3, column cmd_x: expected a number, found an empty cell"),
            ("50", "nan", "line 3, column cmd_x: expected a command, found nan"),
        ],
    )
    def test_bad_columns_are_named(self, tmp_path: Path, old: str, new: str, message: str) -> None:
        path = write(tmp_path, "\n".join(TILTED).replace(old, new))
        with pytest.raises(IrtError, match=message):
            load_recording(path)

    def test_a_tilt_that_was_never_measured_is_no_reason_for_a_run_without_marble(
        self, tmp_path: Path
    ) -> None:
        text = "step,cmd_x,cmd_y,marble_x,marble_y,tilt_x_rad,tilt_y_rad\n0,1,2,,,,\n1,1,2,,,,\n"
        with pytest.raises(IrtError, match="the marble is lost in every row"):
            load_recording(write(tmp_path, text))


CELLS = st.sampled_from(["", "0", "1", "2", "-1", "0.5", "nan", "inf", "x", '"', "1e999", "9" * 5000, "\x00"])
NEARLY = st.lists(st.lists(CELLS, min_size=4, max_size=7), max_size=5).map(
    lambda rows: "\n".join([GOOD[0], *(",".join(row) for row in rows)]).encode()
)


@given(st.binary() | st.text().map(str.encode) | NEARLY)
def test_any_bytes_are_a_recording_or_refused(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "garbage.csv"
    path.write_bytes(data)
    with suppress(IrtError):
        assert np.isfinite(load_recording(path).knobs).all()
    with suppress(IrtError):
        assert np.isfinite(load_commands(path).knobs).all()


class TestCommands:
    def test_a_recording_gives_commands_and_start(self, tmp_path: Path) -> None:
        commands = load_commands(write(tmp_path, "\n".join(GOOD)))
        assert commands.knobs.shape == (4, 2)
        np.testing.assert_array_equal(commands.start, [0.1, -0.1])
        np.testing.assert_allclose(commands.durations, 0.1)

    @pytest.mark.parametrize(
        "text",
        [
            "step,knob_x_rad,knob_y_rad\n0,1,2\n1,3,4\n",
            "step,knob_x_rad,knob_y_rad,marble_x,marble_y\n0,1,2,,\n1,3,4,nan,nan\n",
        ],
        ids=["no columns", "empty columns"],
    )
    def test_without_positions_there_is_no_start(self, tmp_path: Path, text: str) -> None:
        commands = load_commands(write(tmp_path, text))
        np.testing.assert_array_equal(commands.knobs, [[1, 2], [3, 4]])
        assert commands.start is None
        assert commands.durations is None

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("step,knob_x_rad,knob_y_rad,marble_x\n0,1,2,3\n1,1,2,3\n", "the header has only marble_x"),
            (with_line(2, "0,0.0,0.01,0.02,,"), "the marble is lost in the first row"),
            ("step,knob_x_rad\n0,1\n", "column knob_y_rad is missing"),
            ("step,knob_x_rad,knob_y_rad\n0,1,2\n", "only one row"),
        ],
    )
    def test_bad_commands(self, tmp_path: Path, text: str, message: str) -> None:
        with pytest.raises(IrtError, match=message):
            load_commands(write(tmp_path, text))
