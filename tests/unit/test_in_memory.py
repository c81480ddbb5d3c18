"""Recordings and rigs of arrays and data frames: no files needed, and everything works with them."""

from pathlib import Path

import numpy as np
import pytest

import irt
from irt.model import Model
from irt.recording import KNOBS, MARBLE, STAMP, TILT
from simulated_rigs import STEP_S, TRUTH, drive

try:
    import pandas
except ImportError:
    pandas = None


class Frame:
    """Stands in for a data frame: ``columns``, and columns by their names."""

    def __init__(self, columns):
        self._columns = columns
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]


def columns(rows=60, seed=1):
    knobs = drive(rows, seed)
    marble = irt.rollouts(TRUTH, knobs, time_step="continuous")[0]
    return {
        KNOBS[0]: knobs[:, 0],
        KNOBS[1]: knobs[:, 1],
        MARBLE[0]: marble[:, 0],
        MARBLE[1]: marble[:, 1],
        STAMP: STEP_S * np.arange(rows),
    }


def arrays(table):
    return {
        "commands": np.stack([table[name] for name in KNOBS], axis=1),
        "marble": np.stack([table[name] for name in MARBLE], axis=1),
        "t": table[STAMP],
    }


def as_frame(table):
    return Frame(table) if pandas is None else pandas.DataFrame(table)


def structured(table):
    found = np.zeros(len(table[STAMP]), dtype=[(name, float) for name in table])
    for name, values in table.items():
        found[name] = values
    return found


@pytest.mark.parametrize("wrap", [dict, Frame, as_frame, structured])
def test_a_table_is_the_same_recording_as_its_arrays(wrap):
    table = columns()
    (found,) = irt.Rig.from_recordings([wrap(table)]).recordings
    expected = irt.Recording.from_arrays(**arrays(table))
    for name in ("knobs", "marble", "stamps"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_cells_that_are_unknown_are_a_lost_marble():
    table = columns()
    x, y = table[MARBLE[0]].astype(object), table[MARBLE[1]].astype(object)
    x[5], y[5] = None, float("nan")
    (found,) = irt.Rig.from_recordings([Frame({**table, MARBLE[0]: x, MARBLE[1]: y})]).recordings
    assert np.flatnonzero(~found.seen).tolist() == [5]


def test_a_table_may_be_of_text_and_have_a_step_and_a_tilt():
    table = {name: [repr(float(one)) for one in values] for name, values in columns().items()}
    rows = len(table[STAMP])
    table |= {
        "step": range(rows),
        TILT[0]: np.full(rows, 0.01),
        TILT[1]: np.zeros(rows),
        "note": ["a"] * rows,
    }
    (found,) = irt.Rig.from_recordings([table]).recordings
    np.testing.assert_array_equal(found.knobs, irt.Recording.from_arrays(**arrays(columns())).knobs)
    assert found.has_tilt


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({MARBLE[0]: ["here"] * 60}, 'run, row 0, column marble_x: expected a number, found "here"'),
        ({MARBLE[0]: np.zeros(59)}, "columns must have the same number of rows"),
        ({"step": np.arange(60)[::-1]}, "run, row 0, column step: expected 0, found 59"),
        ({"step": np.zeros(60)}, "which row 0 has already"),
        ({KNOBS[0]: np.full(60, np.nan)}, "run, row 0, column knob_x_rad: expected a knob angle"),
        ({MARBLE[0]: np.full(60, 80.0)}, "in units of its long edge"),
    ],
)
def test_what_is_wrong_in_a_table_is_named_with_its_place(change, message):
    with pytest.raises(irt.IrtError, match=message):
        irt.Rig.from_recordings([{**columns(), **change}])


def test_a_missing_column_is_named():
    table = columns()
    del table[MARBLE[1]]
    with pytest.raises(
        irt.IrtError, match=r"run: column marble_y is missing; rename .*; the header has knob_x_rad"
    ):
        irt.Rig.from_recordings([table])


def test_a_tilt_in_degrees_is_refused_as_in_a_file():
    with pytest.raises(irt.IrtError, match="divide degrees by"):
        irt.Recording.from_arrays(commands=np.eye(3, 2), tilt=np.full((3, 2), 5.0))


def test_dates_are_no_seconds():
    dates = np.arange(3).astype("datetime64[s]")
    with pytest.raises(irt.IrtError, match="dates or durations: give seconds"):
        irt.Recording.from_arrays(commands=np.eye(3, 2), marble=np.zeros((3, 2)), t=dates)


def test_a_tilt_alone_needs_no_marble():
    found = irt.Recording.from_arrays(commands=np.eye(3, 2), tilt=np.full((3, 2), 0.01))
    assert not found.has_marble


def test_recordings_with_one_name_get_numbers():
    runs = [irt.Recording.from_arrays(**arrays(columns(seed=seed))) for seed in range(3)]
    assert [one.name for one in irt.Rig.from_recordings(runs).recordings] == ["run-1", "run-2", "run-3"]


def test_what_a_rig_in_memory_does_not_say_is_the_paper_s():
    rig = irt.Rig.from_recordings([columns()], ranges={"time_scale": (10.0, 30.0)}, name="mine")
    assert (rig.board, rig.marble, rig.start, f"{rig.path}") == (irt.Board(), irt.Marble(), "rest", "mine")
    assert (rig.ranges["gear_x"], rig.ranges["time_scale"]) == ((0.0, 0.1), (10.0, 30.0))


def test_commands_of_their_own_unit_need_its_name():
    run = irt.Recording.from_arrays(**arrays(columns()), columns=("cmd_x", "cmd_y"))
    with pytest.raises(irt.IrtError, match="name it"):
        irt.Rig.from_recordings([run])
    assert irt.Rig.from_recordings([run], commands=irt.Commands("mA")).commands.unit == "mA"


def test_a_rig_in_memory_is_checked_tuned_and_evaluated():
    rig = irt.Rig.from_recordings([columns(90, seed) for seed in range(3)])
    assert not [one for one in irt.check(rig).findings if one.severity == "error"]
    fit = irt.tune(rig, starts=2)
    # A larger gear in a smaller picture is the same path, away from the rim.
    seen = fit.model.values[0] * fit.model.values[4]
    assert seen == pytest.approx(TRUTH[0, 0] * TRUTH[0, 4], rel=0.01)
    by_rig = irt.evaluate(fit.model, rig)
    assert by_rig.mae < 1e-3
    assert irt.evaluate(fit.model, rig.recordings).as_dict() == by_rig.as_dict()
    assert irt.evaluate(fit.model, [columns(90, seed) for seed in range(3)]).mae == by_rig.mae


def test_effects_of_a_tune_may_be_named():
    rig = irt.Rig.from_recordings([columns(90, 0)])
    named = irt.tune(rig, starts=1, effects=["delay"])
    spelt = irt.tune(rig, starts=1, effects=[irt.Effect("delay", {})])
    assert named.model == spelt.model


def test_a_file_stands_for_its_model_and_a_folder_for_its_rig(tmp_path):
    rig = irt.Rig.from_recordings([columns()])
    model = Model.from_rig(rig, TRUTH[0])
    irt.save_model(tmp_path / "model.toml", model)
    run = rig.recordings[0]
    irt.save_recording(tmp_path / "run.csv", run.knobs, run.marble, run.stamps)
    by_path = irt.evaluate(f"{tmp_path / 'model.toml'}", tmp_path)
    assert by_path.as_dict()["overall"] == irt.evaluate(model, rig).as_dict()["overall"]


def test_a_recording_keeps_its_path(tmp_path):
    assert irt.Recording.from_arrays(commands=np.eye(3, 2), marble=np.zeros((3, 2))).path == Path("run")


def test_tune_refuses_axes_that_are_certainly_wrong():
    mirrored = [{**columns(120, seed), MARBLE[0]: -columns(120, seed)[MARBLE[0]]} for seed in range(3)]
    with pytest.raises(irt.IrtError, match="change the sign of marble_x"):
        irt.tune(irt.Rig.from_recordings(mirrored), starts=1)


def small_in_metres(rows=60):
    """Return a rig whose marble stays near the centre, with positions in metres."""
    runs = []
    for seed in range(3):
        knobs = drive(rows, seed, 0.07)
        marble = 0.276 * irt.rollouts(TRUTH, knobs, time_step="continuous")[0]
        runs.append(irt.Recording.from_arrays(commands=knobs, marble=marble, t=STEP_S * np.arange(rows)))
    return irt.Rig.from_recordings(runs)


@pytest.mark.slow
@pytest.mark.parametrize("function", [irt.tune, irt.diagnose])
def test_results_carry_the_warnings_of_a_check(function):
    rig = small_in_metres()
    found = function(rig)
    assert found.warnings == irt.check(rig).warnings
    (warning,) = found.warnings
    assert "if they are metres" in warning
    assert f"Warning: {warning}" in found._repr_html_()


@pytest.mark.parametrize("function", [irt.tune, irt.diagnose])
def test_a_still_marble_is_refused(function):
    still = irt.Recording.from_arrays(commands=drive(60, 1), marble=np.full((60, 2), 0.1))
    with pytest.raises(irt.IrtError, match="the marble never moves"):
        function(irt.Rig.from_recordings([still]))
