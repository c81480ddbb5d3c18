"""`mujoco.sysid`, MuJoCo's own system identification, over MuJoCo's rollouts.

Its optimiser, parameters and residuals are used unchanged. Two of its hooks add the labyrinth: a rollout that
turns gravity with the knobs, and a residual in board edges.
"""

from __future__ import annotations

import io
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from typing import Any

import mujoco
import numpy as np
from mujoco.sysid import (
    ModelSequences,
    Parameter,
    ParameterDict,
    SystemTrajectory,
    TimeSeries,
    build_residual_fn,
    optimize,
)

from irt.rig import PARAMETERS
from peers.fit_task import HIGH, LOW, NOISE, RECORDINGS, ROWS, Trace
from peers.mujoco_engine import Simulations, model_xml, resting
from peers.workload import SUBSTEPS_PER_S, Array

THREADS, ITERATIONS = 2, 30
TIME_SCALE = 3


def fit(trace: Trace, start: Array, seed: int) -> None:
    """Fit with sysid's default optimiser."""
    del seed
    parameters = ParameterDict()
    for name, value, low, high in zip(PARAMETERS, start, LOW, HIGH, strict=True):
        parameters.add(Parameter(name, value, low, high))
    # The optimiser prints each iteration, and `optimize` has no option to silence it.
    with ThreadPoolExecutor(THREADS) as pool, redirect_stdout(io.StringIO()):
        residuals = _Residuals(trace, pool)
        optimize(
            parameters, residuals, optimizer="mujoco", verbose=False, max_iters=ITERATIONS, x_scale=HIGH - LOW
        )


class _Residuals:
    """sysid's residuals over all recordings, which reports every prediction to the trace."""

    def __init__(self, trace: Trace, pool: ThreadPoolExecutor) -> None:
        self._trace, self._pool, self._simulations = trace, pool, Simulations()
        spec = spec_with_knobs_and_camera()
        self._model = spec.compile()
        self._predicted: list[Array] = []
        times = np.arange(ROWS, dtype=float)
        runs = range(RECORDINGS)
        sequences = ModelSequences(
            "labyrinth",
            spec,
            [f"run-{run}" for run in runs],
            [resting(self._model)[0] for _ in runs],
            [TimeSeries(times, commands) for commands in trace.task.commands],
            [TimeSeries(times, marble) for marble in trace.task.observed],
        )
        self._residual = build_residual_fn(
            models_sequences=[sequences],
            build_model=lambda _parameters, _spec: self._model,
            custom_rollout=self._roll_out,
            modify_residual=self._compare,
            n_threads=THREADS,
            resample_true=False,
        )

    def __call__(self, x: Array, parameters: Any) -> Any:
        self._predicted.clear()
        found = self._residual(x, parameters)
        many = 1 if x.ndim == 1 else x.shape[1]
        runs = np.array(self._predicted).reshape(RECORDINGS, many, ROWS, 2)
        self._trace.note(np.moveaxis(runs, 0, 1))
        return found

    def _roll_out(self, *, control_signal: Any, initial_states: Any, param_dicts: Any, **_: Any) -> list[Any]:
        """Simulate one recording with each of the parameter sets."""
        points = [parameters.as_vector() for parameters in param_dicts]
        # The same number of physics steps at all points of a difference.
        count = max(1, round(float(points[0][TIME_SCALE])))
        paths = list(self._pool.map(self._one, points, control_signal, [count] * len(points)))
        self._predicted += paths
        times = control_signal[0].times
        state = np.zeros((ROWS, 1 + self._model.nq + self._model.nv))
        state[:, 0] = times
        return [
            SystemTrajectory(
                self._model,
                control,
                TimeSeries(times, path),
                start,
                TimeSeries(times, state),
            )
            for control, path, start in zip(control_signal, paths, initial_states, strict=True)
        ]

    def _one(self, point: Array, control: Any, count: int) -> Array:
        simulation = self._simulations.one
        simulation.model.opt.timestep = point[TIME_SCALE] / SUBSTEPS_PER_S / count
        return simulation.run(point, control.data, count)

    @staticmethod
    def _compare(
        _parameters: Any, predicted: Any, measured: Any, _model: Any, _all: bool, **_: Any
    ) -> tuple[Array, Any, Any]:
        return (predicted.data - measured.data) / NOISE, predicted, measured


def spec_with_knobs_and_camera() -> mujoco.MjSpec:
    """Return the labyrinth for sysid: knobs as inputs, a camera as sensor."""
    spec = mujoco.MjSpec.from_string(model_xml())
    (joint,) = spec.joints
    for name in ("knob_x", "knob_y"):
        spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name)
    spec.add_sensor(name="camera", type=mujoco.mjtSensor.mjSENS_USER, dim=2)
    return spec
