"""What a fit leaves behind and a simulation starts from: dimensions, five parameters, effects."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irt import arguments, catalogue, display
from irt.dimensions import check_room
from irt.engine import TimeStep, rollouts
from irt.errors import IrtError, located, unknown_name
from irt.files import PathLike, TomlTable, file_or_inside, read_toml, write_atomic
from irt.maze import Maze, read_maze
from irt.posterior import (
    SPINNING,
    Component,
    check_posterior,
    drawn_effects,
    drawn_parameters,
    draws,
    posterior_lines,
    read_posterior,
)
from irt.recording import as_commands, as_start, durations
from irt.rig import (
    PARAMETERS,
    RANGES,
    Board,
    Commands,
    Marble,
    Rig,
    Start,
    TiltSensor,
    check_range,
    check_value,
    read_dimensions,
    read_signals,
    read_start,
)
from irt.values import Effect, Parameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FORMAT", "GEAR_MATRIX", "LEAN", "TILT_SENSOR", "Effect", "Model", "Parameter"]
__all__ += ["as_model", "load_model", "save_model"]

#: The effect that says what the measured tilt reads; every model of recordings with a tilt has it.
TILT_SENSOR = "tilt_sensor"
#: The effect by which each command also tilts the board about the other axis: ``[commands] matrix``.
GEAR_MATRIX = "gear_matrix"
#: The effect of a table that leans otherwise in each run: its size is known, and each run's lean is not.
LEAN = "lean"
#: Version of the model file that this release writes, and the newest that it reads.
FORMAT = 1
_SECTIONS = (
    "format",
    "board",
    "marble",
    "recordings",
    "commands",
    "tilt",
    "maze",
    "simulation",
    "parameters",
    "effects",
    "posterior",
)


@dataclass(frozen=True)
class Model:
    """A simulator that matches a rig.

    Attributes
    ----------
    board, marble : Board, Marble
        What was measured directly.
    start : {"rest", "moving"}
        Whether the marble rests on a level board before row 0 of a recording.
    ranges : dict
        Lowest and highest value searched, for each of `PARAMETERS`.
    parameters : dict
        Each of `PARAMETERS` by name, in this order.
    effects : tuple of Effect
        What was added to the base simulation.
    time_step : {"rounded", "continuous"}
        Whether a timestep is ``round(time_scale)`` physics updates of 1/240 s, as in the paper, or as many
        that are a little longer or shorter, so that together they last ``time_scale / 240`` s.
    commands : Commands
        What the commands are.
    tilt : TiltSensor
        What is known of the measured tilt.
    maze : Maze or None
        Inner walls and holes; None on a bare board.
    posterior : tuple of Component
        How probable which effects and values are, as far as a fit knows; see `sample`.

    Raises
    ------
    IrtError
        If a parameter is missing, unknown, or has a value that it cannot have.
    """

    board: Board
    marble: Marble
    start: Start
    ranges: dict[str, tuple[float, float]]
    parameters: dict[str, Parameter]
    effects: tuple[Effect, ...] = ()
    time_step: TimeStep = "rounded"
    commands: Commands = field(default_factory=Commands)
    tilt: TiltSensor = field(default_factory=TiltSensor)
    maze: Maze | None = None
    posterior: tuple[Component, ...] = ()

    def __post_init__(self) -> None:
        kinds = {"board": Board, "marble": Marble, "commands": Commands, "tilt": TiltSensor}
        for name, kind in kinds.items():
            arguments.instance(name, getattr(self, name), kind)
        check_room(self.board, self.marble)
        if self.maze is not None:
            arguments.instance("maze", self.maze, Maze).check(self.board, self.marble)
        arguments.word("start", self.start, get_args(Start))
        arguments.mapping("parameters", self.parameters)
        arguments.mapping("ranges", self.ranges)
        for name, parameter in self.parameters.items():
            arguments.instance(str(name), parameter, Parameter)
        object.__setattr__(self, "effects", arguments.listed("effects", self.effects, Effect))
        for name in (*self.parameters, *self.ranges):
            if name not in PARAMETERS:
                raise unknown_name("parameter", str(name), PARAMETERS)
        for name in PARAMETERS:
            if name not in self.parameters or name not in self.ranges:
                raise IrtError(f"{name} is missing; a model needs all of {', '.join(PARAMETERS)}")
            check_value(name, self.parameters[name].value)
            check_range(name, *arguments.pair(name, self.ranges[name]))
        arguments.word("time_step", self.time_step, get_args(TimeStep))
        object.__setattr__(self, "posterior", arguments.listed("posterior", self.posterior, Component))
        check_posterior(self.posterior)
        object.__setattr__(self, "parameters", {name: self.parameters[name] for name in PARAMETERS})

    @classmethod
    def from_rig(
        cls,
        rig: Rig,
        values: ArrayLike | Mapping[str, float],
        *,
        intervals: ArrayLike | None = None,
        effects: Sequence[Effect] = (),
        time_step: TimeStep = "rounded",
    ) -> Model:
        """Return the model of a rig for these values of the parameters.

        Parameters
        ----------
        rig : Rig
            Where dimensions, start and ranges come from.
        values : (5,) array or mapping
            In the order of `PARAMETERS`, or by name; each in its own unit.
        intervals : (5, 2) array, optional
            95 % intervals, lower and upper ends.
        effects : sequence of Effect, optional
            What is added to the base simulation.
        time_step : {"rounded", "continuous"}
            See `Model`.

        Raises
        ------
        IrtError
            If the values are not one for each parameter.
        """
        if isinstance(values, Mapping):
            by_name = {name: arguments.number(str(name), value) for name, value in values.items()}
        else:
            by_name = dict(
                zip(PARAMETERS, _floats("values", values, (len(PARAMETERS),)).tolist(), strict=True)
            )
        arguments.instance("rig", rig, Rig)
        ends = {}
        if intervals is not None:
            ends = dict(
                zip(PARAMETERS, _floats("intervals", intervals, (len(PARAMETERS), 2)).tolist(), strict=True)
            )
        return cls(
            board=rig.board,
            marble=rig.marble,
            start=rig.start,
            ranges=dict(rig.ranges),
            parameters={name: Parameter(value, *ends.get(name, ())) for name, value in by_name.items()},
            effects=arguments.listed("effects", effects, Effect),
            time_step=time_step,
            commands=rig.commands,
            tilt=rig.tilt,
            maze=rig.maze,
        )

    @property
    def values(self) -> NDArray[np.float64]:
        """The parameters' values, (5,), in the order of `PARAMETERS`."""
        return np.array([self.parameters[name].value for name in PARAMETERS])

    @arguments.entry
    def sample(self, n: int, seed: int = 0) -> list[Model]:
        """Draw models from the posterior: effects and values as probable as the recordings leave them.

        Parameters
        ----------
        n : int
            How many. Draw i is the same for every n.
        seed : int
            Of the draws.

        Returns
        -------
        list of Model
            Without intervals, and without a posterior of their own.

        Raises
        ------
        IrtError
            If the model has no posterior.
        """
        arguments.whole("n", n, 1)
        arguments.whole("seed", seed)
        return [
            replace(
                self,
                board=replace(
                    self.board, spinning_friction=found.get(SPINNING, self.board.spinning_friction)
                ),
                parameters=drawn_parameters(self.parameters, found),
                effects=drawn_effects(self.effects, drawn, found),
                posterior=(),
            )
            for drawn, found in draws(self.posterior, n, seed)
        ]

    @arguments.entry
    def predict(
        self,
        commands: Any,
        start: ArrayLike | None = None,
        *,
        t: ArrayLike | None = None,
        start_velocity: ArrayLike | None = None,
        seed: int = 0,
        threads: int | None = None,
    ) -> NDArray[np.float64]:
        """Predict where the marble rolls under commands, with all effects of the model.

        The numbers are those of ``irt simulate``. `irt.rollouts` takes models, too, and returns the board's
        tilt with the positions.

        Parameters
        ----------
        commands : (steps, 2) or (n, steps, 2) array, Recording, path or table
            Knob angles [rad], or in the rig's own unit. Of a recording, and of a file, data frame or mapping
            with the columns of one, the stamps and the marble's first place count as well.
        start : (2,) or (n, 2) array, optional
            The marble's place in row 0 [board edges]; default that of the commands, or the centre.
        t : (steps,) array, optional
            Time of each row [s]; without it a row takes what the model's time scale says.
        start_velocity : (2,) or (n, 2) array, optional
            Its velocity in row 0 [board edges per second]; default at rest.
        seed : int
            Of effects that draw random numbers.
        threads : int, optional
            Of the engine; by default one for each core.

        Returns
        -------
        (steps, 2) or (n, steps, 2) array
            Positions as a camera sees them [board edges], the start in row 0.

        Raises
        ------
        IrtError
            If the commands are none, or a value is not as it must be.
        """
        given = as_commands(commands)
        stamps = given.stamps if t is None else arguments.array("t", t)
        if stamps is not None and (
            stamps.shape != given.knobs.shape[-2:-1] or len(stamps) < 2 or (np.diff(stamps) <= 0.0).any()
        ):
            raise IrtError(
                f"t: expected {given.knobs.shape[-2]} rising times, one for each row of the commands"
            )
        found = rollouts(
            self,
            given.knobs,
            start=given.start if start is None else as_start(start),
            start_velocity=start_velocity,
            durations=durations(stamps),
            seed=seed,
            threads=threads,
        )
        return found[0] if given.knobs.ndim == 2 else found

    def plot(self) -> Figure:
        """Draw where the parameters lie in the ranges searched; return a matplotlib figure."""
        from irt import pictures  # noqa: PLC0415

        return pictures.spans(
            [
                pictures.Span(
                    name=name,
                    text=display.interval(one.value, one.low, one.high),
                    value=one.value,
                    interval=(one.value, one.value) if one.low is None else (one.low, one.high or one.low),
                    range=self.ranges[name],
                )
                for name, one in self.parameters.items()
            ]
        )

    def _repr_html_(self) -> str:
        rows = [
            (name, display.interval(one.value, one.low, one.high), "{:g} to {:g}".format(*self.ranges[name]))
            for name, one in self.parameters.items()
        ]
        effects = [
            (effect.name, ", ".join(f"{name} {value:.4g}" for name, value in effect.parameters.items()))
            for effect in self.effects
        ]
        return display.page(
            "Model",
            display.table(("parameter", "value (95 % interval)", "searched"), rows),
            display.table(("effect", "parameters"), effects),
        )

    @property
    def reach(self) -> NDArray[np.float64]:
        """How far from the centre the marble's centre is seen at most, (2,) [board edges]."""
        room = np.array([self.board.edge_x_m, self.board.edge_y_m]) / 2.0 - self.marble.radius_m
        return np.asarray(room / self.board.edge_x_m * self.parameters["observation_scale"].value)


def load_model(path: PathLike) -> Model:
    """Read a model that `save_model` wrote, or a person.

    Parameters
    ----------
    path : path
        The TOML file, or the folder that `irt tune` or `irt diagnose` wrote it to.

    Raises
    ------
    IrtError
        If it is no model, of a newer format, or has an unknown effect; the message names section and key.
    """
    path = file_or_inside(arguments.path("path", path), "model.toml")
    table = read_toml(path, "a model.toml, as `irt tune` and `irt diagnose` write it")
    if not table.content:
        raise IrtError(f"{path}: the file is empty")
    _check_format(table)
    table.only("section", _SECTIONS)
    board, marble = read_dimensions(table)
    maze = read_maze(table, board, marble)
    simulation = table.section("simulation")
    simulation.only("key", ("time_step",))
    time_step = simulation.word("time_step") if "time_step" in simulation else "rounded"
    parameters, ranges = _read_parameters(table.section("parameters"))
    effects = tuple(_read_effect(entry) for entry in table.sections("effects"))
    commands, tilt = read_signals(table)
    with located(f"{path}"):
        return Model(
            board=board,
            marble=marble,
            start=read_start(table),
            ranges=ranges,
            parameters=parameters,
            effects=effects,
            time_step=time_step,  # type: ignore[arg-type]  # the model checks it
            commands=commands,
            tilt=tilt,
            maze=maze,
            posterior=read_posterior(table),
        )


def as_model(value: Model | PathLike) -> Model:
    """Return a model, or the one in the file named.

    Raises
    ------
    IrtError
        If it is neither, or the file is no model.
    """
    if isinstance(value, Model):
        return value
    if isinstance(value, str | Path):
        return load_model(value)
    raise IrtError(f"model: expected irt.Model or the path of a model.toml, got {arguments.shown(value)}")


def save_model(path: PathLike, model: Model) -> None:
    """Write a model as TOML, so that `load_model` returns the same numbers bit for bit.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    arguments.instance("model", model, Model)
    write_atomic(arguments.path("path", path), "\n".join(_lines(model)) + "\n")


def _check_format(table: TomlTable) -> None:
    found = table.content.get("format", FORMAT)
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise table.error("format", f"expected a number from 1 to {FORMAT}, found {found}")
    if found > FORMAT:
        raise table.error(
            "format", f"{found} is a newer format than this release reads ({FORMAT}): update irt"
        )


def _read_parameters(section: TomlTable) -> tuple[dict[str, Parameter], dict[str, tuple[float, float]]]:
    section.only("parameter", PARAMETERS)
    parameters = {}
    ranges = dict(RANGES)
    for name, content in section.content.items():
        if not isinstance(content, dict):
            parameters[name] = Parameter(section.number(name))
        else:
            table = section.inline(name, "")
            table.only("key", ("value", "low", "high", "range"))
            with located(table.where):
                parameters[name] = Parameter(
                    table.number("value"), **table.numbers("low", "high", infinite=True)
                )
            if "range" in table:
                ranges[name] = table.pair("range")
        with located(section.where):
            check_value(name, parameters[name].value)
            check_range(name, *ranges[name])
    return parameters, ranges


def _read_effect(table: TomlTable) -> Effect:
    name = table.word("name")
    with located(table.where):
        known = {parameter.name: parameter for parameter in catalogue.effect(name).parameters}
    table.only(f"parameter of {name}", ("name", *known))
    values = {key: table.number(key) for key in table.content if key != "name"}
    for key, value in values.items():
        least, most = known[key].least, known[key].most
        if not least <= value <= most:
            raise table.error(key, f"expected a number from {least:g} to {most:g}, found {value:g}")
    return Effect(name, values)


def _lines(model: Model) -> Iterator[str]:
    """Yield the lines of the model's TOML; repr writes a float so that it reads back as the same number."""
    yield f"format = {FORMAT}"
    for name, part in (("board", model.board), ("marble", model.marble)):
        yield f"\n[{name}]"
        for entry in fields(part):
            yield f"{entry.name} = {float(getattr(part, entry.name))!r}"
    yield f'\n[recordings]\nstart = "{model.start}"'
    # Sections that say what every rig of the paper's kind has are left out.
    if model.commands != Commands():
        yield f"\n[commands]\nunit = {json.dumps(model.commands.unit)}"
        yield f"matrix = {str(model.commands.matrix).lower()}"
    if model.tilt != TiltSensor():
        yield "\n[tilt]"
        if model.tilt.noise_rad is not None:
            yield f"noise_rad = {model.tilt.noise_rad!r}"
        yield f"offset = {{ range = [{float(model.tilt.offset[0])!r}, {float(model.tilt.offset[1])!r}] }}"
    if model.maze is not None:
        yield "\n[maze]"
        yield from model.maze.lines()
    yield f'\n[simulation]\ntime_step = "{model.time_step}"'
    yield "\n[parameters]"
    for name, parameter in model.parameters.items():
        known = {"value": parameter.value, "low": parameter.low, "high": parameter.high}
        shown = [f"{key} = {float(value)!r}" for key, value in known.items() if value is not None]
        low, high = model.ranges[name]
        yield f"{name} = {{ {', '.join(shown)}, range = [{float(low)!r}, {float(high)!r}] }}"
    for effect in model.effects:
        yield f'\n[[effects]]\nname = "{effect.name}"'
        for name, value in effect.parameters.items():
            yield f"{name} = {float(value)!r}"
    yield from posterior_lines(model.posterior)


def _floats(what: str, values: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = arguments.array(what, values)
    if array.shape != shape:
        raise IrtError(f"{what} must have shape {shape}, not {array.shape}")
    return array
