from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from irt.errors import IrtError
from irt.recording import CMD, Recording, save_recording
from irt.rig import PARAMETERS, RANGES, Board, Commands, Marble, Rig, TiltSensor, check_value, load_rig

RUN = (np.zeros((3, 2)), np.zeros((3, 2)))


def test_without_settings_it_is_the_paper_s_labyrinth(write_rig) -> None:
    rig = load_rig(write_rig({"run": RUN}))
    assert rig.board == Board(0.276, 0.231, 0.0, 0.25)
    assert rig.marble == Marble(0.00685, 0.0105, 0.0)
    assert rig.start == "rest"
    assert rig.ranges == RANGES
    assert tuple(rig.ranges) == PARAMETERS


def test_reads_what_stands_there(write_rig) -> None:
    toml = """
    [board]
    edge_x_m = 0.4
    edge_y_m = 0.3
    wall_restitution = 0.5
    wall_friction = 0
    [marble]
    radius_m = 0.02
    mass_kg = 0.0027
    damping_per_s = 0.04
    [recordings]
    start = "moving"
    [parameters]
    gear_x = { range = [0.2, 2] }
    """
    rig = load_rig(write_rig({"run": RUN}, toml))
    assert rig.board == Board(0.4, 0.3, 0.5, 0.0)
    assert rig.marble == Marble(0.02, 0.0027, 0.04)
    assert rig.start == "moving"
    assert rig.ranges == RANGES | {"gear_x": (0.2, 2.0)}


@pytest.mark.parametrize("text", ["", "# nothing\n", "\ufeff[board]\r\nedge_x_m = 0.276\r\n"])
def test_settings_may_say_little(write_rig, text: str) -> None:
    assert load_rig(write_rig({"run": RUN}, text)).board == Board()


def test_recordings_come_in_the_order_of_their_numbers(write_rig) -> None:
    rig = load_rig(write_rig(dict.fromkeys(["run-10", "run-2", "run-1", "a"], RUN)))
    assert [recording.name for recording in rig.recordings] == ["a", "run-1", "run-2", "run-10"]


def test_hidden_files_and_folders_are_no_recordings(write_rig) -> None:
    folder = write_rig({"run": RUN})
    (folder / "._run.csv").write_bytes(b"\x00\x05\x16\x07")
    (folder / "old.csv").mkdir()
    (folder / "notes.txt").write_text("x")
    assert [recording.name for recording in load_rig(folder).recordings] == ["run"]


BAD = {
    "broken": ("[board\n", r"rig\.toml: broken TOML: .*line 1, column 7"),
    "unknown section": (
        "[bord]\n",
        r'rig\.toml: unknown section "bord"; did you mean "board"\? possible: board, ',
    ),
    "unknown key": (
        "[board]\nedge_z_m = 1\n",
        r'rig\.toml, \[board\]: unknown key "edge_z_m"; did you mean "edge_[xy]_m"\? possible: edge_x_m',
    ),
    "unknown parameter": (
        "[parameters]\ngear_z = { range = [0, 1] }\n",
        r'rig\.toml, \[parameters\]: unknown parameter "gear_z"; did you mean "gear_[xy]"\? possible: gear_x',
    ),
    "unknown key of a parameter": (
        "[parameters]\ngear_x = { value = 1 }\n",
        r'rig\.toml, \[parameters\], gear_x: unknown key "value"; possible: range',
    ),
    "a number for a range": (
        "[parameters]\ngear_x = 0.1\n",
        r"\[parameters\], gear_x: expected \{ range = \[low, high\] \}, found 0\.1",
    ),
    "no range": ("[parameters]\ngear_x = {}\n", r"gear_x, range: expected \[low, high\], found nothing"),
    "upside down": (
        "[parameters]\ngear_x = { range = [0.2, 0.1] }\n",
        r"\[parameters\]: gear_x: the range \[0\.2, 0\.1\] is upside down",
    ),
    "no width": ("[parameters]\ngear_x = { range = [1, 1] }\n", "gear_x: the range .* is empty"),
    "three ends": (
        "[parameters]\ngear_x = { range = [0, 1, 2] }\n",
        r"expected \[low, high\], found \[0, 1, 2\]",
    ),
    "infinite": (
        "[parameters]\ngear_x = { range = [0, inf] }\n",
        "gear_x, range: expected a finite number, found inf",
    ),
    "impossible": (
        "[parameters]\nrolling_friction = { range = [-1, 1] }\n",
        "rolling_friction: expected a number from 0 to 100, found -1",
    ),
    "text": ("[board]\nedge_x_m = '276 mm'\n", r'\[board\], edge_x_m: expected a number, found "276 mm"'),
    "millimetres": (
        "[board]\nedge_x_m = 276\n",
        r"\[board\]: edge_x_m: expected a number from 1e-09 to 10 m, found 276",
    ),
    "no size": ("[board]\nedge_y_m = 0\n", "edge_y_m: expected a number from 1e-09"),
    "restitution": (
        "[board]\nwall_restitution = 1.5\n",
        "wall_restitution: expected a number from 0 to 1, found 1.5",
    ),
    "mass": ("[marble]\nmass_kg = -1\n", r"\[marble\]: mass_kg: expected a number from 1e-09 to 1000 kg"),
    "too big": ("[marble]\nradius_m = 0.2\n", r"\[marble\]: radius_m: a marble of 0\.2 m does not fit"),
    "start": ("[recordings]\nstart = 'movin'\n", r'start: unknown start "movin"; did you mean "moving"\?'),
    "start number": ("[recordings]\nstart = 1\n", "start: expected text in quotes, found 1"),
    "section": ("board = 3\n", r"board: expected a section \[board\], found 3"),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_bad_settings(write_rig, text: str, message: str) -> None:
    folder = write_rig({"run": RUN}, text)
    with pytest.raises(IrtError, match=message):
        load_rig(folder)


def test_a_bad_recording_is_named(write_rig) -> None:
    folder = write_rig({"run-1": RUN})
    (folder / "run-2.csv").write_text("step\n")
    with pytest.raises(IrtError, match=r"run-2\.csv, line 1: column knob_x_rad is missing"):
        load_rig(folder)


def test_no_recording(tmp_path: Path) -> None:
    with pytest.raises(
        IrtError, match=r"the rig holds no recording; put at least one \*\.csv into this folder"
    ):
        load_rig(tmp_path)


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(IrtError, match="no such folder; give a folder with recordings"):
        load_rig(tmp_path / "none")
    (tmp_path / "file").write_text("x")
    with pytest.raises(IrtError, match="a rig is a folder, and this is a file"):
        load_rig(tmp_path / "file")


def test_dimensions_are_checked_in_python_too() -> None:
    with pytest.raises(IrtError, match="edge_x_m"):
        Board(edge_x_m=float("nan"))
    with pytest.raises(IrtError, match="damping_per_s"):
        Marble(damping_per_s=-1.0)
    with pytest.raises(IrtError, match="radius_m: expected a number from 1e-09 to 1 m, found 5"):
        Marble(radius_m=5)


def test_a_marble_has_room_between_the_walls() -> None:
    run = Recording.from_arrays(commands=np.zeros((3, 2)), marble=np.zeros((3, 2)))
    board = Board(0.276, 0.2)
    assert Rig.from_recordings([run], board=board, marble=Marble(0.0999)).marble.radius_m == 0.0999
    message = r"radius_m: a marble of 0\.1 m does not fit between the walls of a board of 0\.276 m x 0\.2 m"
    with pytest.raises(IrtError, match=message):
        Rig.from_recordings([run], board=board, marble=Marble(0.1))


def test_check_value() -> None:
    for name, (low, high) in RANGES.items():
        check_value(name, low)
        check_value(name, 3 * high)  # as far as least squares may go
    with pytest.raises(IrtError, match='unknown parameter "friction"'):
        check_value("friction", 1.0)
    with pytest.raises(IrtError, match=r"time_scale: expected a number from 0 to 5000, found 1e\+06"):
        check_value("time_scale", 1e6)


def test_reads_every_shared_rig(shared: Path) -> None:
    for folder in sorted((shared / "rigs").glob("rig-*")):
        rig = load_rig(folder)
        assert len(rig.recordings) == 12
        assert rig.start == "rest"
    rig = load_rig(shared / "real" / "ball-table")
    assert [recording.name for recording in rig.recordings] == [f"run-{i}" for i in range(1, 7)]
    assert rig.start == "moving"
    assert rig.ranges["time_scale"] == (24.0, 72.0)
    assert all(recording.stamps is not None for recording in rig.recordings)


class TestSignals:
    def test_sections_for_commands_and_tilt(self, write_rig) -> None:
        toml = """
        [commands]
        unit = "mA"
        matrix = true
        [tilt]
        noise_rad = 0.001
        offset = { range = [-0.1, 0.05] }
        """
        rig = load_rig(write_rig({"run": RUN}, toml))
        assert rig.commands == Commands("mA", True)
        assert rig.tilt == TiltSensor(0.001, (-0.1, 0.05))
        assert not rig.has_tilt
        assert rig.digest != load_rig(write_rig({"run": RUN}, folder="other")).digest

    @pytest.mark.parametrize(
        ("toml", "message"),
        [
            ("[commands]\nunit = 1", r"rig\.toml, \[commands\], unit: expected text in quotes"),
            ("[commands]\nmatrix = 1", r"rig\.toml, \[commands\], matrix: expected true or false, found 1"),
            ("[commands]\nunits = 'A'", r"\[commands\]: unknown key"),
            ("[tilt]\nnoise_rad = 0", r"\[tilt\]: noise_rad: expected a number from"),
            ("[tilt]\noffset = [-1, 1]", r"\[tilt\], offset: expected { range = \[low, high\] }"),
            (
                "[tilt]\noffset = { range = [1, -1] }",
                r"\[tilt\]: offset: the range \[1.0, -1.0\] is upside down",
            ),
        ],
    )
    def test_bad_sections_are_named(self, write_rig, toml: str, message: str) -> None:
        folder = write_rig({"run": RUN}, toml)
        with pytest.raises(IrtError, match=message):
            load_rig(folder)

    def test_commands_in_an_unnamed_unit(self, tmp_path: Path) -> None:
        save_recording(tmp_path / "run.csv", *RUN, columns=CMD)
        with pytest.raises(IrtError, match=r"cmd_x, cmd_y, commands in the rig's own unit; name it"):
            load_rig(tmp_path)

    def test_gears_of_an_own_unit_have_either_sign_and_end_at_the_boards_stops(self, tmp_path: Path) -> None:
        commands = np.array([[0.0, 0.0], [50.0, -200.0], [0.0, 0.0]])
        save_recording(tmp_path / "run.csv", commands, RUN[1], columns=CMD)
        toml = '[commands]\nunit = "us"\n[parameters]\ngear_y = { range = [0, 1] }\n'
        (tmp_path / "rig.toml").write_text(toml)
        rig = load_rig(tmp_path)
        assert rig.ranges["gear_x"] == pytest.approx((-0.14 / 200.0, 0.14 / 200.0))
        assert rig.ranges["gear_y"] == (0.0, 1.0)
        # As large, compared with the largest tilt, as for knobs that turn by 0.2 rad with a gear of 0.1.
        assert rig.ranges["rolling_friction"] == pytest.approx((0.0, 0.001 * 0.14 / (0.1 * 0.2)))
        save_recording(tmp_path / "run.csv", commands / 1e6, RUN[1], columns=CMD)
        assert load_rig(tmp_path).ranges["gear_x"] == (-100.0, 100.0)
        in_memory = Rig.from_recordings(rig.recordings, commands=rig.commands)
        assert in_memory.ranges["gear_x"] == rig.ranges["gear_x"]

    def test_all_recordings_have_the_same_kind_of_commands(self, tmp_path: Path) -> None:
        save_recording(tmp_path / "run-1.csv", *RUN)
        save_recording(tmp_path / "run-2.csv", *RUN, columns=CMD)
        with pytest.raises(IrtError, match=r"run-2\.csv: its commands are cmd_x, cmd_y, those of run-1"):
            load_rig(tmp_path)

    def test_what_looks_at_places_alone_gets_runs_with_a_marble(self, tmp_path: Path) -> None:
        lost, tilt = np.full((3, 2), np.nan), np.full((3, 2), 0.01)
        save_recording(tmp_path / "run-1.csv", RUN[0], lost, tilt=tilt)
        with pytest.raises(IrtError, match="no recording has a marble, which this needs"):
            load_rig(tmp_path).of_marbles()
        save_recording(tmp_path / "run-2.csv", *RUN, tilt=tilt)
        (kept,) = load_rig(tmp_path).of_marbles().recordings
        assert kept.name == "run-2"
        assert kept.tilt is None
        save_recording(tmp_path / "run-1.csv", *RUN)
        save_recording(tmp_path / "run-2.csv", *RUN)
        rig = load_rig(tmp_path)
        assert rig.of_marbles() is rig
