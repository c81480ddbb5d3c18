from __future__ import annotations

import dataclasses
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.catalogue import effect, effects
from irt.errors import IrtError
from irt.model import Effect, Model, Parameter, load_model, save_model
from irt.rig import PARAMETERS, RANGES, Board, Commands, Marble, TiltSensor, load_rig

VALUES = (0.05, 0.06, 0.0005, 25.0, 1.0)
GOOD = """
format = 1
[parameters]
gear_x = { value = 0.07, low = 0.069, high = 0.071, range = [0.0, 0.2] }
gear_y = 0.06
rolling_friction = { value = 0.0005 }
time_scale = 25
observation_scale = 1.0
"""


def model(**changes) -> Model:
    plain = Model(
        board=Board(),
        marble=Marble(),
        start="rest",
        ranges=dict(RANGES),
        parameters={name: Parameter(value) for name, value in zip(PARAMETERS, VALUES, strict=True)},
    )
    return dataclasses.replace(plain, **changes)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "model.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("tilt", [TiltSensor(0.0017, (-0.1, 0.02)), TiltSensor(None, (-0.02, 0.02))])
def test_sections_of_signals_come_back(tmp_path: Path, tilt: TiltSensor) -> None:
    signals = model(commands=Commands('m"A', True), tilt=tilt)
    save_model(tmp_path / "model.toml", signals)
    assert load_model(tmp_path / "model.toml") == signals


def test_reads_what_a_person_wrote(tmp_path: Path) -> None:
    read = load_model(write(tmp_path, GOOD))
    assert read.parameters["gear_x"] == Parameter(0.07, 0.069, 0.071)
    np.testing.assert_array_equal(read.values, [0.07, 0.06, 0.0005, 25.0, 1.0])
    assert read.ranges == RANGES | {"gear_x": (0.0, 0.2)}
    assert (read.board, read.marble, read.start) == (Board(), Marble(), "rest")
    assert read.effects == ()
    assert read.time_step == "rounded"


def test_reads_all_that_a_model_holds(tmp_path: Path) -> None:
    text = GOOD + (
        "[board]\nedge_x_m = 0.4\n[marble]\nradius_m = 0.02\n[recordings]\nstart = 'moving'\n"
        "[simulation]\ntime_step = 'continuous'\n"
        "[[effects]]\nname = 'backlash'\nwidth_x_rad = 0.03\nwidth_y_rad = 0\n"
        "[[effects]]\nname = 'delay'\ndelay_s = 0.1\n"
    )
    read = load_model(write(tmp_path, text))
    assert read.board.edge_x_m == 0.4
    assert read.marble.radius_m == 0.02
    assert read.start == "moving"
    assert read.time_step == "continuous"
    assert read.effects == (
        Effect("backlash", {"width_x_rad": 0.03, "width_y_rad": 0.0}),
        Effect("delay", {"delay_s": 0.1}),
    )


def test_a_folder_of_results_stands_for_its_model(tmp_path: Path) -> None:
    assert load_model(write(tmp_path, GOOD).parent) == load_model(tmp_path / "model.toml")
    (tmp_path / "empty").mkdir()
    with pytest.raises(IrtError, match=r"empty: is a folder, where a file was expected; give a model\.toml"):
        load_model(tmp_path / "empty")


def test_parameters_in_any_order(tmp_path: Path) -> None:
    head, *lines = GOOD.strip().split("\n")[1:]
    read = load_model(write(tmp_path, "\n".join([head, *reversed(lines)])))
    assert tuple(read.parameters) == PARAMETERS
    np.testing.assert_array_equal(read.values, [0.07, 0.06, 0.0005, 25.0, 1.0])


BAD = {
    "empty": ("", r"model\.toml: the file is empty"),
    "broken": ("[parameters\n", "broken TOML"),
    "newer": (
        GOOD.replace("format = 1", "format = 2\n[unheard_of]"),
        r"model\.toml, format: 2 is a newer format than this release reads \(1\): update irt",
    ),
    "no format": (
        GOOD.replace("format = 1", "format = 'x'"),
        "format: expected a number from 1 to 1, found x",
    ),
    "unknown section": (GOOD + "[effect]\n", 'unknown section "effect"; did you mean "effects"?'),
    "unknown parameter": (
        GOOD + "gear_z = 1\n",
        r'\[parameters\]: unknown parameter "gear_z"; did you mean "gear_[xy]"\?',
    ),
    "missing": (
        GOOD.replace("gear_y = 0.06", ""),
        r"model\.toml: gear_y is missing; a model needs all of gear_x",
    ),
    "no value": (GOOD.replace("value = 0.07, ", ""), r"\[parameters\], gear_x: value is missing"),
    "text": (
        GOOD.replace("gear_y = 0.06", "gear_y = 'big'"),
        r'\[parameters\], gear_y: expected a number, found "big"',
    ),
    "nan": (GOOD.replace("gear_y = 0.06", "gear_y = nan"), "gear_y: expected a finite number, found nan"),
    "impossible": (
        GOOD.replace("gear_y = 0.06", "gear_y = 1e9"),
        r"\[parameters\]: gear_y: expected a number from -100 to 100, found 1e\+09",
    ),
    "one end": (GOOD.replace("low = 0.069, ", ""), "gear_x: an interval needs both low and high"),
    "interval": (
        GOOD.replace("low = 0.069", "low = 0.08"),
        "gear_x: the interval from 0.08 to 0.071 is upside down",
    ),
    "end nan": (GOOD.replace("low = 0.069", "low = nan"), "gear_x, low: expected a finite number, found nan"),
    "range": (GOOD.replace("[0.0, 0.2]", "[0.2, 0.0]"), r"gear_x: the range \[0\.2, 0\.0\] is upside down"),
    "time step": (
        GOOD + "[simulation]\ntime_step = 'round'\n",
        'unknown time_step "round"; did you mean "rounded"?',
    ),
    "key": (GOOD + "[simulation]\nstep = 1\n", r'\[simulation\]: unknown key "step"'),
    "effect": (
        GOOD + "[[effects]]\nname = 'delay'\ndelay_s = 1\n[[effects]]\nname = 'backlsh'\n",
        r'\[\[effects\]\] 2: unknown effect "backlsh"; did you mean "backlash"\? possible: delay, ',
    ),
    "effect's parameter": (
        GOOD + "[[effects]]\nname = 'delay'\ndelay = 1\n",
        r'\[\[effects\]\] 1: unknown parameter of delay "delay"; did you mean "delay_s"\?',
    ),
    "no name": (GOOD + "[[effects]]\ndelay_s = 1\n", r"\[\[effects\]\] 1: name is missing"),
    "effect's text": (
        GOOD + "[[effects]]\nname = 'delay'\ndelay_s = 'x'\n",
        'delay_s: expected a number, found "x"',
    ),
    "effect's value": (
        GOOD + "[[effects]]\nname = 'delay'\ndelay_s = -1\n",
        r"\[\[effects\]\] 1, delay_s: expected a number from 0 to 60, found -1",
    ),
    "effects": (
        GOOD.replace("format = 1", "format = 1\neffects = 3"),
        r"effects: expected sections \[\[effects\]\]",
    ),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_bad_model(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(IrtError, match=message):
        load_model(write(tmp_path, text))


def test_a_marble_larger_than_the_board() -> None:
    with pytest.raises(IrtError, match=r"radius_m: a marble of 0\.2 m does not fit between the walls"):
        model(marble=Marble(radius_m=0.2))


def test_from_rig(write_rig) -> None:
    arrays = (np.zeros((3, 2)), np.zeros((3, 2)))
    toml = (
        "[board]\nedge_x_m = 0.3\n[recordings]\nstart = 'moving'\n[parameters]\ngear_x = { range = [0, 1] }\n"
    )
    rig = load_rig(write_rig({"run": arrays}, toml))
    intervals = np.outer(VALUES, [0.9, 1.1])
    built = Model.from_rig(rig, np.array(VALUES), intervals=intervals, time_step="continuous")
    assert built.board.edge_x_m == 0.3
    assert built.start == "moving"
    assert built.ranges["gear_x"] == (0.0, 1.0)
    assert built.parameters["gear_y"] == Parameter(0.06, *intervals[1])
    assert built.time_step == "continuous"
    np.testing.assert_array_equal(built.values, VALUES)
    by_name = Model.from_rig(rig, dict(zip(reversed(PARAMETERS), reversed(VALUES), strict=True)))
    np.testing.assert_array_equal(by_name.values, VALUES)


@pytest.mark.parametrize(
    ("values", "intervals", "message"),
    [
        (VALUES[:4], None, r"values must have shape \(5,\), not \(4,\)"),
        (["a"] * 5, None, "values must be an array of numbers"),
        ({"gear_x": 1.0}, None, "gear_y is missing"),
        ({**dict(zip(PARAMETERS, VALUES, strict=True)), "gear": 1.0}, None, 'unknown parameter "gear"'),
        (VALUES, np.zeros((2, 5)), r"intervals must have shape \(5, 2\), not \(2, 5\)"),
        ((float("nan"), *VALUES[1:]), None, "gear_x: expected a number from"),
    ],
)
def test_from_rig_with_bad_values(write_rig, values, intervals, message: str) -> None:
    rig = load_rig(write_rig({"run": (np.zeros((3, 2)), np.zeros((3, 2)))}))
    with pytest.raises(IrtError, match=message):
        Model.from_rig(rig, values, intervals=intervals)


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("two words", {}, '"two words" is no name'),
        ("delay", {'x" = 1': 1.0}, "is no name"),
        ("delay", {"delay_s": float("inf")}, "delay, delay_s: expected a finite number, found inf"),
    ],
)
def test_bad_effect(name: str, parameters: dict[str, float], message: str) -> None:
    with pytest.raises(IrtError, match=message):
        Effect(name, parameters)


def within(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


BOUNDS = [(-100, 100), (-100, 100), (0, 100), (0, 5000), (0.01, 100)]
ENDS = st.floats(allow_nan=False)  # of an interval that the recordings may leave open


@st.composite
def parameter(draw: st.DrawFn, low: float, high: float) -> tuple[Parameter, tuple[float, float]]:
    interval = draw(st.none() | st.tuples(ENDS, ENDS).map(sorted))
    ends = draw(st.tuples(within(low, high), within(low, high)).filter(lambda pair: pair[0] != pair[1]))
    return Parameter(draw(within(low, high)), *(interval or ())), (min(ends), max(ends))


@st.composite
def models(draw: st.DrawFn) -> Model:
    drawn = [draw(parameter(*bounds)) for bounds in BOUNDS]
    infos = draw(st.lists(st.sampled_from([*effects(), effect("unlisted")]), max_size=2))
    return Model(
        board=Board(draw(within(0.1, 10)), draw(within(0.1, 10)), draw(within(0, 1)), draw(within(0, 1000))),
        marble=Marble(draw(within(1e-9, 0.04)), draw(within(1e-9, 1000)), draw(within(0, 1000))),
        start=draw(st.sampled_from(["rest", "moving"])),
        ranges={name: ends for name, (_, ends) in zip(PARAMETERS, drawn, strict=True)},
        parameters={name: value for name, (value, _) in zip(PARAMETERS, drawn, strict=True)},
        effects=tuple(
            Effect(
                info.name, {one.name: draw(within(one.least, min(one.most, 1e9))) for one in info.parameters}
            )
            for info in infos
        ),
        time_step=draw(st.sampled_from(["rounded", "continuous"])),
    )


def bits(value: object) -> object:
    """Return a structure with every float as its bytes, so that -0.0 and 0.0 differ."""
    if isinstance(value, float):
        return struct.pack("d", value)
    if isinstance(value, dict):
        return {key: bits(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [bits(item) for item in value]
    return value


@given(models())
def test_round_trip_bit_for_bit(tmp_path_factory: pytest.TempPathFactory, built: Model) -> None:
    path = tmp_path_factory.getbasetemp() / "round-trip.toml"
    save_model(path, built)
    assert bits(dataclasses.asdict(load_model(path))) == bits(dataclasses.asdict(built))


LINES = st.lists(st.sampled_from(GOOD.split("\n")) | st.text(max_size=12), max_size=12).map("\n".join)


@given(st.binary() | LINES.map(str.encode))
def test_any_bytes_are_a_model_or_refused(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "garbage.toml"
    path.write_bytes(data)
    with suppress(IrtError):
        assert np.isfinite(load_model(path).values).all()


def test_unwritable(tmp_path: Path) -> None:
    with pytest.raises(IrtError, match="cannot be written"):
        save_model(tmp_path, model())
