"""The array interface of the engine: simulate batches of rollouts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import Any, Literal, Protocol, get_args, overload, runtime_checkable

import numpy as np
import numpy.typing as npt

from irt import _labsim, arguments
from irt.catalogue import parameter_values
from irt.errors import IrtError
from irt.maze import Maze
from irt.rig import Board, Marble

Array = npt.NDArray[np.float64]
Engine = Literal["rolling", "rapier"]
TimeStep = Literal["rounded", "continuous"]
Hold = Literal["zero", "first"]

#: The shape of commands, for messages.
_COMMANDS = "(steps, 2) or (n, steps, 2)"

SUBSTEP_S: float = _labsim.SUBSTEP_S
#: Acceleration of free fall in the simulation [m/s^2].
GRAVITY: float = _labsim.GRAVITY


@runtime_checkable
class HasBoardAndMarble(Protocol):
    """A rig or a model: anything with a board and a marble."""

    @property
    def board(self) -> Board:
        """The board and its rim."""

    @property
    def marble(self) -> Marble:
        """The marble."""


class HasParameters(Protocol):
    """An effect: its name in the catalogue, its parameters by name."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """Its parameters."""


@runtime_checkable
class Simulator(HasBoardAndMarble, Protocol):
    """A complete simulator, such as `irt.Model`."""

    @property
    def values(self) -> Array:
        """The five parameters, (5,)."""

    @property
    def effects(self) -> Sequence[HasParameters]:
        """Effects in addition to the base physics."""

    @property
    def time_step(self) -> TimeStep:
        """Division of a row into updates; see `rollouts`."""

    @property
    def start(self) -> str:
        """State of the marble before row 0: "rest" or "moving"."""


@overload
def rollouts(
    parameters: npt.ArrayLike | Simulator,
    commands: npt.ArrayLike,
    *,
    rig: HasBoardAndMarble | None = None,
    effects: Sequence[Mapping[str, Any]] | None = None,
    engine: Engine = "rolling",
    start: npt.ArrayLike | None = None,
    seed: npt.ArrayLike = 0,
    threads: int | None = None,
    rows: int | None = None,
    first: npt.ArrayLike = 0,
    issued: npt.ArrayLike | None = None,
    knobs_before: npt.ArrayLike | None = None,
    start_velocity: npt.ArrayLike | None = None,
    rolled: npt.ArrayLike = 0.0,
    turned: npt.ArrayLike | None = None,
    durations: npt.ArrayLike | None = None,
    time_step: TimeStep | None = None,
    substeps: npt.ArrayLike | None = None,
    hold: Hold = "zero",
    tilt: Literal[False] = False,
    falls: npt.NDArray[np.int64] | None = None,
) -> Array: ...
@overload
def rollouts(
    parameters: npt.ArrayLike | Simulator,
    commands: npt.ArrayLike,
    *,
    rig: HasBoardAndMarble | None = None,
    effects: Sequence[Mapping[str, Any]] | None = None,
    engine: Engine = "rolling",
    start: npt.ArrayLike | None = None,
    seed: npt.ArrayLike = 0,
    threads: int | None = None,
    rows: int | None = None,
    first: npt.ArrayLike = 0,
    issued: npt.ArrayLike | None = None,
    knobs_before: npt.ArrayLike | None = None,
    start_velocity: npt.ArrayLike | None = None,
    rolled: npt.ArrayLike = 0.0,
    turned: npt.ArrayLike | None = None,
    durations: npt.ArrayLike | None = None,
    time_step: TimeStep | None = None,
    substeps: npt.ArrayLike | None = None,
    hold: Hold = "zero",
    tilt: Literal[True],
    falls: npt.NDArray[np.int64] | None = None,
) -> tuple[Array, Array]: ...
@arguments.entry
def rollouts(
    parameters: npt.ArrayLike | Simulator,
    commands: npt.ArrayLike,
    *,
    rig: HasBoardAndMarble | None = None,
    effects: Sequence[Mapping[str, Any]] | None = None,
    engine: Engine = "rolling",
    start: npt.ArrayLike | None = None,
    seed: npt.ArrayLike = 0,
    threads: int | None = None,
    rows: int | None = None,
    first: npt.ArrayLike = 0,
    issued: npt.ArrayLike | None = None,
    knobs_before: npt.ArrayLike | None = None,
    start_velocity: npt.ArrayLike | None = None,
    rolled: npt.ArrayLike = 0.0,
    turned: npt.ArrayLike | None = None,
    durations: npt.ArrayLike | None = None,
    time_step: TimeStep | None = None,
    substeps: npt.ArrayLike | None = None,
    hold: Hold = "zero",
    tilt: bool = False,
    falls: npt.NDArray[np.int64] | None = None,
) -> Array | tuple[Array, Array]:
    """Simulate a batch of rollouts.

    Arrays without the axis ``n`` are shared by all rollouts. The result of a rollout has the same bits for
    any number of threads and any other rollouts in the batch. Ctrl-C stops a long batch.

    Parameters
    ----------
    parameters : (n, 5) or Model
        ``gear_x``, ``gear_y``, ``rolling_friction``, ``time_scale``, ``observation_scale``, in their
        own units (paper, section 5.2). A model includes its board, marble, effects and time step; it is
        simulated once for each of the commands.
    commands : (steps, 2) or (n, steps, 2)
        Knob angles [rad]; command i acts from row i to row i + 1. Commands may have any other unit if gears
        are in rad per unit.
    rig : optional
        Anything with a ``board`` and a ``marble`` (a rig, a model), and a ``maze`` if it has inner walls;
        default the paper's labyrinth. A model with effects is an error here unless `effects` is given: ``()``
        for none.
    effects : sequence of mappings, optional
        Physical effects beyond the five parameters, in any order: each with its ``name`` in the catalogue
        (`effects`) and its parameters by name, numbers or (n,) arrays; missing parameters are neutral.
    engine : {"rolling", "rapier"}
        "rolling" (planar, fast) or "rapier" (3-D rigid bodies, the reference).
    start : (2,) or (n, 2), optional
        Observed position at the first row [board edges]; default the start of the maze, or the centre.
    seed : int or (n,)
        Random seed of stochastic effects. With a single number each rollout has its own draws; with an array,
        rollouts with equal numbers have equal draws.
    threads : int, optional
        Number of threads; default one per core.
    rows : int, optional
        Number of observed rows; default all from the latest `first` on.
    first : int or (n,), optional
        The row of the commands in which the marble is released and first observed. Before it only the knobs
        move, to establish states that depend on earlier commands.
    issued : (n,), optional
        Number of commands of each rollout, if shorter ones are padded; default all.
    knobs_before : (2,) or (n, 2), optional
        Knob angles before row 0 [rad]; default level, or the first command for a model of runs in motion.
    start_velocity : (2,) or (n, 2), optional
        Observed velocity at the first row [board edges per second]; default at rest.
    rolled : float or (n,), optional
        Path length of the marble before the first row [m], for effects that depend on it; default 0.
    turned : (3,) or (n, 3), optional
        Rotation of the marble before the first row, as a rotation vector [rad]; default none.
    durations : (steps,) or (n, steps), optional
        Duration of each command [s], from a recording's stamps; ``time_scale`` is then not used.
    time_step : {"rounded", "continuous"}
        "rounded" (the default): round(time_scale) updates of 1/240 s per row, as in the paper. "continuous":
        a row lasts exactly time_scale/240 s, in as many slightly longer or shorter updates; the result is
        smooth in the parameter.
    substeps : (n,), optional
        Number of updates per row of "continuous" rollouts; finite differences need equal numbers.
    hold : {"zero", "first"}
        Interpolation of commands between rows: "zero" holds a command; "first" interpolates linearly, and
        holds the last command. Play a measured tilt with "first" and gears of 1.
    tilt : bool
        Return the board's tilt as well. The positions have the same bits either way.
    falls : (n, 2) int64 array, optional
        Filled with the row from which on each marble is gone and the number of the hole that it fell through,
        counted from 0; -1 and -1 of those that did not fall.

    Returns
    -------
    (n, rows, 2), or two of them with ``tilt``
        Observed positions [board edges]; row 0 is the start, and rows after a fall are NaN. Then the board's
        angles about x and y [rad], as reported by a tilt sensor at each row, just before the command of that
        row acts. Camera latency does not affect the tilt.

    Raises
    ------
    IrtError
        For a wrong shape, a NaN, a value that physics does not allow, or an unknown name.
    """
    if isinstance(parameters, Simulator):
        for name, own in (("rig", rig), ("effects", effects), ("time_step", time_step)):
            if own is not None:
                raise IrtError(
                    f"{name}: a model has its own; leave it out, or change the model with dataclasses.replace"
                )
        model, rig, time_step = parameters, parameters, parameters.time_step
        commands = _numbers_of("commands", commands, _COMMANDS)
        commands = _array("commands", commands[None] if commands.ndim == 2 else commands, _COMMANDS, 3)
        parameters, effects = (
            np.tile(model.values, (len(commands), 1)),
            [{"name": one.name, **one.parameters} for one in model.effects],
        )
        if knobs_before is None and model.start == "moving":
            # For runs in motion, the first command is the best estimate of the knobs before.
            knobs_before = commands[:, :1].reshape(-1, commands.shape[-1])
    elif effects is None and getattr(rig, "effects", None):
        raise IrtError(
            "rig: this model has effects that its parameters do not include; pass the model instead of the "
            "parameters, or set the effects (effects=() for none)"
        )
    time_step = "rounded" if time_step is None else time_step
    arguments.word("time_step", time_step, get_args(TimeStep))
    arguments.word("hold", hold, get_args(Hold))
    arguments.text("engine", engine)
    arguments.flag("tilt", tilt)
    arguments.threads(threads)
    if rig is not None and not isinstance(rig, HasBoardAndMarble):
        raise IrtError(f"rig: expected something with a board and a marble, got {arguments.shown(rig)}")
    values = _array("parameters", parameters, "(n, 5)", 2)
    count = len(values)
    if falls is not None and (falls.shape != (count, 2) or falls.dtype != np.int64):
        raise IrtError(
            f"falls: expected an int64 array of shape ({count}, 2), got {falls.dtype} of shape {falls.shape}"
        )
    knobs = _per_rollout("commands", commands, _COMMANDS, 3, count)
    steps = knobs.shape[1]
    if steps == 0:
        raise IrtError("commands: expected at least one row, got none")
    firsts = _first_rows(first, count, steps)
    if rows is None:
        rows = steps - int(firsts.max(initial=0))
    board, marble = (rig.board, rig.marble) if rig is not None else (Board(), Marble())
    maze: Maze | None = getattr(rig, "maze", None)
    if start is None and maze is not None and maze.start is not None:
        start = values[:, 4:] / board.edge_x_m * np.array(maze.start)
    lasting = None
    if durations is not None:
        lasting = _per_rollout("durations", durations, "(steps,) or (n, steps)", 2, count, steps=steps)
    observed, tilts, fallen = _labsim.rollouts(
        values,
        knobs,
        _pairs("start", start, count),
        _pairs("start_velocity", start_velocity, count),
        _numbers("rolled", rolled, count),
        _vectors("turned", turned, count, 3),
        rows=arguments.whole("rows", rows, 1),
        first=firsts,
        issued=_lengths(issued, count, steps),
        knobs_before=_pairs("knobs_before", knobs_before, count),
        effects=parameter_values(() if effects is None else effects, count),
        seeds=_seeds(seed, count),
        board=astuple(board),
        marble=_dimensions(marble),
        maze=None if maze is None or maze.is_bare else maze.arrays(),
        engine=engine,
        continuous=time_step == "continuous",
        substeps=None if substeps is None else _counts(substeps, count),
        durations=lasting,
        hold=hold,
        tilt=tilt,
        threads=threads,
    )
    if falls is not None:
        falls[:] = fallen
    return observed if tilts is None else (observed, tilts)


def turned(path: Array, radius: float) -> Array:
    """Return the rotation of a marble that rolls along a path without spinning about the vertical.

    Parameters
    ----------
    path : (n, 2)
        Position in each row; interpolated smoothly.
    radius : float
        Radius of the marble, in the unit of the path.

    Returns
    -------
    (n, 3)
        Rotation from the first row to each row, as a rotation vector [rad].
    """
    return _labsim.turned(path, radius)


def seen(places: Array, rig: HasBoardAndMarble, effects: Sequence[Mapping[str, Any]]) -> Array:
    """Return where a camera sees places on the level board.

    Parameters
    ----------
    places : (n, 2)
        From the board's centre [board edges along x].
    rig : Rig or Model
        The board.
    effects : sequence of mapping
        Each has a "name" and parameters; effects on more than the picture are ignored.

    Returns
    -------
    (n, 2)
        Places in the picture [board edges along x].
    """
    return _labsim.seen(places, parameter_values(effects, 1), astuple(rig.board), _dimensions(rig.marble))


def _dimensions(marble: Marble) -> tuple[float, float, float]:
    """Return what the engine takes of a marble."""
    return marble.radius_m, marble.mass_kg, marble.damping_per_s


@arguments.entry
def paper_drive(steps: int = 100, amplitude: float = 0.1, literal: bool = False) -> Array:
    """Knob angles of the paper's drive (Eq. 3).

    Parameters
    ----------
    steps : int
        Number of timesteps.
    amplitude : float
        Largest knob angle [rad].
    literal : bool
        Use the equation literally, sin(t / (200π)), which covers 0.16 rad in 100 steps. The default is a full
        period in 100 steps, sin(2πt / 100), as in the paper's text.

    Returns
    -------
    (steps, 2)
        ``knob_x_rad`` and ``knob_y_rad``.
    """
    amplitude = arguments.number("amplitude", amplitude)
    if not np.isfinite(amplitude):
        raise IrtError(f"amplitude: expected a finite angle [rad], got {amplitude}")
    return _labsim.paper_drive(
        arguments.whole("steps", steps, 1),
        amplitude,
        arguments.flag("literal", literal),
    )


def _numbers_of(what: str, values: Any, shape: str) -> Array:
    try:
        return np.ascontiguousarray(arguments.real(values), dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise IrtError(f"{what}: expected numbers of shape {shape} ({error})") from error


def _array(what: str, values: object, shape: str, axes: int) -> Array:
    # A scalar becomes an array with one axis; no caller accepts that in place of more axes.
    array = _numbers_of(what, values, shape)
    if array.ndim != axes:
        raise IrtError(f"{what}: expected shape {shape}, got {array.shape}")
    return array


def _per_rollout(
    what: str, values: object, shape: str, axes: int, count: int, *, steps: int | None = None
) -> Array:
    """Return an array whose first axis has length 1 (shared) or ``count`` (one each)."""
    array = _numbers_of(what, values, shape)
    array = _array(what, array[None] if array.ndim == axes - 1 else array, shape, axes)
    if len(array) not in (1, count):
        raise IrtError(f"{what}: expected one for each of the {count} rollouts, got {len(array)}")
    if steps is not None and array.shape[1] != steps:
        raise IrtError(f"{what}: expected {steps} rows as in commands, got {array.shape[1]}")
    return array


def _pairs(what: str, values: npt.ArrayLike | None, count: int) -> Array:
    return _vectors(what, values, count, 2)


def _vectors(what: str, values: npt.ArrayLike | None, count: int, width: int) -> Array:
    if values is None:
        return np.zeros((1, width))
    shape = f"({width},) or (n, {width})"
    array = _per_rollout(what, values, shape, 2, count)
    if array.shape[1] != width:
        raise IrtError(f"{what}: expected shape {shape}, got {np.shape(values)}")
    return array


def _numbers(what: str, values: npt.ArrayLike, count: int) -> Array:
    """Return one number for all (1,) or one each (n,)."""
    array = _array(what, np.atleast_1d(values), "() or (n,)", 1)
    if array.shape not in ((1,), (count,)):
        raise IrtError(f"{what}: expected one for each of the {count} rollouts, got {len(array)}")
    return array


def _whole_numbers(what: str, values: object) -> npt.NDArray[Any]:
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise IrtError(f"{what}: expected whole numbers ({error})") from error


def _counts(values: npt.ArrayLike, count: int) -> npt.NDArray[np.uint32]:
    array = _whole_numbers("substeps", values)
    if array.shape != (count,) or not np.issubdtype(array.dtype, np.integer) or (array < 1).any():
        raise IrtError(f"substeps: expected {count} whole numbers of at least 1, got {values!r}")
    return array.astype(np.uint32)


def _first_rows(first: npt.ArrayLike, count: int, steps: int) -> npt.NDArray[np.uintp]:
    """Return the first rows, one for all (1,) or one each (n,)."""
    array = np.atleast_1d(_whole_numbers("first", first))
    if array.shape not in ((1,), (count,)) or not np.issubdtype(array.dtype, np.integer):
        raise IrtError(f"first: expected a row, or one for each of the {count} rollouts, got {first!r}")
    if array.size and not 0 <= array.min() <= array.max() < steps:
        raise IrtError(f"first: expected rows from 0 to {steps - 1}, got {array.min()} to {array.max()}")
    found: npt.NDArray[np.uintp] = array.astype(np.uintp)
    return found


def _lengths(issued: npt.ArrayLike | None, count: int, steps: int) -> npt.NDArray[np.uintp]:
    """Return the number of commands of each rollout (n,)."""
    array = np.full(count, steps) if issued is None else _whole_numbers("issued", issued)
    if array.shape != (count,) or not np.issubdtype(array.dtype, np.integer):
        raise IrtError(f"issued: expected {count} whole numbers, got {issued!r}")
    if array.size and not 1 <= array.min() <= array.max() <= steps:
        raise IrtError(f"issued: expected 1 to {steps} commands, got {array.min()} to {array.max()}")
    lengths: npt.NDArray[np.uintp] = array.astype(np.uintp)
    return lengths


def _seeds(seed: npt.ArrayLike, count: int) -> npt.NDArray[np.uint64]:
    """Return a seed for each rollout (n,): derived from one number, or as given."""
    array = _whole_numbers("seed", seed)
    if array.ndim == 0:
        mixed = np.random.SeedSequence(arguments.whole("seed", seed)).generate_state(count, np.uint64)
        return mixed.astype(np.uint64)
    if array.shape != (count,) or not np.issubdtype(array.dtype, np.integer) or (array < 0).any():
        raise IrtError(
            f"seed: expected a whole number, or one for each of the {count} rollouts, got {seed!r}"
        )
    return array.astype(np.uint64)
