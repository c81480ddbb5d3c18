"""Baseline: a small network for the residual push in the base model, trained through its rollouts.

The network has two hidden layers, and its inputs are state and commands, those of four earlier rows included.
It is not trained on differences of noisy positions, but on complete recordings: the loss is that of the path,
and its gradient goes back through all rows. The loss is linear for large errors, because trackers have
outliers and paths diverge. Each of four networks is trained without a quarter of the recordings, and stops
where it predicts these best; this may be at the base model, from which it starts. The mean of the four is
used. It has no names to give.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from irt.model import Model
from irt.proof.baselines.entry import Entry, Task, by_name
from irt.proof.baselines.residual_push import Push, histories, stepped
from irt.proof.baselines.robust import loss, robust_size, slope
from irt.proof.baselines.smooth import WINDOW, smooth
from irt.recording import Recording
from irt.residual import predict
from irt.segments import Segment

Array = NDArray[np.float64]

TITLE = "neural network on the residual"
HIDDEN, MEMBERS = 16, 4
#: Earlier rows whose commands are inputs; delays and lags of actuators are rarely longer.
PAST = 4
#: Rows of the windows in which training begins: there errors are small, and paths do not diverge.
WINDOW_ROWS = 20
#: Most iterations of L-BFGS in windows and from end to end, and those without a better held-out error after
#: which it stops.
WINDOWED, ENTIRE, PATIENCE = 60, 30, 15
#: Distance from the rim at which a marble touches it [board edges].
_TOUCH = 1e-6
#: Penalty on the mean squared weight.
DECAY = 1e-3
SEED = 0


@dataclass(frozen=True, eq=False)
class Network:
    """A network of two hidden layers with hyperbolic tangents.

    Attributes
    ----------
    layers : tuple of (f, h) and (h,) arrays
        Weights and offsets of each layer.
    middle, spread : (f,) arrays
        Mean and standard deviation of the inputs.
    size : float
        Unit of the outputs [edges/s^2].
    """

    layers: tuple[Array, ...]
    middle: Array
    spread: Array
    size: float

    @classmethod
    def started(cls, inputs: Array, size: float, random: np.random.Generator) -> Network:
        """Return a network that is zero everywhere, for inputs like (k, f) ones."""
        wide = [inputs.shape[1], HIDDEN, HIDDEN, 2]
        layers: list[Array] = []
        for before, after in pairwise(wide):
            layers += [random.standard_normal((before, after)) / np.sqrt(before), np.zeros(after)]
        layers[-2] = np.zeros_like(layers[-2])
        spread = inputs.std(axis=0)
        return cls(tuple(layers), inputs.mean(axis=0), np.where(spread > 0.0, spread, 1.0), size)

    @property
    def weights(self) -> Array:
        """All weights, (p,)."""
        return np.concatenate([one.ravel() for one in self.layers])

    def with_weights(self, weights: Array) -> Network:
        """Return the network with other weights (p,)."""
        ends = np.cumsum([one.size for one in self.layers])[:-1]
        parts = zip(np.split(weights, ends), self.layers, strict=True)
        layers = tuple(part.reshape(one.shape) for part, one in parts)
        return Network(layers, self.middle, self.spread, self.size)

    def push(self, inputs: Array, tape: list[tuple[Array, ...]] | None = None) -> Array:
        """Return outputs (w, 2) for inputs (w, f); a tape keeps what `backward` needs."""
        first, one, second, two, third, three = self.layers
        given = (inputs - self.middle) / self.spread
        low = np.tanh(given @ first + one)
        high = np.tanh(low @ second + two)
        if tape is not None:
            tape.append((given, low, high))
        return np.asarray(self.size * (high @ third + three))

    def backward(self, kept: tuple[Array, ...], slope: Array) -> tuple[Array, list[Array]]:
        """Return derivatives by the inputs (w, f) and by `layers`, for those by the outputs (w, 2)."""
        given, low, high = kept
        first, _, second, _, third, _ = self.layers
        out = self.size * slope
        upper = (out @ third.T) * (1.0 - high**2)
        lower = (upper @ second.T) * (1.0 - low**2)
        pairs = ((given, lower), (low, upper), (high, out))
        layers = [part for before, after in pairs for part in (before.T @ after, after.sum(axis=0))]
        return (lower @ first.T) / self.spread, layers


@dataclass(frozen=True, eq=False)
class Batch:
    """Parts of recordings of n rows, and the base model's free runs from their starts.

    Attributes
    ----------
    model : Model
        The base model.
    starts : (w, 4) array
        States in row 0.
    base, marble : (w, n, 2) arrays
        Free runs of the base model and observed positions, NaN where there are none.
    signals : (w, n, 2) and (w, n, c) arrays
        Commands, and those with their histories.
    row_s : float
        Duration of a row [s].
    """

    model: Model
    starts: Array
    base: Array
    marble: Array
    signals: tuple[Array, Array]
    row_s: float

    @classmethod
    def of(cls, task: Task, parts: Sequence[Segment]) -> Batch:
        """Return segments of recordings; short ones go on as they end, unobserved."""
        rows = max(len(one.knobs) for one in parts)

        def padded(signals: Iterable[Array], value: float | None = None) -> Array:
            ends = ((one, rows - len(one)) for one in signals)
            return np.array(
                [np.concatenate([one, np.repeat(_end(one, value), more, 0)]) for one, more in ends]
            )

        return cls(
            task.base,
            np.array([[*one.start, *one.start_velocity] for one in parts]),
            padded(predict(task.base, parts)),
            padded((one.observed for one in parts), np.nan),
            (
                padded(one.knobs for one in parts),
                padded(histories(one.run.knobs, PAST)[one.rows] for one in parts),
            ),
            float(np.median([task.row_s(one.run) for one in parts])),
        )

    @classmethod
    def whole(cls, task: Task, recordings: Sequence[Recording]) -> Batch:
        """Return complete recordings."""
        return cls.of(task, [_segment(one, slice(0, len(one.knobs)), task.start(one)) for one in recordings])

    @classmethod
    def windows(cls, task: Task, recordings: Sequence[Recording]) -> Batch | None:
        """Return windows of `WINDOW_ROWS` from smoothed states; None if no recording has one."""
        parts = []
        for one in recordings:
            if len(one.knobs) < max(WINDOW, WINDOW_ROWS):
                continue
            states = smooth(one, task.row_s(one)).states
            firsts = range(0, len(one.knobs) - WINDOW_ROWS + 1, WINDOW_ROWS // 2)
            parts += [_segment(one, slice(first, first + WINDOW_ROWS), states[first]) for first in firsts]
        return cls.of(task, parts) if parts else None

    @cached_property
    def correction(self) -> Array:
        """Free runs minus runs row by row, which lose a little at walls, (w, n, 2)."""
        return self.base - self._stepped(lambda inputs: np.zeros((len(inputs), 2)))

    @property
    def acceleration(self) -> float:
        """Root mean square acceleration of the base paths [edges/s^2]."""
        velocity = np.gradient(self.base, self.row_s, axis=1)
        return float(np.sqrt(np.mean(np.gradient(velocity, self.row_s, axis=1) ** 2)))

    def inputs(self) -> Array:
        """Return the inputs (k, f) along the base paths."""
        every = (self.base, np.gradient(self.base, self.row_s, axis=1), self.signals[1])
        return np.concatenate([one.reshape(-1, one.shape[2]) for one in every], axis=1)

    def paths(self, push: Push) -> Array:
        """Return the paths (w, n, 2) with a residual acceleration; without one, those of the base model."""
        return self._stepped(push) + self.correction

    def _stepped(self, push: Push) -> Array:
        return stepped(push, self.model, self.starts, self.signals, self.row_s)

    def error(self, network: Network, size: float) -> float:
        """Return the mean loss of paths, linear for errors beyond a size [board edges]."""
        return float(np.nanmean(loss((self.paths(network.push) - self.marble) / size)))

    def gradient(self, network: Network, size: float) -> tuple[float, Array]:
        """Return the mean loss and its derivatives by the network's weights (p,).

        The base model passes displacements and velocities on as in free motion; its friction is constant.
        """
        tape: list[tuple[Array, ...]] = []
        path = self.paths(partial(network.push, tape=tape))
        errors = (path - self.marble) / size
        slopes = np.nan_to_num(slope(errors)) / (size * np.isfinite(errors).sum())
        total = [np.zeros_like(one) for one in network.layers]
        stopped = np.abs(path - self.correction) >= self.model.reach - _TOUCH
        # Derivatives by position and velocity in a row. A rim that stops the marble ends what came before.
        place, speed = slopes[:, -1], np.zeros_like(slopes[:, -1])
        for row in range(path.shape[1] - 2, -1, -1):
            free = ~stopped[:, row + 1]
            place, speed = place * free, speed * free
            pushed = 0.5 * self.row_s**2 * place + self.row_s * speed
            inputs, layers = network.backward(tape[row], pushed)
            total = [so_far + part for so_far, part in zip(total, layers, strict=True)]
            speed = speed + self.row_s * place + inputs[:, 2:4]
            place = place + inputs[:, :2] + slopes[:, row]
        return float(np.nanmean(loss(errors))), np.concatenate([one.ravel() for one in total])


def _end(signal: Array, value: float | None) -> Array:
    return signal[-1:] if value is None else np.full_like(signal[-1:], value)


def _segment(recording: Recording, rows: slice, state: Array) -> Segment:
    return Segment(recording, rows, state[:2], state[2:])


def enter(task: Task) -> Entry:
    """Train the networks and predict with their mean; name nothing."""
    recordings = task.begun
    if len(recordings) < 2:
        return Entry(missing="fewer than two recordings have a marble in row 0")
    members = min(MEMBERS, len(recordings))
    networks = [
        trained(
            task,
            [recording for i, recording in enumerate(recordings) if i % members != one],
            recordings[one::members],
            one,
        )
        for one in range(members)
    ]

    def push(inputs: Array) -> Array:
        return np.asarray(np.mean([one.push(inputs) for one in networks], axis=0))

    paths = [Batch.whole(task, [test]).paths(push)[0] for test in task.tests]
    return Entry(predictions=dict(by_name(task.tests, paths)))


def trained(task: Task, learned: Sequence[Recording], judged: Sequence[Recording], member: int) -> Network:
    """Return a network trained on recordings, in windows and then from end to end, by the error of others."""
    from scipy.optimize import minimize  # noqa: PLC0415

    whole, held = Batch.whole(task, learned), Batch.whole(task, judged)
    start = Network.started(whole.inputs(), whole.acceleration, np.random.default_rng([SEED, member]))
    size = robust_size(held.base - held.marble)
    best, least = start, held.error(start, size)
    for batch, iterations in ((Batch.windows(task, learned), WINDOWED), (whole, ENTIRE)):
        if batch is None:
            continue
        unit = robust_size(batch.base - batch.marble)
        without = 0

        def objective(weights: Array, batch: Batch = batch, unit: float = unit) -> tuple[float, Array]:
            value, slopes = batch.gradient(start.with_weights(weights), unit)
            return value + DECAY * float(np.mean(weights**2)), slopes + 2.0 * DECAY * weights / len(weights)

        def watch(weights: Array) -> None:
            nonlocal best, least, without
            network = start.with_weights(weights)
            error = held.error(network, size)
            without += 1
            if error < least:
                best, least, without = network, error, 0
            if without >= PATIENCE:
                raise StopIteration

        options = {"maxiter": iterations}
        minimize(objective, best.weights, jac=True, method="L-BFGS-B", callback=watch, options=options)
    return best
