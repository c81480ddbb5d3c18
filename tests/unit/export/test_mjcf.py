"""The file is well-formed, names what it refers to, has the values found, and says what it lacks."""

from __future__ import annotations

import dataclasses
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from irt.catalogue import effects
from irt.export.mjcf import EXPRESSED, STEP_S, to_mjcf
from irt.export.rebound import DEAD_RATIO, rebound, solref
from irt.maze import Maze
from irt.model import Effect, Model, Parameter
from irt.rig import PARAMETERS, RANGES, Board, Commands, Marble

VALUES = (0.07, -0.05, 3e-4, 24.0, 1.1)
#: What refers to what by name.
REFERENCES = {
    "joint": ("joint", "joint1", "joint2"),
    "tendon": ("tendon1",),
    "site": ("refname",),
    "body": ("objname",),
}


def model(*chosen: tuple[str, dict[str, float]], **changes) -> Model:
    plain = Model(
        board=Board(),
        marble=Marble(),
        start="rest",
        ranges=dict(RANGES),
        parameters={name: Parameter(value) for name, value in zip(PARAMETERS, VALUES, strict=True)},
        effects=tuple(Effect(*one) for one in chosen),
    )
    return dataclasses.replace(plain, **changes)


def tree(of: Model) -> ET.Element:
    return ET.fromstring(to_mjcf(of).text)


def named(root: ET.Element, tag: str, name: str) -> dict[str, str]:
    return next(one.attrib for one in root.iter(tag) if one.get("name") == name)


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def test_inner_walls_are_where_they_are() -> None:
    maze = Maze(walls=((-0.05, 0.0, 0.03, 0.06), (0.1, 0.0, 0.1, 0.0)))
    given = to_mjcf(model(maze=maze))
    wall = named(ET.fromstring(given.text), "geom", "wall_1")
    assert numbers(wall["pos"])[:2] == pytest.approx([-1.0, 3.0])
    assert numbers(wall["size"]) == pytest.approx([5.0, 0.25, 0.6])
    half = np.arctan2(0.06, 0.08) / 2.0
    assert numbers(wall["quat"]) == pytest.approx([np.cos(half), 0.0, 0.0, np.sin(half)])
    end = named(ET.fromstring(given.text), "geom", "wall_1_end_2")
    assert numbers(end["pos"])[:2] == pytest.approx([3.0, 6.0])
    assert (end["type"], numbers(end["size"])) == ("cylinder", pytest.approx([0.25, 0.6]))


def test_a_marble_begins_where_the_maze_does() -> None:
    marble = named(tree(model(maze=Maze.of_layout("cyberrunner-easy"))), "body", "marble")
    assert numbers(marble["pos"]) == pytest.approx([-11.83, 9.62, 0.685])


@pytest.mark.parametrize(("apart", "missing"), [(0.0184, False), (0.018, True)])
def test_holes_that_leave_no_room_for_the_plate_are_a_warning(apart, missing) -> None:
    maze = Maze(holes=((0.0, 0.0), (0.06, 0.06), (0.0, apart)))
    warnings = to_mjcf(model(maze=maze)).warnings
    assert any("between holes 1 and 3 is missing" in one for one in warnings) == missing


EVERYTHING = [(info.name, {one.name: one.low for one in info.required}) for info in effects()]


@pytest.mark.parametrize(
    "chosen",
    [[], [("backlash", {"width_x_rad": 0.02})], [("gear_matrix", {"x_from_y": 0.01})], EVERYTHING],
    ids=["plain", "backlash", "mixed", "everything"],
)
def test_every_reference_has_its_name(chosen) -> None:
    root = tree(model(*chosen))
    known = {(one.tag, one.get("name")) for one in root.iter() if one.get("name")}
    known |= {("tendon", one.get("name")) for one in root.iter("fixed")}
    assert len(list(root.iter("geom"))) == 7
    count = 0
    for one in root.iter():
        for kind, keys in REFERENCES.items():
            for key in keys:
                if one.get(key) is not None and one.tag != "default":
                    assert (kind, one.get(key)) in known, (one.tag, one.attrib)
                    count += 1
    assert count >= 8


def test_friction_and_rows_are_in_the_file_s_units() -> None:
    root = tree(model(board=dataclasses.replace(Board(), spinning_friction=5e-4)))
    assert numbers(named(root, "geom", "plate")["friction"]) == pytest.approx([0.25, 3.425e-4, 2.055e-4])
    assert numbers(named(root, "numeric", "row_s")["data"]) == [0.1]
    assert numbers(named(root, "numeric", "edges_per_cm")["data"])[0] == pytest.approx(1.1 / 27.6)
    assert numbers(named(root, "geom", "marble")["size"]) == [0.685]


def test_a_rim_rubs_as_found_and_its_falloff_is_named_as_missing() -> None:
    found = to_mjcf(model(("wall_restitution", {"increase": 0.3, "falloff": 0.4, "friction_increase": 0.1})))
    assert numbers(named(ET.fromstring(found.text), "geom", "rim_east")["friction"]) == pytest.approx(
        [0.35, 0, 0]
    )
    assert any("falloff of wall_restitution is left out" in one for one in found.warnings)
    plain = to_mjcf(model(("wall_restitution", {"increase": 0.3, "falloff": 0.0, "friction_increase": 0.0})))
    assert not any("falloff" in one for one in plain.warnings)


def test_delay_lag_backlash_and_bias_are_native() -> None:
    root = tree(
        model(
            ("delay", {"delay_s": 0.12, "y_minus_x_s": 0.04}),
            ("lag", {"time_constant_s": 0.08}),
            ("backlash", {"width_x_rad": 0.03}),
            ("tilt_bias", {"bias_y_rad": 0.002}),
        )
    )
    x, y = (named(root, "general", f"knob_{axis}") for axis in "xy")
    # The servo comes 0.02 s later than a command: that much is taken off.
    assert float(x["delay"]) == pytest.approx(0.08)
    assert float(y["delay"]) == pytest.approx(0.12)
    assert int(x["nsample"]) * STEP_S > 0.08
    assert (x["dyntype"], float(x["dynprm"])) == ("filterexact", 0.08)
    gap = named(root, "fixed", "backlash_x")
    assert numbers(gap["range"]) == [-0.015, 0.015]
    gears = {
        axis: next(e for e in root.iter("joint") if e.get("joint1") == f"tilt_{axis}").attrib for axis in "xy"
    }
    assert gears["x"]["joint2"] == "crank_x"
    assert gears["y"]["joint2"] == "knob_y"
    assert numbers(gears["x"]["polycoef"])[:2] == pytest.approx([0.0, 0.07])
    assert numbers(gears["y"]["polycoef"])[:2] == pytest.approx([0.002, -0.05])


def test_a_second_order_lag_is_the_servo_itself() -> None:
    root = tree(model(("second_order_lag", {"time_constant_s": 0.05, "damping_ratio": 0.6})))
    servo = named(root, "general", "knob_x")
    inertia = float(named(root, "joint", "knob_x")["armature"])
    _, minus_stiffness, minus_damping = numbers(servo["biasprm"])
    assert -minus_stiffness / inertia == pytest.approx(1.0 / 0.05**2)
    assert -minus_damping / inertia == pytest.approx(2.0 * 0.6 / 0.05)


def test_what_the_file_has_not_is_a_warning_and_a_comment() -> None:
    exported = to_mjcf(
        model(("stribeck", {"strength": 1.5, "speed_m_per_s": 0.02}), ("delay", {"delay_s": 0.1}))
    )
    (warning,) = exported.warnings
    assert warning.startswith("stribeck (strength 1.5, speed_m_per_s 0.02) is left out")
    assert warning in exported.text


def test_a_servo_that_nothing_makes_up_for_is_a_warning() -> None:
    (warning,) = to_mjcf(model()).warnings
    assert "about x and y 20 ms later" in warning


def test_each_effect_is_expressed_or_named() -> None:
    for name, values in EVERYTHING:
        warnings = to_mjcf(model((name, values), ("delay", {"delay_s": 0.1}))).warnings
        assert (name in EXPRESSED and name != "eccentric_marble") != any(name in one for one in warnings), (
            name
        )


def test_a_comment_ends_where_it_should() -> None:
    assert "mA" in to_mjcf(model(commands=Commands("mA --> x"))).text
    tree(model(commands=Commands("mA --> <x>")))


def test_no_gear_is_still_a_model() -> None:
    parameters = {name: Parameter(0.0 if "gear" in name else 1.0) for name in PARAMETERS}
    assert all(
        np.isfinite(numbers(one.get("armature", "0"))).all()
        for one in tree(model(parameters=parameters)).iter()
    )


@pytest.mark.parametrize("restitution", [0.2, 0.4, 0.8])
def test_a_stepped_contact_returns_what_is_asked_for(restitution: float) -> None:
    time_constant, ratio = solref(restitution, STEP_S)
    assert rebound(ratio) == pytest.approx(restitution, abs=1e-6)
    assert time_constant > 2.0 * STEP_S
    # Without steps: Schwager and Poeschel (2007), "Coefficient of restitution and linear dashpot model".
    root = np.sqrt(1.0 - ratio**2)
    smooth = np.exp(-ratio / root * np.arctan2(2.0 * ratio * root, 2.0 * ratio**2 - 1.0))
    assert smooth == pytest.approx(restitution, abs=0.06)


def test_a_dead_rim_returns_next_to_nothing() -> None:
    assert solref(0.0, STEP_S) == (4.0 * STEP_S, DEAD_RATIO)
