"""Baseline: `mujoco.sysid`, MuJoCo's own system identification, on a MuJoCo model of board and marble.

The model is one that a user of MuJoCo would write: a sphere that rolls on a plane between four rims, and two
actuators that turn commands into gravity along the board. Its parameters are gains, levels, delay and lag of
the actuation, rolling friction and damping of the marble, and scale and offset of the camera. They start from
the base model, and are fitted to complete recordings with sysid's optimiser, parameters and residuals. Two of
its hooks are used: a rollout in which commands are delayed, and a residual in board edges with a robust loss,
because trackers have outliers and paths diverge after impacts. The row duration stays that of the base model:
only walls distinguish it from the gains.

It names nothing, because sysid has no test for missing physics. Its report has 95 % intervals, which hold if
the model is right and its residuals are white. Those of another engine are not, and intervals then exclude
a delay of zero where there is none. A careful user does not take them for a test.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.engine import GRAVITY
from irt.proof.baselines.entry import Entry, Task, by_name
from irt.proof.baselines.robust import loss, robust_size
from irt.recording import Recording
from irt.rig import PARAMETERS, Rig
from irt.segments import LEAD_ROWS

Array = NDArray[np.float64]

TITLE = "mujoco.sysid"
#: Parts of each recording, from row 0, in the rounds of a fit, and iterations of each round. At first paths
#: have not diverged yet; each round has the robust loss that its first residuals give.
PARTS, ITERATIONS = (0.3, 1.0), 8
#: Factor of the regulariser after a failed step; sysid's own, 1.26, takes many rollouts where paths diverge.
_GROWTH = 4.0
#: Distance from a bound at which a round begins, as a share of the range.
_OFF_BOUND = 2e-3
#: Steps of the simulation in a row; more come closer to the base model, and take as much longer.
STEPS = 18
#: Step of finite differences, in the parameters' units.
STEP = 1e-3


@dataclass(frozen=True)
class Quantity:
    """A parameter of the model.

    Attributes
    ----------
    name : str
        Its name.
    unit : {"gain", "tilt", "row", "rate", "scale", "edge"}
        What sysid counts it in, so that one step of differences fits all; see `units`.
    low, high : float
        Bounds, in this unit.
    """

    name: str
    unit: str
    low: float
    high: float


QUANTITIES = (
    Quantity("gain_x", "gain", -5.0, 5.0),
    Quantity("gain_y", "gain", -5.0, 5.0),
    Quantity("level_x_rad", "tilt", -1.0, 1.0),
    Quantity("level_y_rad", "tilt", -1.0, 1.0),
    Quantity("delay_s", "row", 0.0, 5.0),
    Quantity("lag_s", "row", 0.0, 5.0),
    Quantity("rolling_friction", "tilt", 0.0, 1.0),
    Quantity("damping_per_s", "rate", 0.0, 1.0),
    Quantity("scale", "scale", 0.7, 1.4),
    Quantity("offset_x_edges", "edge", -0.1, 0.1),
    Quantity("offset_y_edges", "edge", -0.1, 0.1),
)


def units(task: Task) -> Array:
    """Return the units of `QUANTITIES`, (11,).

    They are the base model's mean gain and typical tilt [rad], the duration of a row [s] and its inverse, 1,
    and a board edge. Paths under gains and friction times L, in time over the root of L, are the same, and
    only walls decide between such base models. In these units they have the same problem.
    """
    gain = float(np.mean(np.abs(task.base.values[:2])))
    row_s = float(np.mean([task.row_s(one) for one in task.rig.recordings]))
    commands = np.concatenate([one.knobs for one in task.rig.recordings])
    tilt = max(gain * float(np.sqrt(np.mean(commands**2))), 1e-6)
    sizes = {"gain": gain, "tilt": tilt, "row": row_s, "rate": 1.0 / row_s, "scale": 1.0, "edge": 1.0}
    return np.array([sizes[one.unit] for one in QUANTITIES])


def enter(task: Task) -> Entry:
    """Fit the model to the recordings and predict; report and name nothing."""
    if not is_there():
        return Entry(missing="mujoco.sysid is not installed")
    if not task.begun:
        return Entry(missing="no recording has a marble in row 0")
    found = Board(task, task.tests).paths(fitted(task))
    return Entry(predictions=dict(by_name(task.tests, found)))


def is_there() -> bool:
    """Return whether MuJoCo is installed with the requirements of sysid, without which sysid is empty."""
    try:
        from mujoco.sysid import optimize  # noqa: PLC0415
    except ImportError:
        return False
    return callable(optimize)


def fitted(task: Task) -> Array:
    """Return the fitted values of `QUANTITIES`, (11,)."""
    from mujoco import sysid  # noqa: PLC0415

    values = neutral(task)
    for part in PARTS:
        board = Board(task, [_head(one, part) for one in task.begun])
        parameters = board.parameters(values)
        # At a bound, where a neutral delay is, an optimisation can stall.
        parameters.move_off_bounds(_OFF_BOUND)
        residual = board.residual(robust_size(board.errors(parameters.as_vector() * board.units)))
        # The optimiser prints each iteration, and `optimize` has no option to silence it.
        with redirect_stdout(io.StringIO()):
            parameters, _ = sysid.optimize(
                parameters,
                residual,
                optimizer="mujoco",
                verbose=False,
                max_iters=ITERATIONS,
                eps=STEP,
                mu_factor=_GROWTH,
            )
        values = parameters.as_vector() * board.units
    return values


def _head(recording: Recording, part: float) -> Recording:
    """Return a part of a recording from row 0, of four rows at least."""
    rows = slice(0, max(LEAD_ROWS, round(part * len(recording.knobs))))
    stamps = None if recording.stamps is None else recording.stamps[rows]
    return Recording(recording.name, recording.path, recording.knobs[rows], recording.marble[rows], stamps)


def neutral(task: Task) -> Array:
    """Return the values (11,) that are the base model's."""
    base = dict(zip(PARAMETERS, task.base.values.tolist(), strict=True))
    known = {
        "gain_x": base["gear_x"],
        "gain_y": base["gear_y"],
        "rolling_friction": base["rolling_friction"],
        "scale": base["observation_scale"],
    }
    return np.array([known.get(one.name, 0.0) for one in QUANTITIES])


class Board:
    """The MuJoCo model of a rig with recordings, for sysid."""

    def __init__(self, task: Task, recordings: Sequence[Recording]) -> None:
        import mujoco  # noqa: PLC0415
        from mujoco import sysid  # noqa: PLC0415

        self._sysid, self.units = sysid, units(task)
        self._modifiers = _modifiers(self.units)
        self._radii_per_edge = task.rig.board.edge_x_m / task.rig.marble.radius_m
        self._sequences = []
        for one in recordings:
            row_s = task.row_s(one)
            spec = mujoco.MjSpec.from_string(_xml(task.rig, row_s / STEPS))
            model = spec.compile()
            state = task.start(one)
            place, speed = model.qpos0.copy(), np.zeros(model.nv)
            # As the camera shows it; the rollout corrects it by scale and offset.
            place[:2], speed[:2] = (self._radii_per_edge * part for part in (state[:2], state[2:]))
            times = np.arange(len(one.knobs)) * row_s
            signals = (sysid.TimeSeries(times, signal) for signal in (one.knobs, one.marble))
            start = sysid.create_initial_state(model, place, speed)
            self._sequences.append(sysid.ModelSequences(one.name, spec, one.name, start, *signals))

    def parameters(self, values: Array) -> Any:
        """Return values (11,) as parameters for sysid."""
        found = self._sysid.ParameterDict()
        for one, value in zip(QUANTITIES, values / self.units, strict=True):
            bounded = float(np.clip(value, one.low, one.high))
            modifier = self._modifiers.get(one.name)
            found.add(self._sysid.Parameter(one.name, bounded, one.low, one.high, modifier=modifier))
        return found

    def residual(self, size: float = 1.0) -> Any:
        """Return sysid's residual function, with a loss that is linear beyond this size [board edges]."""
        return self._sysid.build_residual_fn(
            models_sequences=self._sequences,
            custom_rollout=self._roll_out,
            modify_residual=partial(self._compare, size),
            n_threads=1,
            resample_true=False,
        )

    def paths(self, values: Array) -> list[Array]:
        """Return the path (n, 2) in each recording [board edges] for values (11,)."""
        _, predicted, _ = self.residual()(values / self.units, self.parameters(values))
        return [one[0].data for one in predicted]

    def errors(self, values: Array) -> Array:
        """Return the differences (k,) of paths from all recordings, NaN where there was no marble."""
        pairs = zip(self.paths(values), self._sequences, strict=True)
        return np.concatenate([(path - one.sensordata[0].data).ravel() for path, one in pairs])

    def _by_name(self, parameters: Any) -> dict[str, float]:
        return dict(zip(parameters.keys(), (parameters.as_vector() * self.units).tolist(), strict=True))

    def _roll_out(self, *, param_dicts: Any, control_signal: Any, initial_states: Any, **given: Any) -> Any:
        """Simulate a recording with each of the parameter sets: commands delayed, the start corrected."""
        controls, starts = [], []
        model = given["models"][0]
        for control, start, parameters in zip(control_signal, initial_states, param_dicts, strict=True):
            values = self._by_name(parameters)
            times, late = delayed(control.times, control.data, values["delay_s"], model.opt.timestep)
            controls.append(self._sysid.TimeSeries(times, late))
            # Time, positions, velocities, activations.
            place, speed = slice(1, 3), slice(1 + model.nq, 3 + model.nq)
            state = start.copy()
            state[place] = (start[place] - self._radii_per_edge * _offset(values)) / values["scale"]
            state[speed] = start[speed] / values["scale"]
            starts.append(state)
        return self._sysid.sysid_rollout(control_signal=controls, initial_states=starts, **given)

    def _compare(
        self, size: float, parameters: Any, _: Any, measured: Any, *__: Any, state: Array
    ) -> tuple[Array, Any, Any]:
        """Return the loss's residuals (n, 2), the path that the camera sees, and the measured one."""
        values = self._by_name(parameters)
        steps = len(state) // (len(measured.times) - 1)
        seen = measured.data.copy()
        seen[1:] = state[steps - 1 :: steps, 1:3] / self._radii_per_edge * values["scale"] + _offset(values)
        error = (seen - measured.data) / size
        # The optimiser squares it.
        robust = np.nan_to_num(np.sign(error) * np.sqrt(loss(error)))
        return robust, self._sysid.TimeSeries(measured.times, seen), measured


def delayed(times: Array, commands: Array, delay_s: float, step_s: float) -> tuple[Array, Array]:
    """Return commands (n, 2), each held for a row, at the starts of steps (m,), as means over steps (m, 2).

    The board is level before row 0. A mean over a step changes smoothly with the delay.
    """
    row_s = times[1] - times[0]
    steps = (np.arange((len(times) - 1) * round(row_s / step_s) + 2) - 0.5) * step_s
    held = np.concatenate([np.zeros((1, 2)), np.cumsum(commands * row_s, axis=0)])
    ends = np.append(times, times[-1] + row_s)
    turned = np.stack([np.interp(steps - delay_s, ends, held[:, axis]) for axis in range(2)], axis=1)
    return steps[1:] - 0.5 * step_s, np.diff(turned, axis=0) / step_s


def _offset(values: Mapping[str, float]) -> Array:
    return np.array([values["offset_x_edges"], values["offset_y_edges"]])


def _modifiers(sizes: Array) -> dict[str, Callable[[Any, Any], None]]:
    """Return what writes each parameter into an `MjSpec`; delay and camera are no part of it."""
    unit = dict(zip((one.name for one in QUANTITIES), sizes.tolist(), strict=True))

    def writer(write: Callable[[Any, float], None]) -> Callable[[Any, Any], None]:
        return lambda spec, parameter: write(spec, float(parameter.value[0]) * unit[parameter.name])

    def gain(spec: Any, value: float, axis: str) -> None:
        spec.actuator(f"knob_{axis}").gainprm[0] = value

    def level(spec: Any, value: float, axis: str) -> None:
        spec.actuator(f"knob_{axis}").biasprm[0] = value

    def lag(spec: Any, value: float) -> None:
        for one in spec.actuators:
            one.dynprm[0] = value

    def friction(spec: Any, value: float) -> None:
        spec.geom("board").friction[2] = value

    def damping(spec: Any, value: float) -> None:
        # One coefficient damps the way and the turn of a sphere of unit mass and radius, which rolls.
        spec.joint("marble").damping[0] = 0.7 * value

    return {
        "gain_x": writer(partial(gain, axis="x")),
        "gain_y": writer(partial(gain, axis="y")),
        "level_x_rad": writer(partial(level, axis="x")),
        "level_y_rad": writer(partial(level, axis="y")),
        "lag_s": writer(lag),
        "rolling_friction": writer(friction),
        "damping_per_s": writer(damping),
    }


def _xml(rig: Rig, step_s: float) -> str:
    """Return board, rims and marble as MJCF: lengths in marble radii, masses in marbles.

    In metres MuJoCo's least rolling friction would exceed the marble's. Stiff friction (`impratio`) with
    elliptic cones makes rolling friction Coulomb's also for a slow marble. Contacts are as stiff as MuJoCo
    allows, and rims have a damping ratio with which they throw nothing back.
    """
    contact = 2.01 * step_s
    board, radius = rig.board, rig.marble.radius_m
    half_x, half_y = 0.5 * board.edge_x_m / radius, 0.5 * board.edge_y_m / radius
    rims = "".join(
        f'<geom type="plane" size="100 100 1" pos="{x * half_x} {y * half_y} 0" zaxis="{-x} {-y} 0"'
        f' condim="3" friction="{board.wall_friction} 0 0" solref="{contact} 3"/>'
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    gravity = GRAVITY / radius
    # A tilt about x accelerates along -y, one about y along x.
    pulls = {"x": f"0 {-gravity} 0 0 0 0", "y": f"{gravity} 0 0 0 0 0"}
    actuators = "".join(
        f'<general name="knob_{axis}" joint="marble" gear="{pull}" biastype="affine" dyntype="filterexact"'
        ' dynprm="0" actearly="true"/>'
        for axis, pull in pulls.items()
    )
    return f"""
    <mujoco>
      <option timestep="{step_s}" gravity="0 0 {-gravity}" integrator="implicitfast" cone="elliptic"
        impratio="1000" iterations="20" tolerance="1e-8"/>
      <default>
        <geom contype="1" conaffinity="2" solref="{contact} 1" solimp="0.99 0.99 0.001"/>
      </default>
      <worldbody>
        <geom name="board" type="plane" size="100 100 1" condim="6"
          friction="{board.sliding_friction} {board.spinning_friction} 0"/>
        {rims}
        <body pos="0 0 1">
          <freejoint name="marble"/>
          <geom type="sphere" size="1" mass="1" contype="2" conaffinity="1" priority="-1"/>
        </body>
      </worldbody>
      <actuator>{actuators}</actuator>
      <sensor><user name="camera" dim="2"/></sensor>
    </mujoco>"""
