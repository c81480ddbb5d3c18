"""The drive of a tuning network: commands, time base, start states, board, ranges and engine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.engine import Engine, TimeStep, paper_drive, rollouts
from irt.fitting.least_squares import stamped_time_scale
from irt.rig import PARAMETERS, RANGES, Board, Marble, Rig, Start
from irt.segments import Segment

Array = NDArray[np.float64]

#: Target number of inputs of a joint observation (200 for the paper's network), and minimum number of inputs
#: along time in each run, from which a line may be removed.
INPUTS, INPUTS_PER_RUN = 400, 3
#: Largest distance of the start from the centre for the paper's drive [board edges].
CENTRED = 0.02
#: Largest damping of the marble for the paper's network [1/s]; PyBullet's default is 0.04.
LITTLE_DAMPING = 0.1
#: Rounding of commands in a CSV with four digits [rad].
SAME_KNOB = 1e-4

_TIME_SCALE = PARAMETERS.index("time_scale")


@dataclass(frozen=True, eq=False)
class Run:
    """Commands for one simulation, and its start state.

    Attributes
    ----------
    knobs : (n, 2) array
        Knob angles [rad].
    durations : (n,) array or None
        Duration of each command [s], if the recording is stamped.
    start : (2,) array
        Position at row 0 [board edges].
    start_velocity : (2,) array
        Velocity at row 0 [board edges/s]. Without stamps only displacements per row are measured; they are
        converted with a time scale in the middle of its range.
    """

    knobs: Array
    durations: Array | None
    start: Array
    start_velocity: Array


@dataclass(frozen=True, eq=False)
class Drive:
    """Everything that determines a network's inputs, except the five parameters.

    Attributes
    ----------
    runs : tuple of Run
        Simulated one by one; their observations are concatenated.
    board, marble : Board, Marble
        Sizes from direct measurements.
    ranges : dict
        Lowest and highest value of each parameter; they are scaled to [0, 1] by it (paper, section 5.3).
    start : {"rest", "moving"}
        If marbles start in motion, their start states are guesses. Therefore a straight line through the rows
        of a run is removed from every observation.
    engine : {"rolling", "rapier"}
        The simulator.
    time_scale : float or None
        The time scale from the stamps, if any; then it is not estimated.
    rows_per_input : int
        Number of rows that are averaged into one input of the network.
    """

    runs: tuple[Run, ...]
    board: Board
    marble: Marble
    ranges: dict[str, tuple[float, float]]
    start: Start
    engine: Engine
    time_scale: float | None = None
    rows_per_input: int = 1

    @classmethod
    def paper(cls, *, engine: Engine = "rolling", literal: bool = False) -> Drive:
        """Return the drive of the paper: 100 rows from rest in the centre (Eq. 3; see `paper_drive`)."""
        run = Run(paper_drive(literal=literal), None, np.zeros(2), np.zeros(2))
        return cls((run,), Board(), Marble(), dict(RANGES), "rest", engine)

    @classmethod
    def of_segments(cls, rig: Rig, segments: Sequence[Segment], engine: Engine = "rolling") -> Drive:
        """Return the joint drive of all segments of a rig: one network sees them at once."""
        runs = tuple(Run(s.knobs, s.durations, s.start, s.start_velocity) for s in segments)
        rows = [len(run.knobs) for run in runs]
        thinned = min(-(-2 * sum(rows) // INPUTS), int(np.median(rows)) // INPUTS_PER_RUN)
        return cls(
            runs,
            rig.board,
            rig.marble,
            dict(rig.ranges),
            rig.start,
            engine,
            stamped_time_scale(rig),
            rows_per_input=max(1, thinned),
        )

    @cached_property
    def open(self) -> NDArray[np.bool_]:
        """Free parameters of the five, (5,); time_scale is not free with stamps."""
        is_open = self._low < self._high
        is_open[_TIME_SCALE] &= self.time_scale is None
        return is_open

    def scaled(self, parameters: Array) -> Array:
        """Return (..., 5) parameters scaled to [0, 1], 0 for held ones."""
        width = np.where(self.open, self._high - self._low, 1.0)
        return np.where(self.open, (parameters - self._low) / width, 0.0)

    def parameters(self, scaled: Array) -> Array:
        """Return the (..., 5) parameters in their own units."""
        values = self._low + np.where(self.open, scaled, 0.0) * (self._high - self._low)
        if self.time_scale is not None:
            values[..., _TIME_SCALE] = self.time_scale
        return values

    @property
    def room(self) -> Array:
        """Largest distance of the marble from the centre along each axis, (2,) [board edges]."""
        half = np.array([self.board.edge_x_m, self.board.edge_y_m]) / 2.0
        room: Array = (half - self.marble.radius_m) / self.board.edge_x_m
        return room

    def simulate(
        self,
        parameters: Array,
        threads: int | None = None,
        *,
        effects: Sequence[Mapping[str, Any]] = (),
        time_step: TimeStep = "rounded",
    ) -> list[Array]:
        """Simulate every run with each of (k, 5) parameters in their own units.

        Effects are as `irt.rollouts` takes them, their parameters (k,) arrays.

        Returns
        -------
        list of (k, n, 2) arrays
            Observations of each run [board edges], with ``round(time_scale)`` physics updates a row as in the
            paper unless the time step is continuous.
        """
        observed: dict[int, Array] = {}
        for indices in self._batches:
            batch = [self.runs[i] for i in indices]
            stamps = [run.durations for run in batch if run.durations is not None]
            # All runs of one length, each with every set of parameters, in one call.
            every = np.repeat(parameters, len(batch), axis=0)
            start, velocity = (
                np.tile([getattr(run, name) for run in batch], (len(parameters), 1))
                for name in ("start", "start_velocity")
            )
            result = rollouts(
                every,
                np.tile([run.knobs for run in batch], (len(parameters), 1, 1)),
                rig=self,
                engine=self.engine,
                start=start,
                start_velocity=velocity * (1.0 if stamps else self._rate(every)),
                durations=np.tile(stamps, (len(parameters), 1)) if stamps else None,
                effects=[_repeated(one, len(batch)) for one in effects],
                time_step=time_step,
                threads=threads,
            )
            result = result.reshape(len(parameters), len(batch), *result.shape[1:])
            observed.update(zip(indices, result.swapaxes(0, 1), strict=True))
        return [observed[i] for i in range(len(self.runs))]

    def residual(self, difference: Sequence[Array]) -> list[Array]:
        """Return (..., n, 2) differences of observations, without the line of unknown start states."""
        if self.start == "rest":
            return list(difference)
        return [
            values - line @ (np.linalg.pinv(line) @ values)
            for values, line in zip(difference, self._lines, strict=True)
        ]

    def inputs(self, observed: Sequence[Array]) -> Array:
        """Return what the network sees of the (k, n, 2) observations of each run: (k, inputs)."""
        averaged = [
            np.add.reduceat(values, firsts, axis=-2) / np.diff(firsts, append=values.shape[-2])[:, None]
            for values in self.residual(observed)
            for firsts in [np.arange(0, values.shape[-2], self.rows_per_input)]
        ]
        return np.concatenate([values.reshape(len(values), -1) for values in averaged], axis=1)

    @property
    def input_count(self) -> int:
        """Number of inputs of the network for one observation."""
        return sum(2 * -(-len(run.knobs) // self.rows_per_input) for run in self.runs)

    @cached_property
    def digest(self) -> str:
        """Hash (SHA-256) of everything above: the name of the drive that a network file carries."""
        sha = hashlib.sha256()
        board = asdict(self.board)
        # Networks of releases without this setting have the default.
        for name in ("sliding_friction", "spinning_friction"):
            if board[name] == getattr(Board, name):
                del board[name]
        about = {
            "board": board,
            "marble": asdict(self.marble),
            "ranges": {name: list(self.ranges[name]) for name in PARAMETERS},
            "start": self.start,
            "engine": self.engine,
            "time_scale": self.time_scale,
            "rows_per_input": self.rows_per_input,
        }
        sha.update(json.dumps(about, sort_keys=True).encode())
        for run in self.runs:
            for array in (run.knobs, run.durations, run.start, run.start_velocity):
                # Rounded, because the last bits of a sine differ from one machine to another.
                rounded = np.round(np.zeros(0) if array is None else array, 9).astype("<f8") + 0.0
                sha.update(f"{rounded.shape}".encode() + rounded.tobytes())
        return sha.hexdigest()

    @cached_property
    def _batches(self) -> list[list[int]]:
        """Indices of the runs that one call can simulate: equal length, all stamped or none."""
        batches: dict[tuple[int, bool], list[int]] = {}
        for i, run in enumerate(self.runs):
            batches.setdefault((len(run.knobs), run.durations is None), []).append(i)
        return list(batches.values())

    @cached_property
    def _lines(self) -> list[Array]:
        """Offset and rate over the rows of each run, (n, 2)."""
        return [
            np.stack([np.ones(len(run.knobs)), _times(run)], axis=1) / len(run.knobs) for run in self.runs
        ]

    @property
    def _low(self) -> Array:
        return np.array([self.ranges[name][0] for name in PARAMETERS])

    @property
    def _high(self) -> Array:
        return np.array([self.ranges[name][1] for name in PARAMETERS])

    def _rate(self, parameters: Array) -> Array:
        """Return seconds of the middle time scale per second of each of (k, 5) parameters, (k, 1)."""
        middle = sum(self.ranges["time_scale"]) / 2.0
        return middle / np.maximum(np.rint(parameters[:, _TIME_SCALE, None]), 1.0)


def is_paper_drive(rig: Rig, *, literal: bool = False) -> bool:
    """Return whether all recordings of a rig have the paper's drive and the paper's board.

    The motion does not depend on the mass, and a small damping acts on both observations that a network
    compares. Therefore a network for the paper's marble is valid for these rigs too.
    """
    paper = Drive.paper(literal=literal)
    knobs = paper.runs[0].knobs
    return (
        (rig.board, rig.start) == (paper.board, paper.start)
        and rig.marble.radius_m == paper.marble.radius_m
        and rig.marble.damping_per_s <= LITTLE_DAMPING
        and all(tuple(rig.ranges[name]) == paper.ranges[name] for name in PARAMETERS)
        and all(
            recording.stamps is None
            and recording.knobs.shape == knobs.shape
            and bool(np.abs(recording.knobs - knobs).max() < SAME_KNOB)
            and bool(np.abs(recording.marble[0]).max() < CENTRED)
            for recording in rig.recordings
        )
    )


def _repeated(effect: Mapping[str, Any], times: int) -> dict[str, Any]:
    """Return an effect whose arrays repeat each value."""
    return {key: value if key == "name" else np.repeat(value, times) for key, value in effect.items()}


def _times(run: Run) -> Array:
    """Return the time of each row of a run, in rows."""
    if run.durations is None:
        return np.arange(len(run.knobs), dtype=np.float64)
    return np.append(0.0, np.cumsum(run.durations[:-1])) / float(np.mean(run.durations))
