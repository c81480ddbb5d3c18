"""For anything passed to the package's functions, an `IrtError` of one line says what was expected."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import irt
from irt.model import Model
from simulated_rigs import STEP_S, TRUTH, drive

ROWS = 24


def runs():
    knobs = drive(ROWS, 0)
    marble = irt.rollouts(TRUTH, knobs)[0]
    return [irt.Recording.from_arrays(commands=knobs, marble=marble, t=STEP_S * np.arange(ROWS))]


RIG = irt.Rig.from_recordings(runs())
MODEL = Model.from_rig(RIG, TRUTH[0])

#: For each function: arguments that are right, but for which any other type is wrong.
ENTRIES = {
    "check": (irt.check, {"rig": RIG, "threads": 1}),
    "diagnose": (irt.diagnose, {"rig": RIG, "seed": 0, "threads": 1, "progress": None}),
    "evaluate": (irt.evaluate, {"model": MODEL, "recordings": RIG, "window_s": 0.5}),
    "load_model": (irt.load_model, {"path": "model.toml"}),
    "load_recording": (irt.load_recording, {"path": "run.csv"}),
    "load_rig": (irt.load_rig, {"folder": "rig"}),
    "paper_drive": (irt.paper_drive, {"steps": 10, "amplitude": 0.1, "literal": False}),
    "predict": (
        MODEL.predict,
        {"commands": drive(9, 1), "start": [0.0, 0.0], "seed": 0, "threads": 1},
    ),
    "rollouts": (
        irt.rollouts,
        {
            "parameters": TRUTH,
            "commands": drive(9, 1),
            "rig": RIG,
            "effects": [{"name": "delay", "delay_s": 0.1}],
            "engine": "rolling",
            "start": [0.0, 0.0],
            "seed": 0,
            "threads": 1,
            "time_step": "rounded",
            "hold": "zero",
            "tilt": False,
            "substeps": None,
            "durations": None,
            "knobs_before": None,
        },
    ),
    "save_model": (irt.save_model, {"path": "model.toml", "model": MODEL}),
    "save_recording": (
        irt.save_recording,
        {"path": "run.csv", "knobs": drive(9, 1), "marble": np.zeros((9, 2))},
    ),
    "suggest": (irt.suggest, {"rig": RIG, "models": [MODEL], "noise": 0.001, "seed": 0, "threads": 1}),
    "tune": (
        irt.tune,
        {
            "rig": RIG,
            "method": "least-squares",
            "starts": 1,
            "effects": [],
            "seed": 0,
            "engine": "rolling",
            "threads": 1,
            "progress": None,
            "network": None,
        },
    ),
    "to_json": (irt.to_json, {"model": MODEL}),
    "to_mjcf": (irt.to_mjcf, {"model": MODEL}),
    "of_layout": (irt.Maze.of_layout, {"name": "bare"}),
    "sample": (MODEL.sample, {"n": 1, "seed": 0}),
    "pool": (irt.pool, {"rigs": [RIG, RIG]}),
    "track": (
        irt.track,
        {
            "video": "none.mp4",
            "out": None,
            "commands": None,
            "offset": None,
            "rig": None,
            "lens": None,
            "corners": None,
            "marble": (),
            "colour": None,
            "fps": None,
            "seconds": None,
            "progress": None,
        },
    ),
    "write_tuning_report": (
        irt.write_tuning_report,
        {"folder": "page", "rig": RIG, "results": [], "title": "A page", "settings": {}, "warnings": ()},
    ),
    "write_diagnosis_report": (
        irt.write_diagnosis_report,
        {"folder": "page", "rig": RIG, "diagnosis": None, "warnings": ()},
    ),
    "from_arrays": (
        irt.Recording.from_arrays,
        {"commands": drive(9, 1), "marble": np.zeros((9, 2)), "t": np.arange(9.0), "tilt": None, "name": "a"},
    ),
    "from_recordings": (
        irt.Rig.from_recordings,
        {
            "recordings": runs(),
            "board": irt.Board(),
            "marble": irt.Marble(),
            "start": "rest",
            "ranges": {},
            "commands": irt.Commands(),
            "tilt": irt.TiltSensor(),
            "name": "rig",
        },
    ),
    "Rig": (
        irt.Rig,
        {
            name: getattr(RIG, name)
            for name in ("path", "board", "marble", "start", "ranges", "recordings", "commands", "tilt")
        },
    ),
    "Model": (
        Model,
        {
            name: getattr(MODEL, name)
            for name in ("board", "marble", "start", "ranges", "parameters", "effects", "time_step")
        },
    ),
    "Board": (irt.Board, {"edge_x_m": 0.276, "wall_friction": 0.1}),
    "Marble": (irt.Marble, {"radius_m": 0.007}),
    "Effect": (irt.Effect, {"name": "delay", "parameters": {"delay_s": 0.1}}),
    "Parameter": (irt.Parameter, {"value": 1.0, "low": 0.5, "high": 2.0}),
}


class Nonsense:
    """An object of no use."""


#: Values of many types. What is right for one argument is wrong for most of the others.
VALUES = (
    Nonsense(),
    Nonsense,
    b"bytes",
    3 + 4j,
    {"a": 1},
    {1, 2},
    [[1.0], [2.0, 3.0]],
    ["a", "b"],
    [RIG],
    [MODEL],
    RIG.ranges,
    np.array([object()]),
    np.array(["a"]),
    np.zeros((3, 3, 3, 3)),
    np.zeros((2, 2)),
    np.zeros(0),
    np.datetime64("2020-01-01"),
    10**30,
    -(10**30),
    10**400,
    -1,
    1.5,
    float("nan"),
    float("inf"),
    True,
    None,
    Path("no-such-place"),
    "no-such-place",
    "",
    "a\0b",
    [],
    {},
    [1, 2, 3],
    (None, None),
    lambda: None,
    RIG,
    MODEL,
    runs(),
    runs()[0],
)


def tried(name, argument, value):
    """Call a function with one argument replaced. That may be right; other errors fail the test."""
    function, right = ENTRIES[name]
    with suppress(irt.IrtError):
        function(**{**right, argument: value})


@pytest.mark.parametrize("name", sorted(ENTRIES))
def test_wrong_types_raise_one_error(empty_folder, name):
    for argument in ENTRIES[name][1]:
        for value in VALUES:
            tried(name, argument, value)


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_wrong_values_raise_one_error(empty_folder, data):
    name = data.draw(st.sampled_from(sorted(ENTRIES)), label="function")
    argument = data.draw(st.sampled_from(sorted(ENTRIES[name][1])), label="argument")
    value = data.draw(
        st.one_of(
            st.integers(-5, 40),
            st.text(max_size=5),
            st.floats(),
            st.lists(st.floats(), max_size=3),
            st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
        ),
        label="value",
    )
    tried(name, argument, value)


@pytest.fixture(scope="module")
def empty_folder(tmp_path_factory):
    """Work in an empty folder, and let no search begin: what is tested comes before it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("empty"))
        for module, called in (
            ("irt.diagnosis.run", "Scores"),
            ("irt.suggestion", "Search"),
            ("irt.fitting.least_squares", "_fit_at_once"),
        ):
            patch.setattr(f"{module}.{called}", _stop)
        yield


def _stop(*_args, **_options):
    raise irt.IrtError("the search would begin here")


@pytest.mark.parametrize("name", sorted(ENTRIES))
def test_unknown_options_are_named(name):
    function, right = ENTRIES[name]
    if isinstance(function, type) or name.startswith(("load", "save")):
        pytest.skip("a class or a function without options")
    with pytest.raises(irt.IrtError, match=r'unknown option of .* "startz"'):
        function(**right, startz=3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: irt.evaluate(MODEL, "folder"), "folder: no such folder"),
        (lambda: irt.evaluate("none.toml", RIG), "none.toml: no such file"),
        (lambda: irt.tune(runs()), r"rig: expected irt.Rig or the path of its folder, got .*from_recordings"),
        (lambda: irt.tune(RIG, startz=3), 'unknown option of tune "startz"; did you mean "starts"?'),
        (lambda: irt.tune(RIG, iterations=3), "iterations belongs to method irt; leave it out"),
        (lambda: irt.tune(RIG, "irt", rollouts=3), "rollouts belongs to method irt\\+ or cma-es or es"),
        (lambda: irt.tune(RIG, "simplex"), 'unknown method "simplex"'),
        (lambda: irt.tune(RIG, starts="many"), "starts: expected a whole number of at least 1, got 'many'"),
        (lambda: irt.tune(RIG, effects="delay"), "effects: expected a sequence"),
        (lambda: irt.tune(RIG, effects=["delai"]), 'unknown effect "delai"; did you mean "delay"?'),
        (lambda: irt.Rig(**{**ENTRIES["Rig"][1], "ranges": {}}), "ranges: gear_x, gear_y"),
        (lambda: irt.check(None), "rig: expected irt.Rig or the path of its folder, got None"),
        (lambda: irt.Board(edge_x_m="wide"), "edge_x_m: expected a number, got 'wide'"),
        (irt.tune, "tune: missing a required argument: 'rig'"),
    ],
)
def test_slips_get_a_line_that_helps(call, message):
    with pytest.raises(irt.IrtError, match=message):
        call()
