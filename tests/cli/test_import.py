"""`irt import`: other labs' logs from the command line, and one line for each bad input."""

from __future__ import annotations

import pickle
import re
import shlex
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lab_logs
from irt.cli.demo import data
from irt.model import load_model
from irt.recording import load_recording, save_recording
from irt.rig import Board, load_rig
from lab_logs import Convention, Truth, simulate, write_bag, write_csv

DECLARED = Convention(np.ones(2), False, np.ones(2), 0.0)
MAP = [
    word
    for target in (
        "t_s=stamp_ms/1000",
        "marble_x=xb/0.276",
        "marble_y=yb/0.276",
        "tilt_x_rad=alpha",
        "tilt_y_rad=beta",
        "cmd_x=u1",
        "cmd_y=u2",
    )
    for word in ("--map", target)
]


@pytest.fixture(scope="module")
def truth() -> Truth:
    return simulate(np.random.default_rng(3), seconds=25.0, by_rows=True)


def columns(truth: Truth) -> dict[str, np.ndarray]:
    return {
        "stamp_ms": 1e3 * truth.stamps,
        "xb": truth.marble_m[:, 0],
        "yb": truth.marble_m[:, 1],
        "alpha": truth.tilt[:, 0],
        "beta": truth.tilt[:, 1],
        "u1": truth.commands[:, 0],
        "u2": truth.commands[:, 1],
    }


def test_a_csv_with_swapped_tilt_is_put_right_and_said(
    tmp_path: Path, truth: Truth, irt: Callable[..., Any]
) -> None:
    table = columns(truth)
    table["alpha"], table["beta"] = table["beta"], -table["alpha"]
    log = write_csv(tmp_path / "log.csv", table)
    rig = tmp_path / "rig"
    dry = irt("import", log, "--from", "csv", *MAP, "--out", rig, "--dry-run")
    assert dry.status == 0, dry.err
    assert "dry run: nothing was written" in dry.out
    assert not rig.exists()
    done = irt("import", log, "--from", "csv", *MAP, "--out", rig)
    assert done.status == 0, done.err
    assert 'tilt "beta" moves y by +' in done.out
    assert "our tilt_x, sign turned; surely" in done.out
    assert 'tilt "alpha" moves x by +' in done.out
    assert "our tilt_y, sign kept; surely" in done.out
    assert f"{truth.held.sum()} held at the last position" in done.out
    assert f"{truth.jumped.sum()} with a jump of the tilt" in done.out
    recording = load_recording(rig / "log.csv")
    assert recording.tilt is not None
    known = np.isfinite(recording.tilt)
    assert np.allclose(recording.tilt[known], truth.tilt[: len(recording.tilt)][known])
    loaded = load_rig(rig)
    assert loaded.start == "moving"
    assert loaded.tilt.noise_rad == pytest.approx(np.deg2rad(0.05), rel=0.25)
    # A second import adds a recording, and keeps the first and rig.toml.
    before = (rig / "log.csv").read_bytes()
    again = irt("import", log, "--from", "csv", *MAP, "--out", rig)
    assert "rig.toml kept as it was" in again.out
    assert (rig / "log.csv").read_bytes() == before
    assert sorted(path.name for path in rig.glob("*.csv")) == ["log-2.csv", "log.csv"]


def test_formats_are_known_by_their_content(tmp_path: Path, truth: Truth, irt: Callable[..., Any]) -> None:
    bag = write_bag(tmp_path / "bag", truth, DECLARED)
    assert ": cyberrunner, " in irt("import", bag, "--dry-run").out
    tag_bag = write_bag(
        tmp_path / "tag-bag", truth, DECLARED, package="tag_interfaces", command="HiwonderVel", storage="mcap"
    )
    (file,) = tag_bag.glob("*.mcap")
    assert ": tag, " in irt("import", file, "--dry-run").out
    folder = lab_logs.write_tag_folder(tmp_path / "tag", truth, DECLARED)
    assert ": tag, " in irt("import", folder, "--dry-run").out
    unknown = write_csv(tmp_path / "unknown.csv", {"a": [1, 2], "b": [3, 4]})
    asked = irt("import", unknown)
    assert asked.status == 1
    assert (
        "columns of no known lab (a, b); name them with --map, such as --map marble_x=xb/0.276" in asked.err
    )
    assert "or choose with --from rig|cyberrunner|tag|csv" in asked.err
    upper = unknown.rename(tmp_path / "UNKNOWN.CSV")
    assert "columns of no known lab (a, b)" in irt("import", upper).err
    mixed = irt("import", bag, folder)
    assert "sources of several kinds (cyberrunner, tag)" in mixed.err


def test_columns_of_no_known_lab_are_mapped_as_suggested(
    tmp_path: Path, truth: Truth, irt: Callable[..., Any]
) -> None:
    known = columns(truth)
    log = write_csv(
        tmp_path / "a log.csv",
        {
            "Time [ms]": known["stamp_ms"],
            "Status": ["rolls"] * len(known["xb"]),
            "Ball X (mm)": 1e3 * known["xb"] + 138.0,
            "Ball Y (mm)": 1e3 * known["yb"] + 115.5,
            "Roll": np.rad2deg(known["alpha"]),
            "Pitch": np.rad2deg(known["beta"]),
            "Servo 1": known["u1"],
            "Servo 2": known["u2"],
        },
    )
    for asked in (irt("import", log), irt("import", log, "--from", "csv")):
        assert asked.status == 1
        (suggested,) = re.findall(
            r"by their names and units this may be right: irt (.*) --dry-run", asked.err
        )
        done = irt(*shlex.split(suggested), "--out", tmp_path / "rig")
        assert done.status == 0, done.err
        for axis in "xy":
            assert f"our tilt_{axis}, sign kept; surely" in done.out
            assert f"our cmd_{axis}; surely" in done.out
        shutil.rmtree(tmp_path / "rig")
    refused = irt("check", log)
    assert "this is a file; give a folder with recordings (*.csv), which `irt import` makes" in refused.err
    (tmp_path / "rig").mkdir()
    log.rename(tmp_path / "rig" / "log.csv")
    refused = irt("check", tmp_path / "rig")
    assert "no column of a recording among Time [ms], Status, Ball X (mm)" in refused.err
    assert "`irt import` converts logs with other columns" in refused.err


def test_a_cyberrunner_without_ros(tmp_path: Path, truth: Truth, irt: Callable[..., Any]) -> None:
    # Its row i is seen after action i: what our row i commands stands in its row i + 1.
    actions = np.roll(truth.commands, 1, axis=0)
    rows = len(actions)
    table = {
        "t": truth.stamps,
        "episode": (np.arange(rows) > rows // 2).astype(int),
        "step": np.arange(rows),
        "xb": truth.marble_m[:, 0],
        "yb": truth.marble_m[:, 1],
        "vx": np.zeros(rows),
        "vy": np.zeros(rows),
        "alpha": truth.tilt[:, 0],
        "beta": truth.tilt[:, 1],
        "a0": actions[:, 0],
        "a1": actions[:, 1],
        "ball_found": ["0" if held else "1" for held in truth.held],
        "status": ["ok"] * rows,
        "tag": ["x"] * rows,
    }
    log = write_csv(tmp_path / "odil.csv", table)
    done = irt("import", log, "--out", tmp_path / "rig")
    assert done.status == 0, done.err
    recordings = load_rig(tmp_path / "rig").recordings
    assert [one.name for one in recordings] == ["odil-1", "odil-2"]
    assert "1 new episodes" in done.out
    # Declared is cmd_x = a1, which stays where each action moves both axes.
    assert "matrix = true" in done.out
    moved = truth.commands[:, ::-1]
    first = recordings[0]
    begin = int(np.argmin(np.abs(truth.marble_m[:, 0] / 0.276 - first.marble[0, 0])))
    assert np.array_equal(first.knobs[:-1], moved[begin : begin + len(first.knobs) - 1])


def replay(truth: Truth) -> dict[str, np.ndarray]:
    """Return a CyberRunner's replay of one episode."""
    states = np.column_stack(
        [
            -truth.tilt[:, 1] / np.deg2rad(10.0),
            truth.tilt[:, 0] / np.deg2rad(10.0),
            truth.marble_m[:, 0] / 0.276 + 0.5,
            truth.marble_m[:, 1] / 0.231 + 0.5,
        ]
    )
    return {"states": states, "action": truth.commands, "is_first": np.zeros(len(states))}


def test_a_replay(tmp_path: Path, irt: Callable[..., Any]) -> None:
    truth = simulate(np.random.default_rng(3), seconds=25.0, rate=50.0, by_rows=True)
    np.savez(tmp_path / "replay.npz", **replay(truth))  # type: ignore[arg-type]
    done = irt("import", tmp_path / "replay.npz", "--out", tmp_path / "rig")
    assert done.status == 0, done.err
    assert "a replay has no stamps: rows are assumed to be 1/55 s apart" in done.out
    found = re.search(r"rows ([0-9.]+) s apart would make it 5/7 g", done.out)
    assert found
    assert float(found[1]) == pytest.approx(0.02, rel=0.02)
    assert 'tilt "-alpha" moves x by +' in done.out
    (recording,) = load_rig(tmp_path / "rig").recordings
    assert recording.stamps is None


@pytest.fixture(scope="module")
def currents() -> Truth:
    """A CyberRunner whose motors turn the board at a rate that their currents set."""
    return simulate(np.random.default_rng(7), seconds=25.0, by_rows=True, motors=True, spoil=False)


def test_currents_that_set_rates(tmp_path: Path, currents: Truth, irt: Callable[..., Any]) -> None:
    np.savez(tmp_path / "replay.npz", **replay(currents))  # type: ignore[arg-type]
    done = irt("import", tmp_path / "replay.npz", "--out", tmp_path / "rig")
    assert done.status == 0, done.err
    assert 'command "action_2" turns tilt_x at -0.' in done.out
    assert 'command "action_1" turns tilt_y at +0.' in done.out
    assert "the measured tilt is" in done.out
    assert "clocks differ" not in done.out
    rig = load_rig(tmp_path / "rig")
    assert rig.commands.unit == "rad"
    (recording,) = rig.recordings
    assert recording.tilt is None
    over_rows = 0.5 * (currents.tilt[:-1] + currents.tilt[1:])
    zero = np.mean(over_rows - recording.knobs[:-1], axis=0)
    assert recording.knobs[:-1] == pytest.approx(over_rows - zero, abs=1e-9)
    assert zero == pytest.approx(currents.level, abs=0.001)

    # A unit of current is -1/200 of an action, and a negative current about x turns the board up.
    motors = tomllib.loads((tmp_path / "rig" / "twin.toml").read_text())["twin"]
    gains = np.array([currents.gear[0, 1], -currents.gear[1, 0]]) / 200.0
    assert motors["current_rad_s"] == pytest.approx(gains.tolist(), rel=0.05)
    assert motors["current_dead"] == pytest.approx([200.0 * currents.dead] * 2, rel=0.05)

    fitted = irt("tune", tmp_path / "rig", "--out", tmp_path / "tuned")
    assert fitted.status == 0, fitted.err
    model = load_model(tmp_path / "tuned" / "model.toml")
    # Without stamps only ratios are known.
    ratio = model.parameters["gear_x"].value / model.parameters["gear_y"].value
    assert ratio == pytest.approx(1.0, abs=0.02)


def test_runs_without_a_tilt_are_left_out_where_commands_are_rates(
    tmp_path: Path, currents: Truth, irt: Callable[..., Any]
) -> None:
    table = columns(currents)
    table["alpha"], table["beta"] = table["alpha"].astype(object), table["beta"].astype(object)
    table["run"] = np.where(np.arange(len(currents.stamps)) < 900, 1, 2)
    table["alpha"][900:] = ""
    log = write_csv(tmp_path / "log.csv", table)
    done = irt("import", log, "--from", "csv", *MAP, "--episode", "run", "--out", tmp_path / "rig")
    assert done.status == 0, done.err
    assert "1 runs without a measured tilt left out: commands are rates" in done.out
    (recording,) = load_rig(tmp_path / "rig").recordings
    assert len(recording.knobs) == 900
    assert not (tmp_path / "rig" / "twin.toml").exists()


def test_rates_go_to_no_rig_in_another_unit(
    tmp_path: Path, truth: Truth, currents: Truth, irt: Callable[..., Any]
) -> None:
    for name, one in (("angles", truth), ("currents", currents)):
        np.savez(tmp_path / f"{name}.npz", **replay(one))  # type: ignore[arg-type]
    assert irt("import", tmp_path / "angles.npz", "--out", tmp_path / "rig").status == 0
    before = sorted((tmp_path / "rig").iterdir())
    failed = irt("import", tmp_path / "currents.npz", "--out", tmp_path / "rig")
    assert failed.status == 1
    assert "commands of this rig are in action" in failed.err
    assert "are rates, for which the measured tilt is written [rad]; import into another folder" in failed.err
    assert sorted((tmp_path / "rig").iterdir()) == before


def test_tilt_alone(tmp_path: Path, truth: Truth, irt: Callable[..., Any]) -> None:
    log = write_csv(tmp_path / "log.csv", columns(truth))
    words = [word for word in MAP if not word.startswith("marble")]
    words = [
        word
        for word, after in zip(words, [*words[1:], ""], strict=True)
        if (word, after) != ("--map", "--map")
    ]
    done = irt("import", log, "--from", "csv", *words, "--out", tmp_path / "rig")
    assert done.status == 0, done.err
    assert "no marble: runs of tilt alone" in done.out
    (recording,) = load_rig(tmp_path / "rig").recordings
    assert not recording.has_marble


def test_commands_without_tilt(tmp_path: Path, truth: Truth, irt: Callable[..., Any]) -> None:
    table = columns(truth)
    table["alpha"] = table["beta"] = np.full(len(truth.stamps), np.nan)
    log = write_csv(tmp_path / "log.csv", table)
    words = MAP[:6] + MAP[10:]
    done = irt("import", log, "--from", "csv", *words, "--out", tmp_path / "rig")
    assert done.status == 0, done.err
    assert "no measured tilt" in done.out
    assert "(by the marble's acceleration)" in done.out
    rig = load_rig(tmp_path / "rig")
    order = (0, 1) if abs(truth.gear[0, 0]) > abs(truth.gear[0, 1]) else (1, 0)
    low, high = rig.ranges["gear_x"]
    assert low < truth.gear[0, order[0]] < high


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_only_commands_that_come_after_their_effect_are_moved(
    tmp_path: Path, irt: Callable[..., Any], late_s: float
) -> None:
    """Backlash looks like a lag that is longer than it can be, with a dead time below zero."""
    rig = load_rig(data("demo-rig"))
    late = round(late_s / 0.05)
    for one in rig.recordings:
        knobs = np.concatenate([np.repeat(one.knobs[:1], late, axis=0), one.knobs[: len(one.knobs) - late]])
        save_recording(tmp_path / f"{one.name}.csv", knobs, one.marble, one.stamps)
    done = irt("import", *sorted(tmp_path.glob("*.csv")), "--from", "csv", "--dry-run")
    assert done.status == 0, done.err
    moved = re.search(r"clocks differ by at least ([0-9.]+) s; corrected by this", done.out)
    assert (moved is not None) == (late_s > 0.0)
    if moved is not None:
        assert float(moved[1]) == pytest.approx(late_s, abs=0.05)


Spoil = Callable[[dict[str, np.ndarray], list[str]], None]


def degrees(table: dict[str, np.ndarray], words: list[str]) -> None:
    table["alpha"], table["beta"] = np.rad2deg(table["alpha"]), np.rad2deg(table["beta"])


def all_lost(table: dict[str, np.ndarray], words: list[str]) -> None:
    table["xb"] = np.full(len(table["xb"]), np.nan)


def nanoseconds(table: dict[str, np.ndarray], words: list[str]) -> None:
    table["stamp_ms"] = 1e9 * (table["stamp_ms"] + 1.7e12)


def other_time(table: dict[str, np.ndarray], words: list[str]) -> None:
    words += ["--map", "cmd_t_s=stamp_ms/1000+5000"]


def no_column(table: dict[str, np.ndarray], words: list[str]) -> None:
    words[words.index("tilt_x_rad=alpha")] = "tilt_x_rad=alfa"


def no_expression(table: dict[str, np.ndarray], words: list[str]) -> None:
    words[words.index("tilt_x_rad=alpha")] = "tilt_x_rad=abs(alpha)"


def millimetres(table: dict[str, np.ndarray], words: list[str]) -> None:
    table["xb"], table["yb"] = 1e3 * table["xb"], 1e3 * table["yb"]


def from_a_corner(table: dict[str, np.ndarray], words: list[str]) -> None:
    table["xb"], table["yb"] = table["xb"] + 0.138, table["yb"] + 0.1155


def no_stamps(table: dict[str, np.ndarray], words: list[str]) -> None:
    del words[:2]


def no_episode(table: dict[str, np.ndarray], words: list[str]) -> None:
    words += ["--episode", "run"]


def two_kinds(table: dict[str, np.ndarray], words: list[str]) -> None:
    words += ["--map", "knob_x_rad=u1"]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (degrees, 'it seems to be in degrees; convert it with --map "tilt_x_rad=rad(alpha)"'),
        (all_lost, "the marble is lost in every row"),
        (nanoseconds, "stamps seem to be in nanoseconds"),
        (other_time, "commands and states do not overlap in time"),
        (no_column, 'unknown column "alfa"; did you mean "alpha"'),
        (no_expression, '"abs(alpha)" is no expression'),
        (millimetres, "of the positions lie outside the board"),
        (from_a_corner, "subtract 0.5 if the origin is a corner"),
        (no_stamps, "no stamps of the rows"),
        (no_episode, "no column run for --episode"),
        (two_kinds, "map one pair"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    tmp_path: Path, truth: Truth, irt: Callable[..., Any], spoil: Spoil, said: str
) -> None:
    table, words = columns(truth), list(MAP)
    spoil(table, words)
    if spoil is nanoseconds:
        words[1] = "t_s=stamp_ms/1000"
    log = write_csv(tmp_path / "log.csv", table)
    failed = irt("import", log, "--from", "csv", *words, "--out", tmp_path / "rig")
    assert failed.status == 1
    assert said in failed.err
    assert failed.err.count("\n") == 1
    assert not (tmp_path / "rig").exists()


def test_tilt_of_another_length(tmp_path: Path, truth: Truth, irt: Callable[..., Any]) -> None:
    np.savez(tmp_path / "replay.npz", states=np.zeros((100, 4)), action=np.zeros((90, 2)))
    failed = irt("import", tmp_path / "replay.npz", "--out", tmp_path / "rig")
    assert "100 rows of states, but 90 of actions; they must be of one length" in failed.err
    log = write_csv(tmp_path / "log.csv", columns(truth))
    text = log.read_text().splitlines()
    log.write_text("\n".join([*text[:50], text[50].rsplit(",", 3)[0], *text[51:]]))
    failed = irt("import", log, "--from", "csv", *MAP)
    assert "log.csv, line 51: 4 cells, but the header has 7" in failed.err


def test_a_rig_whose_commands_are_in_another_unit(
    tmp_path: Path, truth: Truth, irt: Callable[..., Any]
) -> None:
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "rig.toml").write_text('[recordings]\nstart = "moving"\n')
    log = write_csv(tmp_path / "log.csv", columns(truth))
    failed = irt("import", log, "--from", "csv", *MAP, "--out", tmp_path / "rig")
    assert "commands of this rig are in rad, but those of" in failed.err
    assert not list((tmp_path / "rig").glob("*.csv"))


def test_a_pickle(tmp_path: Path, irt: Callable[..., Any]) -> None:
    path = tmp_path / "log.pkl"
    path.write_bytes(pickle.dumps([1, 2]))
    for words in ([], ["--from", "csv"], ["--from", "cyberrunner"]):
        assert "a pickle is never opened" in irt("import", path, *words).err


def test_bad_bags(tmp_path: Path, truth: Truth, irt: Callable[..., Any]) -> None:
    bag = write_bag(tmp_path / "bag", truth, DECLARED, extra=("/filtered",))
    failed = irt("import", bag, "--out", tmp_path / "rig")
    assert "choose one with --topic" in failed.err
    chosen = irt("import", bag, "--out", tmp_path / "rig", "--topic", "/filtered")
    assert chosen.status == 0, chosen.err
    (file,) = bag.glob("*.db3")
    file.write_bytes(file.read_bytes()[:5000])
    assert "cut short" in irt("import", file, "--from", "cyberrunner").err
    assert "cut short" in irt("import", file).err


def test_options_of_the_other_kind_are_refused(tmp_path: Path, truth: Truth, irt: Callable[..., Any]) -> None:
    log = write_csv(tmp_path / "log.csv", columns(truth))
    assert "--knobs is not for logs of other labs" in irt("import", log, *MAP, "--knobs", "measured").err
    assert "--dry-run is not for bags" in irt("import", log, "--from", "rig", "--dry-run").err


def test_a_driver_that_goes_home(tmp_path: Path, irt: Callable[..., Any]) -> None:
    truth = simulate(np.random.default_rng(3), seconds=25.0, board=Board(0.259, 0.229), unit=300.0)
    folder = lab_logs.write_tag_folder(tmp_path / "tag", truth, DECLARED)
    for name, words in (("held", []), ("home", ["--home-after", "0.5"])):
        done = irt("import", folder, "--out", tmp_path / name, *words)
        assert done.status == 0, done.err
    held, home = (
        np.concatenate([one.knobs for one in load_rig(tmp_path / name).recordings])
        for name in ("held", "home")
    )
    assert (home == 0.0).all(axis=1).sum() > (held == 0.0).all(axis=1).sum()


def test_a_table_by_any_separator_and_name_becomes_the_same_recording(irt, tmp_path: Path) -> None:
    rows = [f"{0.05 * row:.2f},{0.01 * (row % 7):.2f},0.02,{0.001 * row:.3f},0.002" for row in range(60)]
    text = "\n".join(["t_s,knob_x_rad,knob_y_rad,marble_x,marble_y", *rows]) + "\n"
    written = {
        "commas.csv": text,
        "spreadsheet.csv": text.replace(",", ";").replace(".", ","),
        "tabs.txt": text.replace(",", "\t"),
    }
    found = []
    for name, content in written.items():
        (tmp_path / name).write_text(content)
        done = irt("import", tmp_path / name, "--from", "csv", "--out", tmp_path / f"rig-{name}")
        assert done.status == 0, done.err
        (run,) = (tmp_path / f"rig-{name}").glob("*.csv")
        found.append(run.read_text())
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("log.txt", b"t_s,marble_x\n0,1\n", "a file of no known kind: bags are *.mcap or *.db3"),
        ("log.csv.gz", b"\x1f\x8b\x08\x00", "a packed file; unpack it first"),
        ("log.xlsx", b"PK\x03\x04rest", "a packed file; unpack it first, or export a spreadsheet as CSV"),
    ],
)
def test_a_file_of_no_known_kind_is_one_line(
    irt, tmp_path: Path, name: str, content: bytes, said: str
) -> None:
    (tmp_path / name).write_bytes(content)
    done = irt("import", tmp_path / name, "--out", tmp_path / "rig")
    assert done.status == 1
    assert done.err.startswith(f"irt: {tmp_path / name}: {said}")
    assert done.err.count("\n") == 1
    assert not (tmp_path / "rig").exists()
