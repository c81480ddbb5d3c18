"""The page that a tuning leaves behind: how well the simulator fits now, and how far to trust it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irt.catalogue import effect
from irt.files import PathLike, make_folder
from irt.fitting.fit import FitResult
from irt.fitting.problem import tracker_noise
from irt.model import Model
from irt.report import style
from irt.report.page import Page, Picture, add_warnings
from irt.report.plots import (
    Prediction,
    mean_absolute,
    plot_fit,
    plot_history,
    plot_parameters,
    plot_paths,
    plot_tilt,
)
from irt.report.words import UNITS, percent, versions, with_interval
from irt.residual import Evaluation, RunEvaluation, evaluate
from irt.rig import PARAMETERS, Rig
from irt.segments import segments

_METHODS = {
    "irt": "IRT",
    "irt+": "IRT+",
    "least-squares": "least squares",
    "cma-es": "CMA-ES",
    "es": "the (5+100) evolution strategy",
    "direct": "direct prediction",
}
_COLOURS = (style.TUNED, style.SECOND, style.THIRD)


@dataclass(frozen=True, eq=False)
class Contender:
    """One model on one rig.

    Attributes
    ----------
    name : str
        "untuned", or the method that tuned it.
    model : Model
        The simulator.
    evaluation : Evaluation
        How it does on the recordings it is judged by.
    colour : str
        Of its lines.
    """

    name: str
    model: Model
    evaluation: Evaluation
    colour: str

    @property
    def windowed(self) -> bool:
        """Whether windows count: a marble in motion has left its first state behind long before the end."""
        return self.model.start == "moving" and self.evaluation.windowed is not None

    @property
    def mae(self) -> float:
        """Mean absolute error over all recordings [board edges]."""
        return self._mae(self.evaluation)

    def run_mae(self, run: int) -> float:
        """Return the mean absolute error on one recording [board edges]; NaN where no window fits."""
        return self._mae(self.evaluation.runs[run])

    def prediction(self, run: int, label: str | None = None) -> Prediction:
        """Return what the model says about one of the recordings."""
        of_run = self.evaluation.runs[run]
        label = label or self.name
        if not self.windowed:
            return Prediction(label, of_run.free_prediction, self.model, self.colour)
        return Prediction(
            label, of_run.windowed_prediction, self.model, self.colour, window_rows=of_run.window_rows
        )

    def _mae(self, errors: Evaluation | RunEvaluation) -> float:
        chosen = errors.windowed if self.windowed else errors.free_run
        return math.nan if chosen is None else chosen.mae


def untuned(rig: Rig) -> Model:
    """Return the model of a rig of which nothing is known but the ranges: each parameter in the middle."""
    return Model.from_rig(rig, {name: sum(rig.ranges[name]) / 2 for name in PARAMETERS})


def write_tuning_report(
    folder: PathLike,
    rig: Rig,
    results: Sequence[FitResult],
    *,
    heldout: Rig | None = None,
    title: str,
    settings: Mapping[str, str],
    warnings: Sequence[str] = (),
) -> Path:
    """Write ``report.html`` and its pictures as SVG files into a folder, and return the page's path.

    Parameters
    ----------
    folder : path
        Made where it is missing.
    rig : Rig
        What the models were tuned to.
    results : sequence of FitResult
        One for each method; the first is the one the page is about, the others are second opinions.
    heldout : Rig, optional
        Recordings that no method saw, to judge by.
    title : str
        Heading of the page.
    settings : mapping
        What someone needs to do the same again, by name; versions are added.
    warnings : sequence of str
        What a check of the recordings warned of.

    Raises
    ------
    IrtError
        If a file cannot be written.
    """
    folder = make_folder(folder)
    shown = _contend(rig, rig, results)
    unseen = _contend(rig, heldout, results) if heldout is not None else []
    has_marble = any(recording.has_marble for recording in rig.recordings)
    if has_marble:
        answer = lead(shown, unseen, tracker_noise(segments(heldout or rig)))
    else:
        answer = (
            "No marble was seen in these recordings: what was tuned is the way from the commands to the tilt."
        )
    page = Page(title, answer)
    add_warnings(page, warnings)
    if has_marble:
        _add_fit(page, folder, rig, shown)
    if rig.has_tilt:
        _add_tilt(page, folder, heldout or rig, (unseen or shown)[1])
    if heldout is not None:
        _add_heldout(page, folder, heldout, unseen)
    _add_parameters(page, folder, results)
    if has_marble:
        _add_history(page, folder, rig, results)
    page.heading("To do the same again")
    page.facts({**settings, **versions()})
    path = folder / "report.html"
    page.write(path)
    return path


def lead(shown: Sequence[Contender], unseen: Sequence[Contender], noise: float) -> str:
    """Return the answer in two sentences: what tuning has won, and what is left.

    Parameters
    ----------
    shown : sequence of Contender
        Untuned and tuned models on the recordings they were tuned to, untuned first.
    unseen : sequence of Contender
        The same on recordings held out, or empty.
    noise : float
        Standard deviation of the tracker [board edges].
    """
    before, after = shown[:2]
    answer = (
        f"Tuning by {after.name} took the simulated marble from {percent(before.mae)} of the board's edge "
        f"off to {percent(after.mae)}, on average over the {_count(after)} it was given"
    )
    if unseen:
        before, after = unseen[:2]
        change = f"from {percent(before.mae)} to {percent(after.mae)}"
        answer += f", and {change} over {_count(after)} that it never saw"
    floor = mean_absolute(noise)
    if after.mae < 1.5 * floor:
        left = "there is little left to explain"
    else:
        left = "what is left is physics that the model lacks, or parameters that are not yet right"
    return f"{answer}. The tracker's noise alone makes {percent(floor)}: {left}."


def compare(first: Contender, second: Contender) -> str:
    """Return which of two models predicts better, in a sentence; less than 5 % apart is a draw."""
    better, worse = sorted((first, second), key=lambda contender: contender.mae)
    if worse.mae < 1.05 * better.mae:
        return (
            f"On these recordings {first.name} ({percent(first.mae)}) and {second.name} "
            f"({percent(second.mae)}) do equally well."
        )
    return (
        f"On these recordings {better.name} is ahead: {percent(better.mae)} of the edge, against "
        f"{percent(worse.mae)} of {worse.name}."
    )


def _contend(rig: Rig, judged: Rig, results: Sequence[FitResult]) -> list[Contender]:
    """Return the untuned model of a rig and the tuned ones, with their errors on the recordings judged."""
    models = [("untuned", untuned(rig), style.UNTUNED)]
    for result, colour in zip(results, _COLOURS, strict=False):
        models.append((_METHODS.get(result.method, result.method), result.model, colour))
    return [
        Contender(name, model, evaluate(model, judged.recordings), colour) for name, model, colour in models
    ]


def _add_fit(page: Page, folder: Path, rig: Rig, contenders: Sequence[Contender]) -> None:
    """Add the pictures before and after, of one recording."""
    run = next(run for run, recording in enumerate(rig.recordings) if recording.has_marble)
    recording = rig.recordings[run]
    predictions = [contenders[0].prediction(run), contenders[1].prediction(run, "tuned")]
    seen = [recording.marble, *(prediction.marble for prediction in predictions)]
    limit = 1.05 * max(float(np.nanmax(np.abs(marble))) for marble in seen)
    over_time, from_above = [], []
    for contender, prediction in zip(contenders, predictions, strict=False):
        fit, paths = folder / f"fit-{prediction.label}.svg", folder / f"paths-{prediction.label}.svg"
        plot_fit(fit, recording, [prediction], limit=limit)
        plot_paths(paths, [(recording, prediction)])
        caption = f"{prediction.label.capitalize()}: {percent(contender.run_mae(run))} of the edge off."
        over_time.append(Picture(fit, caption))
        from_above.append(Picture(paths, f"{prediction.label.capitalize()}, from above."))
    page.heading("Before and after")
    page.paragraph(
        f"{recording.name}, one of the recordings that the simulator was tuned to. Dots are what the tracker "
        f"saw, lines what the simulator predicts {_from_what(contenders[1])}. Untuned means that each "
        "parameter stands in the middle of its range. From above, the dotted line is as far as the marble's "
        "centre can go."
    )
    page.pictures(*over_time)
    page.pictures(*from_above)


def _add_tilt(page: Page, folder: Path, rig: Rig, tuned: Contender) -> None:
    """Add the tilt that the commands predict beside the measured one, of the recording where it is worst."""
    measured = [
        (recording, run.tilt_prediction, run.tilt, run.played)
        for recording, run in zip(rig.recordings, tuned.evaluation.runs, strict=True)
        if run.tilt is not None and run.tilt_prediction is not None
    ]
    if not measured:
        return
    rows = []
    for name, errors, played in (
        *((recording.name, errors, played) for recording, _, errors, played in measured),
        ("all", tuned.evaluation.tilt, tuned.evaluation.played),
    ):
        assert errors is not None, name
        angles = [
            "-" if one is None else f"{1000 * one:.2f} mrad" for one in (errors.mae_x_rad, errors.mae_y_rad)
        ]
        rows.append([name, *angles, "-" if played is None else percent(played.mae)])
    recording, predicted, _, _ = max(
        measured, key=lambda one: (one[2].mae_x_rad or 0.0) + (one[2].mae_y_rad or 0.0)
    )
    picture = folder / "tilt.svg"
    plot_tilt(picture, recording, predicted)
    page.heading("The tilt")
    page.paragraph(
        "The tilt is predicted from the commands alone. Where the measured tilt is played in their place, "
        f"windows of {tuned.evaluation.window_s:g} s show what the board and the marble leave by themselves."
    )
    page.table(
        "Mean absolute error of the tilt, and of the marble with the measured tilt played",
        ["recording", "about x", "about y", "marble, tilt played"],
        rows,
        total=True,
    )
    page.pictures(Picture(picture, f"{recording.name}, the recording with the largest error of the tilt."))


def _add_heldout(page: Page, folder: Path, heldout: Rig, contenders: Sequence[Contender]) -> None:
    """Add what the models say about recordings that they never saw."""
    tuned = contenders[1]
    stretches = segments(heldout)
    rows, pictures = [], []
    for run, recording in enumerate(heldout.recordings):
        noise = tracker_noise([segment for segment in stretches if segment.recording == recording.name])
        errors = [*(contender.run_mae(run) for contender in contenders), mean_absolute(noise)]
        rows.append([recording.name, *(percent(error) for error in errors)])
        picture = folder / f"heldout-{run + 1}.svg"
        plot_paths(picture, [(recording, tuned.prediction(run, recording.name))])
        pictures.append(Picture(picture, f"{recording.name} as {tuned.name} predicts it."))
    overall = [*(contender.mae for contender in contenders), mean_absolute(tracker_noise(stretches))]
    rows.append(["all", *(percent(error) for error in overall)])
    page.heading("Recordings held out")
    page.paragraph(
        "No tuning saw these: a model that only retraces what it was given fails here. Each error is the "
        f"mean of |x| and |y| over all rows, predicted {_from_what(tuned)}."
    )
    page.table(
        "Mean absolute error, in percent of the board's long edge",
        ["recording", *(contender.name for contender in contenders), "tracker's noise"],
        rows,
        total=True,
    )
    for other in contenders[2:]:
        page.paragraph(compare(tuned, other))
    page.pictures(*pictures)


def _from_what(contender: Contender) -> str:
    """Return what a prediction is made from, in words."""
    if contender.windowed:
        seconds = contender.evaluation.window_s
        return f"in windows of {seconds:g} s, each from the state that the rows before it tell"
    return "from the first position and the commands alone"


def _add_parameters(page: Page, folder: Path, results: Sequence[FitResult]) -> None:
    """Add the values with their intervals, and what they do not say."""
    page.heading("The parameters")
    names = [_METHODS.get(result.method, result.method) for result in results]
    ranges = results[0].model.ranges
    page.table(
        "Value and 95 % interval, given that the model's physics is right",
        ["parameter", "searched", *names],
        [
            [
                f"{name} [{UNITS[name]}]" if name in UNITS else name,
                f"{ranges[name][0]:g} to {ranges[name][1]:g}",
                *(with_interval(result.model.parameters[name]) for result in results),
            ]
            for name in PARAMETERS
        ]
        + list(_effect_rows(results)),
    )
    for title, told in (
        ("What these recordings cannot pin down:", [result.unidentifiable for result in results]),
        ("To know besides:", [result.notes for result in results]),
    ):
        if any(told):
            page.paragraph(title)
            page.bullets(_attributed(names, told))


def _effect_rows(results: Sequence[FitResult]) -> Iterator[list[str]]:
    """Yield a row for each parameter of the effects that some method fitted."""
    for name in dict.fromkeys(name for result in results for name in result.effects):
        for known in effect(name).parameters:
            fitted = [result.effects.get(name, {}).get(known.name) for result in results]
            if any(one is not None for one in fitted):
                unit = f" [{known.unit}]" if known.unit else ""
                values = ["-" if one is None else with_interval(one) for one in fitted]
                yield [f"{name}, {known.name}{unit}", known.searched, *values]


def _attributed(names: Sequence[str], told: Sequence[Sequence[str]]) -> list[str]:
    """Return what each method told, with its name where others told something else."""
    if all(sentences == told[0] for sentences in told):
        return list(told[0])
    return [
        f"{name}: {sentence}" for name, sentences in zip(names, told, strict=True) for sentence in sentences
    ]


def _add_history(page: Page, folder: Path, rig: Rig, results: Sequence[FitResult]) -> None:
    """Add how each method came to its answer."""
    page.heading("The way there")
    noise = tracker_noise(segments(rig))
    histories, evolutions = [], []
    for result in results:
        name = _METHODS.get(result.method, result.method)
        history, evolution = (
            folder / f"history-{result.method}.svg",
            folder / f"parameters-{result.method}.svg",
        )
        plot_history(history, result, noise=noise)
        plot_parameters(evolution, result)
        starts = len(result.estimates)
        histories.append(
            Picture(
                history,
                f"{name}: error on the way from {starts} start{'s' if starts != 1 else ''}; "
                f"{result.rollouts:,} simulated runs and {result.seconds:.1f} s in all.",
            )
        )
        evolutions.append(Picture(evolution, f"{name}: each parameter within the range that was searched."))
    page.pictures(*histories, *evolutions)


def _count(contender: Contender) -> str:
    """Return how many recordings a model is judged by, in words."""
    count = len(contender.evaluation.runs)
    return f"{count} recording{'s' if count != 1 else ''}"
