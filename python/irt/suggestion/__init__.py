"""Design the next run to record: separate hypotheses, then sharpen their parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from irt import arguments, display
from irt.engine import SUBSTEP_S
from irt.errors import IrtError
from irt.files import PathLike
from irt.fitting.fit import Progress
from irt.fitting.least_squares import stamped_time_scale
from irt.fitting.problem import tracker_noise
from irt.model import Model
from irt.recording import KNOBS, save_recording
from irt.rig import Rig, as_rig
from irt.segments import segments
from irt.suggestion.criterion import Criterion
from irt.suggestion.excitations import Excitation, Limits, as_recorded
from irt.suggestion.hypothesis import Hypothesis
from irt.suggestion.search import Found, Search
from irt.suggestion.separation import Separation
from irt.suggestion.words import sentences

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Suggestion:
    """A run to record next.

    Attributes
    ----------
    commands : (n, 2) array
        Knob angles [rad].
    start : (2,) array
        Position of the resting marble at row 0 [board edges].
    stamps : (n,) array or None
        Time of each row [s]; None if the rig's recordings have no stamps.
    family : str
        Kind of excitation, in words.
    separation : tuple of Separation
        One for each pair of models.
    information, random_information : float
        Mutual information between the run and the true model [nats], and the same for a run like those
        recorded.
    doubt : float
        Entropy of the models' probabilities, the upper bound of `information` [nats].
    gain, random_gain : float
        Information gain on the first model's parameters [nats], and the same for a run like those recorded.
    remaining : dict
        Ratio of each parameter interval of the first model after the run to that before it.
    at_wall : float
        Expected share of rows with the marble at a wall.
    tried : int
        Number of excitations compared.
    sentences : tuple of str
        What to record and why, in sentences.
    columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
        Names of the columns of the commands.
    """

    commands: Array
    start: Array
    stamps: Array | None
    family: str
    separation: tuple[Separation, ...]
    information: float
    random_information: float
    doubt: float
    gain: float
    random_gain: float
    remaining: dict[str, float]
    at_wall: float
    tried: int
    sentences: tuple[str, ...]
    columns: tuple[str, str] = KNOBS

    def plot(self) -> Figure:
        """Draw the commands over time; return a matplotlib figure."""
        from irt import pictures  # noqa: PLC0415

        rows = np.arange(len(self.commands), dtype=np.float64)
        times, unit = (rows, "row") if self.stamps is None else (self.stamps - self.stamps[0], "time  [s]")
        panels = {
            f"command {axis}": [pictures.Line("", self.commands[:, index], pictures.COLOURS[index])]
            for index, axis in enumerate("xy")
        }
        return pictures.over_time(times, unit, panels)

    def _repr_html_(self) -> str:
        return display.page("The next run to record", display.items(self.sentences))

    def save(self, path: PathLike) -> None:
        """Write the commands as a CSV file ready to play, with the marble's start in row 0.

        Raises
        ------
        IrtError
            If the file cannot be written.
        """
        marble = np.full_like(self.commands, np.nan)
        marble[0] = self.start
        save_recording(path, self.commands, marble, self.stamps, columns=self.columns)


@arguments.entry
def suggest(
    rig: Rig | PathLike,
    models: Model | Sequence[Model],
    noise: float | None = None,
    *,
    probabilities: Sequence[float] | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Suggestion:
    """Design the run that best separates models, and then sharpens their parameters.

    Parameters
    ----------
    rig : Rig or path
        The recordings set the limits of the knobs, the length and the start of the run, and how well the
        models' parameters are known.
    models : Model or sequence of Model
        The plausible models, such as `plausible` of a diagnosis; for a single model its parameters are
        sharpened.
    noise : float, optional
        The tracker's standard deviation [board edges]; by default that of the recordings.
    probabilities : sequence of float, optional
        Probability of each model; by default all are equal.
    seed : int
        Random seed. The same seed gives the same bits for any number of threads.
    threads : int, optional
        Threads of the engine; by default one per core.
    progress : callable, optional
        Called with (done, total, text).

    Raises
    ------
    IrtError
        If there is no model, the noise is not positive, `probabilities` has the wrong length or values, or no
        recording moves a knob.
    """
    rig = as_rig(rig).on_bare_board().of_marbles()
    models = arguments.listed("models", [models] if isinstance(models, Model) else models, Model)
    if not models:
        raise IrtError("models: expected at least one")
    arguments.whole("seed", seed)
    arguments.threads(threads)
    arguments.progress(progress)
    noise = tracker_noise(segments(rig)) if noise is None else arguments.number("noise", noise)
    if not 0.0 < noise < math.inf:
        raise IrtError(f"noise: expected a standard deviation above 0 [board edges], got {noise}")
    chances = _probabilities(probabilities, len(models))
    stamped = stamped_time_scale(rig)
    limits = Limits.of(rig, None if stamped is None else stamped * SUBSTEP_S)
    if not limits.amplitude.any():
        raise IrtError(f"{rig.path}: no recording moves a knob, so the range of the knobs is unknown")
    cut = segments(rig)
    criterion = Criterion(
        hypotheses=tuple(
            Hypothesis.of(rig, model, cut, noise, time_scale=stamped, threads=threads) for model in models
        ),
        probabilities=chances,
        noise=noise,
        time_scale=stamped,
        threads=threads,
    )
    recorded = as_recorded(rig, limits)
    found = Search(criterion, rig, limits, seed, progress).run(recorded)
    return replace(_suggestion(criterion, limits, found, recorded), columns=rig.recordings[0].columns)


def _probabilities(probabilities: Sequence[float] | None, count: int) -> Array:
    """Return normalised probabilities of the models."""
    chances = np.ones(count) if probabilities is None else np.asarray(probabilities, dtype=np.float64)
    if chances.shape != (count,) or not (np.isfinite(chances) & (chances > 0.0)).all():
        raise IrtError(f"probabilities: expected {count} numbers above 0, one for each model")
    return np.asarray(chances / chances.sum())


def _suggestion(
    criterion: Criterion, limits: Limits, found: Found, recorded: Sequence[Excitation]
) -> Suggestion:
    """Return the suggestion for the best run, compared with runs like those recorded."""
    run, hypotheses = found.best, criterion.hypotheses
    best, random = criterion.worth([run]), criterion.worth(recorded)
    separation = tuple(
        Separation(
            first=hypotheses[a].effects,
            second=hypotheses[b].effects,
            distance=float(best.distance[0, index]),
            nats=float(best.nats[0, index]),
            random_distance=float(random.distance[:, index].mean()),
            random_nats=float(random.nats[:, index].mean()),
            most_nats=float(found.most_nats[index]),
            alike=bool(found.alike[index]),
        )
        for index, (a, b) in enumerate(criterion.pairs)
    )
    chances = criterion.probabilities
    expected, random_expected = (
        float(one.information(chances, found.alike).mean()) for one in (best, random)
    )
    doubt = float(-(chances * np.log(chances)).sum())
    gain, random_gain = float(best.gain[0, 0]), float(random.gain[:, 0].mean())
    unknown = np.abs(hypotheses[0].deviations).max(axis=0) > 0.0
    remaining = {
        name: share
        for name, share, free in zip(hypotheses[0].names, best.remaining[0].tolist(), unknown, strict=True)
        if free
    }
    at_wall = float(best.at_wall[0])
    return Suggestion(
        commands=run.commands,
        start=run.start,
        stamps=criterion.stamps(limits.rows),
        family=run.family,
        separation=separation,
        information=expected,
        random_information=random_expected,
        doubt=doubt,
        gain=gain,
        random_gain=random_gain,
        remaining=remaining,
        at_wall=at_wall,
        tried=found.tried,
        sentences=sentences(
            run,
            limits,
            separation=separation,
            tried=found.tried,
            information=(expected, random_expected, doubt),
            gains=(gain, random_gain),
            remaining=remaining,
            at_wall=at_wall,
        ),
    )
