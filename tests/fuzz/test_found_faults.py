"""What fuzzing found, each by its symptom: files that ended a command with a traceback, or worse."""

from __future__ import annotations

import contextlib
import json
import sqlite3
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from guard import little_memory, outcome
from readers import CORPUS, READERS, RECORDINGS, unfinished_seed

import rig_bags
from irt.bag import Series, load_bag
from irt.cleaning import tilt_jumps
from irt.errors import IrtError
from irt.fitting.unfinished import Unfinished, answered
from irt.importing import import_bags
from irt.importing.lab_bags import topics_of
from irt.importing.mapping import Expression
from irt.importing.own_bags import _following
from irt.importing.tables import read_replay
from irt.model import load_model
from irt.recording import load_recording
from irt.rig import load_rig
from irt.tracking.calibration import load_lens
from irt.tracking.source import open_source
from irt.tuning.tunenet import load_network

BAG = (CORPUS / "rig.mcap").read_bytes()
DIGITS = "1" + "0" * 400


def changed(seed: bytes, old: bytes, new: bytes) -> bytes:
    """Return a file with some bytes replaced by as many others, wherever they are."""
    assert old in seed
    assert len(old) == len(new)
    return seed.replace(old, new)


def only(series: Series, rows: list[int]) -> Series:
    """Return some messages of a series."""
    index = np.array(rows, dtype=int)
    return Series(series.stamps[index], series.values[index], series.ages[index])


def refused(read, path: Path, data: bytes, said: str) -> None:
    path.write_bytes(data)
    with pytest.raises(IrtError, match=said) as caught:
        read(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"geometry_msgs/Point point", b"geometry]msgs/Point point", "not a bag"),
        (b"builtin_interfaces/Time stamp", b"builtin_interfaces/Timx stamp", "not a bag"),
        (b"float64[] velocity", b"float64[] velo__ty", "not a bag"),
        (b"/rig/setpoint", b"/rig/s\xff\xfepoint", "not a bag"),
        (b"/marble/position", b"\xff" * 16, "not a bag"),
    ],
    ids=["name", "unknown type", "field", "topic", "topic of points"],
)
def test_a_broken_definition_in_a_bag_was_a_traceback_and_printed(tmp_path, capfd, old, new, said) -> None:
    refused(load_bag, tmp_path / "bag.mcap", changed(BAG, old, new), said)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"[arms.x]", b"[armz.x]", r"rig.toml, \[arms\], \[x\]: gear is missing"),
        (b'joint = "left"', b'joynt = "left"', r"\[x\]: joint is missing"),
        (b"gear = 2.0", b"gear = 0.0", r"\[x\], gear: expected 0.001 to 1000"),
        (b"gear = 2.0", b"gear =\x002.0", "broken TOML"),
        (b"gear = 2.0", b"gear =\xff2.0", "broken TOML"),
        (b"level_rad = 1.0", b'level_rad = "1"', "level_rad: expected a number"),
        (b"edge_x_m = 0.3", b"edge_x_m = 0.0", "edge_x_m: expected a number from 0.01 to 10"),
    ],
)
def test_a_broken_configuration_in_a_bag_was_a_traceback(tmp_path, old, new, said) -> None:
    refused(load_bag, tmp_path / "bag.mcap", changed(BAG, old, new), said)


def test_a_record_of_a_bag_that_lies_about_its_length_ran_out_of_memory(tmp_path) -> None:
    place = BAG.index(b"application/toml") + len(b"application/toml")
    lying = BAG[:place] + struct.pack("<Q", 2**31 - 1) + BAG[place + 8 :]
    with little_memory():
        refused(load_bag, tmp_path / "bag.mcap", lying, "not a bag")


def test_a_bag_without_angles_of_one_kind_during_a_play_ended_in_a_traceback() -> None:
    bag = load_bag(CORPUS / "rig.mcap")
    assert bag.measured is not None
    begin, end = bag.plays[0].stamps[0] + 0.01, bag.plays[0].end
    assert np.isfinite(_following(bag.set_points, bag.measured, begin, end)).all()
    ends = only(bag.measured, [0, -1])
    nothing = only(bag.set_points, [])
    # Joint states before and after the play alone: a mean of nothing.
    assert np.isnan(_following(bag.set_points, ends, begin, end)).all()
    assert np.isnan(_following(nothing, bag.measured, begin, end)).all()


def test_positions_in_a_bag_that_no_rig_has_overflowed(tmp_path) -> None:
    angle = 1.0 + 2.0 * rig_bags.knobs(0.003 - 0.05)[0] + 2.0 * np.pi
    path = tmp_path / "bag.mcap"
    path.write_bytes(changed(BAG, struct.pack("<d", angle), struct.pack("<d", 1e308)))
    found = load_bag(path)
    assert found.measured is not None
    assert np.abs(found.measured.values).max() < 10.0
    import_bags([path], tmp_path / "rig")


@pytest.mark.parametrize(
    "line",
    [
        "[1, 2]",
        "7",
        '{"answer": 1}',
        "[" * 100_000,
        '{"asked": [], "answer": 1, "crc32": 0}',
        '{"asked": "a", "an',
    ],
    ids=["list", "number", "without a question", "deep", "unhashable", "cut"],
)
def test_a_broken_line_of_an_unfinished_diagnosis_ended_the_next_one(tmp_path, line) -> None:
    path = tmp_path / "unfinished.jsonl"
    about, first, second = unfinished_seed()[0].splitlines()
    path.write_text("\n".join([about, first, line, second]) + "\n")
    assert len(Unfinished.of(path, RECORDINGS, 0)) == 2


def test_a_changed_answer_of_an_unfinished_diagnosis_was_believed(tmp_path) -> None:
    path = tmp_path / "unfinished.jsonl"
    about, first, second = unfinished_seed()[0].splitlines()
    content = json.loads(first)
    content["answer"]["array"] = content["answer"]["array"].replace("8D8", "8D9", 1)
    path.write_text("\n".join([about, json.dumps(content), second]) + "\n")
    found = Unfinished.of(path, RECORDINGS, 0)
    assert len(found) == 1
    with found.used():
        assert np.array_equal(answered(np.add, np.zeros(3), np.ones(3)), np.ones(3))


def test_a_replay_of_an_unknown_compression_was_a_traceback_and_left_its_file_open(tmp_path) -> None:
    seed = (CORPUS / "replay.npz").read_bytes()
    # The version that is needed to unpack it, in the central directory; and no archive at all.
    place = seed.index(b"PK\x01\x02") + 6
    refused(
        read_replay, tmp_path / "a.npz", seed[:place] + b"\xa0" + seed[place + 1 :], "no NPZ of plain numbers"
    )
    refused(read_replay, tmp_path / "b.npz", b"PK\x03\x04" + bytes(30), "no NPZ of plain numbers")


@pytest.mark.parametrize("first", [np.zeros(3), np.zeros((8, 0)), np.full(8, "x"), None])
def test_a_replay_whose_episodes_have_another_length_was_a_traceback(tmp_path, first) -> None:
    path = tmp_path / "replay.npz"
    np.savez(path, states=np.zeros((8, 4)), **({} if first is None else {"is_first": first}))
    if first is None:
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("is_first.npy", b"no array")
    refused(read_replay, path, path.read_bytes(), "8 rows of states, but is_first is ")


def test_a_number_of_400_digits_was_a_traceback(tmp_path) -> None:
    with pytest.raises(IrtError, match="more than 308 digits"):
        Expression.parse(f"xb * {DIGITS}")
    camera = (CORPUS / "camera.toml").read_text().replace("600.0", DIGITS)
    refused(load_lens, tmp_path / "camera.toml", camera.encode(), "matrix: expected a finite number")
    (tmp_path / "run.csv").write_bytes((CORPUS / "cmd.csv").read_bytes())
    rig = (CORPUS / "rig.toml").read_text().replace("[0.08, 0.05]", f"[0.08, {DIGITS}]")
    (tmp_path / "rig.toml").write_text(rig)
    with pytest.raises(IrtError, match="holes: number 1: expected a number"):
        load_rig(tmp_path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"dtype":"F32","shape":[2,4]', b'"dtype":"BF16","shape":[4,4]'),
        (b'"dtype":"F32","shape":[2,4]', b'"dtype":"F8_E4M3","shape":[8,4]'),
        (b'"irt":"{', b'"irt":"[1]{'),
        (b'"irt":"{', b'"irt":"7{'),
    ],
    ids=["half precision of another kind", "quarter precision", "list", "number"],
)
def test_a_network_of_another_kind_was_a_traceback(tmp_path, old, new) -> None:
    seed = (CORPUS / "network.safetensors").read_bytes()
    (length,) = struct.unpack_from("<Q", seed)
    header = seed[8 : 8 + length]
    assert old in header
    header = header.replace(old, new)
    if new.endswith(b"{"):
        begin = header.index(new) + len(new) - 1
        end = header.index(b'}"', begin) + 1
        header = header[:begin] + header[end:]
    data = struct.pack("<Q", len(header)) + header + seed[8 + length :]
    refused(load_network, tmp_path / "network.safetensors", data, "cut short or no safetensors file")


def test_a_topic_without_a_type_in_a_bag_was_a_traceback(tmp_path) -> None:
    path = tmp_path / "lab.db3"
    path.write_bytes((CORPUS / "lab.db3").read_bytes())
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.executescript(
            "CREATE TABLE bare AS SELECT * FROM topics; DROP TABLE topics;"
            "ALTER TABLE bare RENAME TO topics; UPDATE topics SET type = NULL;"
        )
    with pytest.raises(IrtError, match="a topic lacks its name or its type"):
        topics_of(path)


@pytest.mark.parametrize(
    ("column", "value", "rows"),
    [("t", "1e308", 1), ("xb", "1e155", 1), ("alpha", "1e308", 400), ("a0", "1e30", 3), ("a0", "1e308", 1)],
)
def test_a_number_too_large_to_square_in_a_log_warned_in_its_import(column, value, rows) -> None:
    (reader,) = (one for one in READERS if one.name == "import")
    header, *lines = str(reader.seeds()[0]).splitlines()
    place = header.split(",").index(column)
    for row in range(300, 300 + rows):
        cells = lines[row].split(",")
        cells[place] = value
        lines[row] = ",".join(cells)
    # Warnings count as errors there; such a number counts as missing.
    assert outcome(reader, "\n".join([header, *lines]).encode()) is None


def test_a_command_of_one_row_that_nothing_follows_was_a_traceback_of_the_import() -> None:
    """The search of the dead time went on to where the first rows have no command."""
    (reader,) = (one for one in READERS if one.name == "import")
    header, *lines = str(reader.seeds()[0]).splitlines()
    lines[761] = lines[761].replace(",4.5675,", ",1000,")
    assert ",1000," in lines[761]
    assert outcome(reader, "\n".join([header, *lines]).encode()) is None


def _changed_run(path: Path, column: str, value: str) -> Path:
    """Write a recording of the corpus with a formula of its row in each cell of a column."""
    header, *lines = (CORPUS / "run.csv").read_text(encoding="utf-8").splitlines()
    names = header.split(",")
    rows = [dict(zip(names, line.split(","), strict=True)) for line in lines]
    for number, row in enumerate(rows):
        row[column] = value.format(number)
    path.write_text("\n".join([header, *(",".join(row.values()) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_a_log_of_so_few_rows_that_none_follows_warned_in_its_import(rows) -> None:
    (reader,) = (one for one in READERS if one.name == "import")
    lines = str(reader.seeds()[0]).splitlines()[: 1 + rows]
    refused_with = outcome(reader, ("\n".join(lines) + "\n").encode())
    assert refused_with is not None
    assert "no run of at least 30 rows and 1 s between gaps" in refused_with


def test_tilts_too_large_to_average_warned(tmp_path) -> None:
    path = _changed_run(tmp_path / "run.csv", "tilt_y_rad", "1e308")
    with pytest.raises(IrtError, match=r"line 2, column tilt_y_rad: 1e\+308 is not an angle"):
        load_recording(path)


def test_stamps_too_close_for_a_rate_were_a_traceback_of_irt_check(tmp_path) -> None:
    path = _changed_run(tmp_path / "run.csv", "t_s", "{}e-320")
    with pytest.raises(IrtError, match=r"line 3, column t_s: most rows are .* s apart, and no camera is as"):
        load_recording(path)


def test_jumps_of_a_tilt_too_large_to_multiply_warned() -> None:
    tilt = np.zeros((40, 2))
    tilt[20:22] = 1e200
    wrong = np.zeros((40, 2), dtype=bool)
    wrong[20:22] = True
    np.testing.assert_array_equal(tilt_jumps(tilt, np.arange(40) / 40.0), wrong)


def test_draws_of_a_posterior_that_overflow_warned(tmp_path) -> None:
    path = tmp_path / "model.toml"
    text = (CORPUS / "model.toml").read_text().replace("linear = [0.001, 0.0]", "linear = [1e308, 1e308]")
    path.write_text(text)
    with pytest.raises(IrtError, match="no draw lies within the bounds"):
        load_model(path).sample(20)


def test_a_broken_video_printed_a_line_for_each_broken_byte(tmp_path, capfd) -> None:
    seed = (CORPUS / "film.avi").read_bytes()
    for old, new in ((b"LIST", b"LUST"), (b"RIFF", b"RAFF"), (b"hdrl", b"hdrx")):
        path = tmp_path / "film.avi"
        path.write_bytes(changed(seed, old, new))
        try:
            open_source(f"{path}").sample(8)
        except IrtError as error:
            assert "\n" not in str(error)  # noqa: PT017  # whether it can be read is FFmpeg's affair
    assert capfd.readouterr() == ("", "")
