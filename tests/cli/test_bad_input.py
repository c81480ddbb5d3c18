"""Mistakes with a first rig give one clear line and a nonzero exit status."""

import json
import re

import numpy as np
import pytest

from irt.engine import rollouts
from simulated_rigs import NOISE, STEP_S, TRUTH, drive

HEADER = "step,knob_x_rad,knob_y_rad,marble_x,marble_y"


@pytest.fixture
def lab(tmp_path):
    """Write a rig as a user does, after a change of its columns, and return its folder."""

    def write(change=None, *, rows=120, runs=3, amplitude=0.08, ending=".csv", toml="", stamped=True):
        folder = tmp_path / "my-rig"
        folder.mkdir()
        random = np.random.default_rng(0)
        for run in range(runs):
            knobs = drive(rows, run, amplitude)
            marble = rollouts(TRUTH, knobs, time_step="continuous")[0]
            marble = marble + NOISE * random.standard_normal(marble.shape)
            if change is not None:
                knobs, marble = change(knobs, marble)
            columns = [np.arange(rows), knobs, marble, *([STEP_S * np.arange(rows)] if stamped else [])]
            header = f"{HEADER},t_s" if stamped else HEADER
            path = folder / f"run-{run}{ending}"
            np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=header, comments="")
        if toml:
            (folder / "rig.toml").write_text(toml)
        return folder

    return write


def swapped(values):
    return values[:, ::-1]


CERTAIN = {
    "swapped commands": (lambda k, m: (swapped(k), m), "swap knob_x_rad and knob_y_rad$"),
    "swapped marble": (lambda k, m: (k, swapped(m)), "swap knob_x_rad and knob_y_rad, then change the sign"),
    "mirrored x": (lambda k, m: (k, m * [-1, 1]), "change the sign of marble_x "),
    "mirrored y": (lambda k, m: (k, m * [1, -1]), "change the sign of marble_y "),
    "turned by 180 degrees": (lambda k, m: (k, -m), "change the sign of marble_x and marble_y"),
    "turned by 90 degrees": (
        lambda k, m: (k, swapped(m) * [1, -1]),
        "swap .* then change the sign of marble_x",
    ),
    "turned by -90 degrees": (
        lambda k, m: (k, swapped(m) * [-1, 1]),
        "swap .* then change the sign of marble_y",
    ),
    "degrees": (lambda k, m: (np.degrees(k), m), "they are degrees: multiply the knobs by pi/180"),
    "origin in the corner": (lambda k, m: (k, m + np.array([0.5, 0.4185])), "the origin looks like a corner"),
    "pixels": (lambda k, m: (k, 1000 * m + [640, 360]), "in the same unit .pixels or millimetres"),
    "millimetres": (lambda k, m: (k, 276 * m), "subtract the centre, then divide"),
    "a still marble": (lambda k, m: (k, np.full_like(m, 0.1)), "the marble never moves"),
    "a still marble, with noise": (
        lambda k, m: (k, 0.002 * np.random.default_rng(1).standard_normal(m.shape)),
        "the marble never moves",
    ),
    "a still marble that flickers": (
        lambda k, m: (k, 0.1 + 0.0025 * (np.random.default_rng(2).random(m.shape) < 0.02)),
        "the marble never moves",
    ),
}


@pytest.mark.parametrize("verb", ["tune", "diagnose"])
@pytest.mark.parametrize("what", CERTAIN)
def test_what_is_certainly_wrong_is_refused(irt, lab, tmp_path, what, verb):
    change, words = CERTAIN[what]
    rig = lab(change)
    done = irt(verb, rig, "--out", tmp_path / "out")
    assert done.status == 1
    (line,) = done.err.splitlines()
    assert re.search(words, line), line
    assert not (tmp_path / "out").exists()


METRES = {
    "from the centre": (np.zeros(2), "along y, and meets walls that stand there in metres; divide the pos"),
    "from a corner": (
        np.array([0.138, 0.1155]),
        "subtract 0.138 from marble_x and 0.1155 from marble_y, then divide the positions by the long edge",
    ),
}


@pytest.mark.parametrize("origin", METRES)
def test_metres_are_refused_where_walls_show_them(irt, lab, origin):
    centre, words = METRES[origin]
    done = irt("check", lab(lambda k, m: (k, 0.276 * m + centre), amplitude=0.14))
    assert done.status == 1
    (line,) = done.err.splitlines()
    assert words in line


def test_metres_without_a_wall_are_warned_of(irt, lab):
    done = irt("check", lab(lambda k, m: (k, 0.276 * m), amplitude=0.055))
    assert (done.status, done.err) == (0, "")
    words = "divide the positions by the long edge, 0.276 m, if they are metres"
    assert words in " ".join(done.out.split())


def test_board_edges_that_meet_walls_are_not_taken_for_metres(irt, lab):
    assert "metres" not in irt("check", lab(amplitude=0.14)).out


@pytest.mark.slow
def test_a_few_rows_with_wrong_axes_are_tuned_with_a_warning_on_top(irt, lab, tmp_path):
    rig = lab(lambda k, m: (k, -m), rows=100, runs=1)
    done = irt("tune", rig, "--starts", "1", "--out", tmp_path / "out")
    assert done.status == 0
    assert done.out.startswith("warning: axes: knob_x_rad and knob_y_rad move marble_x and marble_y against")


def test_a_check_says_it_and_exits_as_the_others(irt, lab):
    done = irt("check", lab(lambda k, m: (k, -m)))
    assert done.status == 1
    assert "errors\n- axes: knob_x_rad and knob_y_rad move" in done.out
    assert "change the sign of marble_x and marble_y" in done.err


@pytest.mark.parametrize("rows", [2, 3])
def test_a_few_rows_are_one_clear_line(irt, lab, tmp_path, rows):
    for verb in ("tune", "diagnose", "check"):
        rig = tmp_path / "my-rig" if (tmp_path / "my-rig").exists() else lab(rows=rows)
        done = irt(verb, rig, *(["--out", tmp_path / "out"] if verb != "check" else []))
        assert done.status == 1
        assert (
            f"the marble is seen in {3 * rows} rows of all runs together, at least 12 are needed" in done.err
        )


def test_many_runs_of_a_few_rows_are_one_clear_line_too(irt, lab, tmp_path):
    done = irt("tune", lab(rows=3, runs=6), "--out", tmp_path / "out")
    assert done.status == 1
    assert "no run has 8 rows with the marble" in done.err


@pytest.mark.slow
def test_endings_may_be_upper_case(irt, lab, tmp_path):
    done = irt("tune", lab(ending=".CSV"), "--starts", "1", "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("[board]\nedge_x_m = 'wide'", '[board], edge_x_m: expected a number, found "wide"'),
        ("[board]\nedge_x_m = -1.0", "[board]: edge_x_m: expected a number from 1e-09 to 10 m, found -1"),
        ("[marble]\nradius_m = true", "[marble], radius_m: expected a number, found True"),
        ("[tilt]\nnoise_rad = 'low'", '[tilt], noise_rad: expected a number, found "low"'),
        (
            "[parameters]\ngear_x = { range = [1, 0] }",
            "[parameters]: gear_x: the range [1.0, 0.0] is upside down",
        ),
        ("[recordings]\nstart = 'resting'", '[recordings], start: unknown start "resting"'),
    ],
)
def test_a_slip_in_rig_toml_names_its_place_once(irt, lab, toml, message):
    done = irt("check", lab(toml=toml))
    assert done.status == 1
    assert message in done.err
    assert done.err.count("rig.toml") == 1


@pytest.mark.parametrize(
    "line",
    [
        "[board]\nedge_x_m = 'wide'",
        "[recordings]\nstart = 'resting'",
        "[parameters]\ngear_x = { value = 'a' }",
    ],
)
def test_a_slip_in_model_toml_names_the_file_once(irt, lab, tmp_path, line):
    model = tmp_path / "model.toml"
    model.write_text(line)
    done = irt("evaluate", model, lab(), "--out", tmp_path / "out")
    assert done.status == 1
    assert done.err.count("model.toml") == 1


@pytest.mark.slow
def test_what_is_replaced_is_said(irt, lab, tmp_path):
    rig, out = lab(), tmp_path / "out"
    words = ("tune", rig, "--starts", "1", "--out", out)
    assert "this replaces" not in irt(*words).out
    assert (
        f"note: this replaces {out / 'model.toml'}, {out / 'fit.json'}, {out / 'report.html'}"
        in irt(*words).out
    )
    commands = (
        "simulate",
        out / "model.toml",
        "--commands",
        rig / "run-0.csv",
        "--out",
        tmp_path / "predicted.csv",
    )
    assert irt(*commands).out == ""
    assert irt(*commands).out == f"note: this replaces {tmp_path / 'predicted.csv'}\n"
    evaluated = ("evaluate", out / "model.toml", rig, "--out", tmp_path / "errors")
    assert "this replaces" not in irt(*evaluated).out
    assert f"note: this replaces {tmp_path / 'errors' / 'evaluation.json'}" in irt(*evaluated).out


@pytest.mark.slow
def test_a_long_log_is_cut_and_said(irt, lab, tmp_path, monkeypatch):
    monkeypatch.setattr("irt.rig.MOST_ROWS", 200)
    rig = lab()
    done = irt("tune", rig, "--starts", "1", "--out", tmp_path / "out")
    assert done.status == 0
    first = done.out.splitlines()[0]
    assert first.startswith(f"note: {rig}: 360 rows would take 1.8 times as long as the 200 that a fit needs")
    assert "the first 66 of each run are used" in first
    assert first.removeprefix("note: ") in json.loads((tmp_path / "out" / "fit.json").read_text())["warnings"]
    done = irt("check", rig, "--json")
    assert {run["rows"] for run in json.loads(done.out)["runs"]} == {66}


SECONDS = re.compile(r"\d[\d.]* ?(s|ms)\b|seconds|/s")


@pytest.mark.slow
def test_without_stamps_nothing_is_in_seconds(irt, lab, tmp_path):
    rig = lab(stamped=False)
    tuned = irt(
        "tune",
        rig,
        "--starts",
        "1",
        "--effect",
        "delay",
        "--effect",
        "viscous_drag",
        "--out",
        tmp_path / "out",
    )
    assert "time scale unknown" in tuned.out
    assert re.search(r"  delay  +-?[\d.e-]+ rows\n", tuned.out)
    assert re.search(r"  rate_per_row  +[\d.e-]+ 1/row\n", tuned.out)
    assert re.search(r"windows of \d+ rows  ", tuned.out)
    assert json.loads((tmp_path / "out" / "fit.json").read_text())["time_base"] == "unknown: no stamps"
    evaluated = irt("evaluate", tmp_path / "out" / "model.toml", rig, "--out", tmp_path / "errors")
    assert "time scale unknown" in evaluated.out
    shown = json.loads((tmp_path / "errors" / "evaluation.json").read_text())
    assert shown["window_s"] is None
    assert f"windows of {shown['window_rows']} rows" in evaluated.out
    checked = irt("check", rig)
    assert "time scale unknown" in checked.out
    for out in (tuned.out, evaluated.out, checked.out):
        shown = out.replace("updates of 1/240 s per timestep", "")
        assert SECONDS.search(shown) is None, shown


@pytest.mark.slow
def test_with_stamps_seconds_are_given(irt, lab, tmp_path):
    rig = lab()
    tuned = irt("tune", rig, "--starts", "1", "--effect", "delay", "--out", tmp_path / "out")
    assert "windows of 2 s  " in tuned.out
    assert re.search(r"  delay_s  .* s\n", tuned.out)
    assert "time scale unknown" not in tuned.out
    assert json.loads((tmp_path / "out" / "fit.json").read_text())["time_base"] == "stamps"


def test_rows_that_show_a_delay_do_not_depend_on_the_range_of_the_time_scale(irt, lab):
    rig = lab(stamped=False)
    sizes = []
    for ends in ([1.0, 39.0], [1.0, 9.0]):
        (rig / "rig.toml").write_text(f"[parameters]\ntime_scale = {{ range = {ends} }}\n")
        shown = json.loads(irt("check", rig, "--json").out)["identified"]["effects"]
        (delay,) = [one for one in shown if one["effect"] == "delay"]
        assert delay["unit"] == "rows"
        sizes.append(delay["smallest"])
        assert not [one for one in shown if one["effect"] == "tilt_bias"]
    # Windows of other lengths differ by less than the fourfold time of a row.
    assert 0.5 < sizes[0] / sizes[1] < 2.0
