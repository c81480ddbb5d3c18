"""A model as MJCF, the modelling language of MuJoCo: board, rims, marble, servos, camera.

Lengths are in centimetres and masses in grams: MuJoCo takes a coefficient of rolling friction, which is a
length, for at least 1e-5, and a steel marble's in metres is smaller. What MuJoCo cannot express is named in
a comment at the top of the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from irt import arguments
from irt.engine import SUBSTEP_S
from irt.export import drive, plate
from irt.export.rebound import DEAD_STEPS, solref
from irt.files import PathLike
from irt.maze import Maze
from irt.model import Model, as_model

Array = NDArray[np.float64]

#: Time step [s]: an eighth of the engine's, so that rows of whole engine steps have whole ones here.
STEP_S = SUBSTEP_S / 8.0
CM = 100.0
GRAM = 1000.0
GRAVITY = 981.0
#: Rims and plate: how thick they are, and how high the rims stand [cm].
THICK, HIGH = 1.0, 2.5
#: Inertia behind a knob as the board feels it, the board's own, that of a crank with backlash, as the board
#: feels it [g cm^2], and its friction [g cm^2/s^2], which a marble at the rim does not overcome: a servo
#: yields to no marble, and a board that the knob has let go stays where it is.
SERVO_INERTIA, BOARD_INERTIA, CRANK_INERTIA, CRANK_FRICTION = 1e8, 1e3, 1e4, 2e6
#: Knobs with smaller gears [rad per unit] are simulated as if they had this one's inertia.
_LEAST_GEAR = 1e-4
#: Effects that the file has, as far as nothing else is said.
EXPRESSED = frozenset(
    {
        "delay",
        "lag",
        "second_order_lag",
        "backlash",
        "gear_matrix",
        "cross_coupling",
        "gear_nonlinearity",
        "inertial_forces",
        "tilt_bias",
        "lean",
        "viscous_drag",
        "wall_restitution",
        "spinning_friction",
        "eccentric_marble",
        "latency",
        "camera_rotation",
        "camera_offset",
    }
)


@dataclass(frozen=True)
class Exported:
    """A file for another program.

    Attributes
    ----------
    text : str
        What is in it.
    warnings : tuple of str
        In what it differs from the model, a sentence each.
    """

    text: str
    warnings: tuple[str, ...]


@arguments.entry
def to_mjcf(model: Model | PathLike) -> Exported:
    """Return a model, or that of a file, as MJCF.

    Controls are the commands, in the rig's own unit; sensors are the marble's place as the camera sees it,
    and the tilts. See ``docs/use.md``.

    Raises
    ------
    IrtError
        If it is not a model.
    """
    model = as_model(model)
    found = drive.axes(model)
    warnings = tuple(_warnings(model, found))
    root = ET.Element("mujoco", model="labyrinth")
    root.append(ET.Comment(_head(model, warnings)))
    _add(
        root,
        "option",
        timestep=_n(STEP_S),
        gravity=_n(0.0, 0.0, -GRAVITY),
        integrator="implicitfast",
        cone="elliptic",
        impratio="1000",
        iterations="50",
        tolerance="1e-10",
    )
    _add(root, "statistic", extent=_n(CM * model.board.edge_x_m), center="0 0 0")
    _custom(root, model)
    default = _add(root, "default")
    _add(
        default,
        "geom",
        condim="6",
        contype="1",
        conaffinity="2",
        solref=_n(DEAD_STEPS * STEP_S, 1.0),
        solimp=_HARD,
    )
    _add(default, "equality", solref=_n(DEAD_STEPS * STEP_S, 1.0), solimp=_HARD)
    world = _add(root, "worldbody")
    _add(world, "light", pos=_n(0.0, 0.0, 60.0), directional="true")
    _add(world, "camera", name="above", pos=_n(0.0, 0.0, 2.0 * CM * model.board.edge_x_m), mode="fixed")
    _knobs(world, found)
    _board(world, model)
    _marble(world, model)
    _linkage(root, found)
    _actuators(root, found)
    _sensors(root, model)
    ET.indent(root)
    return Exported(f"{ET.tostring(root, encoding='unicode')}\n", warnings)


#: Letters of an effect's values that a warning shows at most.
_SHOWN = 200
_HARD = "0.99 0.99 0.001"
_EXACT = "0.9999 0.9999 0.001"


def _add(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    return ET.SubElement(parent, tag, attributes)


def _n(*numbers: float) -> str:
    """Return numbers as MJCF has them."""
    return " ".join(f"{number:.12g}" for number in numbers)


def _effect(model: Model, name: str) -> Mapping[str, float]:
    return next((one.parameters for one in model.effects if one.name == name), {})


def _head(model: Model, warnings: tuple[str, ...]) -> str:
    row_s = model.parameters["time_scale"].value * SUBSTEP_S
    lines = [
        "A marble labyrinth, written by irt export. Lengths in cm, masses in g, angles in rad.",
        f"ctrl: the commands about x and about y ({model.commands.unit}), held for a row of {row_s:.6g} s.",
        'sensor "marble": its place in the camera\'s frame [cm]; times edges_per_cm it is as in recordings.',
        *(f"Differs from the model: {one}." for one in warnings),
    ]
    return "\n".join(["", *(f"    {line.replace('--', '- -')}" for line in lines), "  "])


def _warnings(model: Model, found: Mapping[str, drive.Axis]) -> Iterator[str]:
    for effect in model.effects:
        if effect.name not in EXPRESSED:
            values = ", ".join(f"{name} {value:.4g}" for name, value in effect.parameters.items())
            shown = f" ({values})" if len(values) < _SHOWN else ""
            yield f"{effect.name}{shown} is left out: MuJoCo's language has nothing for it"
    heavy = _effect(model, "eccentric_marble")
    if heavy and heavy.get("follows_path", 1.0):
        yield "eccentric_marble is left out: MuJoCo's marble has no heavy side that follows its path"
    if _effect(model, "wall_restitution").get("falloff", 0.0):
        yield "falloff of wall_restitution is left out: MuJoCo's rims return the same part at all speeds"
    if any(_is_bent(one) and _is_mixed(one, axis) for axis, one in found.items()):
        yield "gear_nonlinearity is left out about an axis that both commands move: MuJoCo bends one alone"
    if model.maze is not None:
        for one, other in plate.gaps(model.maze.holes, model.maze.hole_radius_m):
            yield f"some of the plate between holes {one} and {other} is missing: they are close together"
    yield from drive.warnings(found)


def _is_bent(one: drive.Axis) -> bool:
    return one.cubic != 0.0


def _is_mixed(one: drive.Axis, axis: str) -> bool:
    return any(gear != 0.0 for other, gear in one.gears.items() if other != axis)


def _custom(root: ET.Element, model: Model) -> None:
    custom = _add(root, "custom")
    numbers = {
        "row_s": model.parameters["time_scale"].value * SUBSTEP_S,
        "edges_per_cm": model.parameters["observation_scale"].value / (CM * model.board.edge_x_m),
    }
    for name, value in numbers.items():
        _add(custom, "numeric", name=name, data=_n(value))


def _knobs(world: ET.Element, found: Mapping[str, drive.Axis]) -> None:
    """Add what the servos turn, and behind a gap of backlash what turns with the board."""
    for axis, one in found.items():
        felt = max(abs(one.gears[axis]), _LEAST_GEAR) ** 2
        parts = {"knob": {"armature": _n(SERVO_INERTIA * felt)}}
        if one.width > 0.0:
            friction = CRANK_FRICTION * math.sqrt(felt)
            parts["crank"] = {"armature": _n(CRANK_INERTIA * felt), "frictionloss": _n(friction)}
        for name, attributes in parts.items():
            body = _add(world, "body", name=f"{name}_{axis}", pos=_n(0.0, 0.0, -20.0), gravcomp="1")
            _add(body, "inertial", pos="0 0 0", mass="1", diaginertia="1e-3 1e-3 1e-3")
            _add(
                body,
                "joint",
                name=f"{name}_{axis}",
                type="hinge",
                axis=_AXES[axis],
                solreffriction=_n(2 * STEP_S, 1.0),
                solimpfriction=_EXACT,
                **attributes,
            )


_AXES = {"x": "1 0 0", "y": "0 1 0"}


def _board(world: ET.Element, model: Model) -> None:
    """Add the board on its two hinges, with its rims."""
    parameters = model.parameters
    radius = CM * model.marble.radius_m
    half_x, half_y = 0.5 * CM * model.board.edge_x_m, 0.5 * CM * model.board.edge_y_m
    spinning = model.board.spinning_friction + _effect(model, "spinning_friction").get("increase", 0.0)
    rolling = parameters["rolling_friction"].value
    body = world
    for axis in "xy":
        body = _add(body, "body", name="board" if axis == "y" else "gimbal", gravcomp="1")
        _add(body, "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
        _add(body, "joint", name=f"tilt_{axis}", type="hinge", axis=_AXES[axis], armature=_n(BOARD_INERTIA))
    friction = (model.board.sliding_friction, spinning * radius, rolling * radius)
    maze = model.maze or Maze()
    _plate(body, maze, np.array([half_x, half_y]) + THICK, friction)
    restitution = model.board.wall_restitution + _effect(model, "wall_restitution").get("increase", 0.0)
    rubbing = model.board.wall_friction + _effect(model, "wall_restitution").get("friction_increase", 0.0)
    rim = {
        "type": "box",
        "friction": _n(max(rubbing, 0.0), 0.0, 0.0),
        "solref": _n(*solref(min(max(restitution, 0.0), 1.0), STEP_S)),
        "rgba": "0.45 0.3 0.18 1",
    }
    for name, x, y in (("east", 1, 0), ("west", -1, 0), ("north", 0, 1), ("south", 0, -1)):
        _add(
            body,
            "geom",
            name=f"rim_{name}",
            pos=_n(x * (half_x + THICK / 2.0), y * (half_y + THICK / 2.0), HIGH / 2.0),
            size=_n(THICK / 2.0 if x else half_x + THICK, THICK / 2.0 if y else half_y + THICK, HIGH / 2.0),
            **rim,
        )
    _walls(body, maze, rim)
    _camera(body, model, radius)


def _plate(body: ET.Element, maze: Maze, half: Array, friction: tuple[float, float, float]) -> None:
    """Add the plate: a box, or as many as it takes about the holes."""
    radius = CM * maze.hole_radius_m
    holes = [(CM * x, CM * y) for x, y in maze.holes]
    for number, box in enumerate(plate.boxes(half, holes, radius)):
        _add(
            body,
            "geom",
            name=f"plate_{number}" if number else "plate",
            type="box",
            pos=_n(box.x, box.y, -THICK / 2.0),
            size=_n(box.half_x, box.half_y, THICK / 2.0),
            quat=_n(math.cos(box.turn / 2.0), 0.0, 0.0, math.sin(box.turn / 2.0)),
            friction=_n(*friction),
            rgba="0.78 0.62 0.42 1",
        )


def _walls(body: ET.Element, maze: Maze, rim: Mapping[str, str]) -> None:
    """Add inner walls, with the friction and rebound of rims: a box each, and a cylinder for either end."""
    half, high = 0.5 * CM * maze.wall_thickness_m, CM * maze.wall_height_m
    for number, ends in enumerate(maze.walls, start=1):
        x0, y0, x1, y1 = (CM * one for one in ends)
        turn = 0.5 * math.atan2(y1 - y0, x1 - x0)
        _add(
            body,
            "geom",
            name=f"wall_{number}",
            pos=_n((x0 + x1) / 2.0, (y0 + y1) / 2.0, high / 2.0),
            quat=_n(math.cos(turn), 0.0, 0.0, math.sin(turn)),
            size=_n(max(math.hypot(x1 - x0, y1 - y0) / 2.0, _POINT), half, high / 2.0),
            **rim,
        )
        for end, (x, y) in enumerate(((x0, y0), (x1, y1)), start=1):
            _add(
                body,
                "geom",
                name=f"wall_{number}_end_{end}",
                pos=_n(x, y, high / 2.0),
                size=_n(half, high / 2.0),
                **{**rim, "type": "cylinder"},
            )


#: Half the length of the box of a wall that is a post [cm].
_POINT = 1e-4


def _camera(body: ET.Element, model: Model, radius: float) -> None:
    """Add the frame in which the marble is seen: the board's, turned and shifted as pictures are."""
    angle = _effect(model, "camera_rotation").get("angle_rad", 0.0)
    offset = np.array([_effect(model, "camera_offset").get(f"{axis}_edges", 0.0) for axis in "xy"])
    back = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    cm_per_edge = CM * model.board.edge_x_m / model.parameters["observation_scale"].value
    place = -cm_per_edge * back @ offset
    _add(
        body,
        "site",
        name="camera",
        pos=_n(*place, radius),
        quat=_n(math.cos(-angle / 2.0), 0.0, 0.0, math.sin(-angle / 2.0)),
        size="0.1",
        rgba="0 0 0 0",
    )


def _marble(world: ET.Element, model: Model) -> None:
    radius, mass = CM * model.marble.radius_m, GRAM * model.marble.mass_kg
    rate = model.marble.damping_per_s + _effect(model, "viscous_drag").get("rate_per_s", 0.0)
    start = (0.0, 0.0) if model.maze is None or model.maze.start is None else model.maze.start
    body = _add(world, "body", name="marble", pos=_n(CM * start[0], CM * start[1], radius))
    # One coefficient damps both the way and the turn of a marble that rolls: together they make the rate.
    damping = 1.4 * mass * rate / (1.0 + 1.0 / radius**2)
    _add(body, "joint", name="marble", type="free", damping=_n(damping))
    inertia = 0.4 * mass * radius**2
    heavy = _effect(model, "eccentric_marble")
    off = np.zeros(3)
    if heavy and not heavy.get("follows_path", 1.0):
        phase, lean = heavy.get("phase_rad", 0.0), heavy.get("lean_rad", 0.0)
        direction = [math.sin(phase) * math.cos(lean), math.sin(lean), math.cos(phase) * math.cos(lean)]
        off = radius * heavy.get("offset", 0.0) * np.array(direction)
    _add(body, "inertial", pos=_n(*off), mass=_n(mass), diaginertia=_n(inertia, inertia, inertia))
    _add(
        body,
        "geom",
        name="marble",
        type="sphere",
        size=_n(radius),
        contype="2",
        conaffinity="1",
        priority="-1",
        rgba="0.75 0.77 0.8 1",
    )


def _linkage(root: ET.Element, found: Mapping[str, drive.Axis]) -> None:
    """Add what ties knobs, cranks and board together."""
    equality = ET.Element("equality")
    tendon = ET.Element("tendon")
    turns = {axis: f"crank_{axis}" if one.width > 0.0 else f"knob_{axis}" for axis, one in found.items()}
    for axis, one in found.items():
        if one.width > 0.0:
            gap = _add(
                tendon,
                "fixed",
                name=f"backlash_{axis}",
                limited="true",
                range=_n(-one.width / 2.0, one.width / 2.0),
                solreflimit=_n(2 * STEP_S, 1.0),
                solimplimit=_EXACT,
            )
            _add(gap, "joint", joint=f"crank_{axis}", coef="1")
            _add(gap, "joint", joint=f"knob_{axis}", coef="-1")
        if not _is_mixed(one, axis):
            _add(
                equality,
                "joint",
                name=f"gear_{axis}",
                joint1=f"tilt_{axis}",
                joint2=turns[axis],
                polycoef=_n(one.bias_rad, one.gears[axis], 0.0, one.cubic, 0.0),
                solimp=_EXACT,
            )
            continue
        linkage = _add(tendon, "fixed", name=f"linkage_{axis}")
        _add(linkage, "joint", joint=f"tilt_{axis}", coef="1")
        for other, gear in one.gears.items():
            _add(linkage, "joint", joint=turns[other], coef=_n(-gear))
        _add(
            equality,
            "tendon",
            name=f"gear_{axis}",
            tendon1=f"linkage_{axis}",
            polycoef=_n(one.bias_rad, 0, 0, 0, 0),
            solimp=_EXACT,
        )
    root.extend([part for part in (tendon, equality) if len(part)])


def _actuators(root: ET.Element, found: Mapping[str, drive.Axis]) -> None:
    actuator = _add(root, "actuator")
    for axis, one in found.items():
        inertia = SERVO_INERTIA * max(abs(one.gears[axis]), _LEAST_GEAR) ** 2
        stiffness, damping = inertia / one.servo_s**2, 2.0 * one.damping_ratio * inertia / one.servo_s
        more: dict[str, str] = {}
        if one.lag_s > 0.0:
            more |= {"dyntype": "filterexact", "dynprm": _n(one.lag_s)}
        if one.delay_s >= STEP_S:
            more |= {"delay": _n(one.delay_s), "nsample": f"{math.ceil(one.delay_s / STEP_S) + 2}"}
        _add(
            actuator,
            "general",
            name=f"knob_{axis}",
            joint=f"knob_{axis}",
            gainprm=_n(stiffness),
            biastype="affine",
            biasprm=_n(0.0, -stiffness, -damping),
            **more,
        )


def _sensors(root: ET.Element, model: Model) -> None:
    sensor = _add(root, "sensor")
    latency = _effect(model, "latency").get("latency_s", 0.0)
    more = {}
    if latency >= STEP_S:
        more = {"delay": _n(latency), "nsample": f"{math.ceil(latency / STEP_S) + 2}"}
    _add(
        sensor,
        "framepos",
        name="marble",
        objtype="xbody",
        objname="marble",
        reftype="site",
        refname="camera",
        **more,
    )
    for axis in "xy":
        _add(sensor, "jointpos", name=f"tilt_{axis}", joint=f"tilt_{axis}")
