"""HTML report of a tuning: errors, parameters with intervals, convergence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irt import arguments
from irt.catalogue import effect
from irt.errors import IrtError
from irt.files import PathLike, make_folder
from irt.fitting.fit import FitResult
from irt.fitting.problem import in_unit_of, tracker_noise
from irt.fitting.robust import mean_absolute
from irt.methods import TITLES
from irt.model import Model
from irt.report import style
from irt.report.page import Picture, Table, write_page
from irt.report.plots import (
    Prediction,
    plot_fit,
    plot_history,
    plot_parameters,
    plot_paths,
    plot_tilt,
)
from irt.report.words import UNITS, counted, labelled, percent, plain, versions, with_interval
from irt.residual import Evaluation, RunEvaluation, evaluate
from irt.rig import PARAMETERS, Rig
from irt.segments import segments

_COLOURS = (style.TUNED, style.SECOND, style.THIRD)


@dataclass(frozen=True, eq=False)
class Contender:
    """A model and its evaluation.

    Attributes
    ----------
    name : str
        "untuned", or the tuning method.
    model : Model
        The model.
    evaluation : Evaluation
        Its errors on the recordings it is judged by.
    colour : str
        Colour of its lines.
    """

    name: str
    model: Model
    evaluation: Evaluation
    colour: str

    @property
    def windowed(self) -> bool:
        """Whether the error is that of windows, as for recordings that start in motion."""
        return self.model.start == "moving" and self.evaluation.windowed is not None

    @property
    def mae(self) -> float:
        """Mean absolute error over all recordings [board edges]."""
        return self._mae(self.evaluation)

    def run_mae(self, run: int) -> float:
        """Return the mean absolute error on one recording [board edges]; NaN if no window fits."""
        return self._mae(self.evaluation.runs[run])

    def prediction(self, run: int, label: str | None = None) -> Prediction:
        """Return the model's prediction of one of the recordings."""
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
    """Return the untuned model of a rig, each parameter in the middle of its range."""
    return Model.from_rig(rig, {name: sum(rig.ranges[name]) / 2 for name in PARAMETERS})


@arguments.entry
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
        Created if missing.
    rig : Rig
        The rig that the models were tuned to.
    results : sequence of FitResult
        One for each method; the first is the main result, the others are shown for comparison.
    heldout : Rig, optional
        Held-out recordings to evaluate on.
    title : str
        Heading of the page.
    settings : mapping
        Settings that reproduce the result, by name; versions are added.
    warnings : sequence of str
        Warnings of a check of the recordings.

    Raises
    ------
    IrtError
        If an argument has the wrong type, or a file cannot be written.
    """
    arguments.instance("rig", rig, Rig)
    results = arguments.listed("results", results, FitResult)
    if not results:
        raise IrtError("results: expected at least one irt.FitResult, got none")
    if heldout is not None:
        arguments.instance("heldout", heldout, Rig)
    arguments.text("title", title)
    arguments.mapping("settings", settings)
    arguments.listed("warnings", warnings, str, expected="a sequence of sentences")
    folder = make_folder(arguments.path("folder", folder))
    shown = _contend(rig, rig, results)
    unseen = _contend(rig, heldout, results) if heldout is not None else []
    has_marble = any(recording.has_marble for recording in rig.recordings)
    if has_marble:
        answer = lead(shown, unseen, tracker_noise(segments(heldout or rig)))
    else:
        answer = "These recordings contain no marble, so only the response of the tilt to commands was tuned."
    path = folder / "report.html"
    write_page(
        path,
        "tuning.html",
        title=title,
        lead=answer,
        warnings=warnings,
        stamped=all(recording.stamps is not None for recording in rig.recordings),
        fit=_fit(folder, rig, shown) if has_marble else None,
        tilt=_tilt(folder, heldout or rig, (unseen or shown)[1]) if rig.has_tilt else None,
        heldout=_heldout(folder, heldout, unseen) if heldout is not None else None,
        parameters=_parameters(results),
        unidentifiable=_attributed(results, [result.unidentifiable for result in results]),
        notes=_attributed(results, [result.notes for result in results]),
        history=_history(folder, rig, results) if has_marble else None,
        settings={**settings, **versions()},
    )
    return path


def lead(shown: Sequence[Contender], unseen: Sequence[Contender], noise: float) -> str:
    """Return the summary in two sentences: the reduction of the error, and whether physics is missing.

    Parameters
    ----------
    shown : sequence of Contender
        Untuned and tuned models on the recordings they were tuned to, untuned first.
    unseen : sequence of Contender
        The same on held-out recordings, or empty.
    noise : float
        Standard deviation of the tracker [board edges].
    """
    before, after = shown[:2]
    verb = "reduced" if after.mae < before.mae else "did not reduce"
    answer = f"Tuning by {after.name} {verb} the mean error on {_count(after)}: {_from_to(before, after)}"
    if unseen:
        before, after = unseen[:2]
        answer += f"; on {_count(after, 'held-out recording')}: {_from_to(before, after)}"
    floor = mean_absolute(noise)
    if after.mae < 1.5 * floor:
        verdict = "the model explains nearly all that can be explained"
    else:
        verdict = (
            "the rest comes from physics missing in the model, or from wrong parameters. Try irt diagnose"
        )
    return f"{answer}. Tracker noise alone gives {percent(floor)}: {verdict}."


def _from_to(before: Contender, after: Contender) -> str:
    return f"{percent(before.mae)} of the board's edge untuned, {percent(after.mae)} tuned"


def compare(first: Contender, second: Contender) -> str:
    """Return a sentence on which of two models predicts better; errors within 5 % count as equal."""
    better, worse = sorted((first, second), key=lambda contender: contender.mae)
    if worse.mae < 1.05 * better.mae:
        return (
            f"On these recordings {first.name} ({percent(first.mae)}) and {second.name} "
            f"({percent(second.mae)}) are equally good."
        )
    return (
        f"On these recordings {better.name} is better: {percent(better.mae)} of the edge, against "
        f"{percent(worse.mae)} for {worse.name}."
    )


def _contend(rig: Rig, judged: Rig, results: Sequence[FitResult]) -> list[Contender]:
    """Return the untuned and the tuned models of a rig, evaluated on the recordings of `judged`."""
    models = [("untuned", untuned(rig), style.UNTUNED)]
    for result, colour in zip(results, _COLOURS, strict=False):
        models.append((TITLES.get(result.method, result.method), result.model, colour))
    return [
        Contender(name, model, evaluate(model, judged.recordings), colour) for name, model, colour in models
    ]


def _fit(folder: Path, rig: Rig, contenders: Sequence[Contender]) -> dict[str, Any]:
    """Return the pictures of one recording, untuned and tuned."""
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
        caption = (
            f"{prediction.label.capitalize()}: mean error {percent(contender.run_mae(run))} of the edge."
        )
        over_time.append(Picture(fit, caption))
        from_above.append(Picture(paths, f"{prediction.label.capitalize()}, from above."))
    return {
        "recording": recording.name,
        "how": _from_what(contenders[1]),
        "over_time": over_time,
        "from_above": from_above,
    }


def _tilt(folder: Path, rig: Rig, tuned: Contender) -> dict[str, Any] | None:
    """Return the tilt errors, and a plot of the recording with the largest tilt error."""
    measured = [
        (recording, run.tilt_prediction, run.tilt, run.played)
        for recording, run in zip(rig.recordings, tuned.evaluation.runs, strict=True)
        if run.tilt is not None and run.tilt_prediction is not None
    ]
    if not measured:
        return None
    rows = []
    for name, errors, played in (
        *((recording.name, errors, played) for recording, _, errors, played in measured),
        ("all", tuned.evaluation.tilt, tuned.evaluation.played),
    ):
        assert errors is not None, name
        angles = [
            "-" if error is None else f"{1000 * error:.2f} mrad"
            for error in (errors.mae_x_rad, errors.mae_y_rad)
        ]
        rows.append([name, *angles, "-" if played is None else percent(played.mae)])
    recording, predicted, _, _ = max(
        measured, key=lambda entry: (entry[2].mae_x_rad or 0.0) + (entry[2].mae_y_rad or 0.0)
    )
    picture = folder / "tilt.svg"
    plot_tilt(picture, recording, predicted)
    return {
        "windows": tuned.evaluation.windows,
        "table": Table(
            "Mean absolute error of the tilt, and of the marble driven by the measured tilt",
            ["recording", "about x", "about y", "marble, measured tilt"],
            rows,
            total=True,
        ),
        "picture": Picture(picture, f"{recording.name}, the recording with the largest tilt error."),
    }


def _heldout(folder: Path, heldout: Rig, contenders: Sequence[Contender]) -> dict[str, Any]:
    """Return the errors of the models on held-out recordings."""
    tuned = contenders[1]
    stretches = segments(heldout)
    rows, pictures = [], []
    for run, recording in enumerate(heldout.recordings):
        noise = tracker_noise([segment for segment in stretches if segment.recording == recording.name])
        errors = [*(contender.run_mae(run) for contender in contenders), mean_absolute(noise)]
        rows.append([recording.name, *(percent(error) for error in errors)])
        picture = folder / f"heldout-{run + 1}.svg"
        plot_paths(picture, [(recording, tuned.prediction(run, recording.name))])
        pictures.append(Picture(picture, f"{recording.name}, predicted by {tuned.name}."))
    overall = [*(contender.mae for contender in contenders), mean_absolute(tracker_noise(stretches))]
    rows.append(["all", *(percent(error) for error in overall)])
    return {
        "how": _from_what(tuned),
        "table": Table(
            "Mean absolute error, in percent of the board's long edge",
            ["recording", *(contender.name for contender in contenders), "tracker noise"],
            rows,
            total=True,
        ),
        "comparisons": [compare(tuned, other) for other in contenders[2:]],
        "pictures": pictures,
    }


def _from_what(contender: Contender) -> str:
    """Return the initial state and inputs of a prediction, in words."""
    if contender.windowed:
        return f"in {contender.evaluation.windows}, each from the state estimated on the rows before it"
    return "from the first position and the commands alone"


def _parameters(results: Sequence[FitResult]) -> Table:
    """Return the fitted values with their intervals."""
    ranges = results[0].model.ranges
    return Table(
        "Value and 95 % interval, given that the model's physics is right",
        ["parameter", "search range", *_names(results)],
        [
            [
                labelled(name, UNITS.get(name, "")),
                f"{ranges[name][0]:g} to {ranges[name][1]:g}",
                *(with_interval(result.model.parameters[name]) for result in results),
            ]
            for name in PARAMETERS
        ]
        + list(_effect_rows(results)),
    )


def _effect_rows(results: Sequence[FitResult]) -> Iterator[list[str]]:
    """Yield a row for each parameter of the effects fitted by at least one method."""
    for name in dict.fromkeys(name for result in results for name in result.effects):
        for known in in_unit_of(results[0].model, effect(name)).parameters:
            fitted = [result.effects.get(name, {}).get(known.name) for result in results]
            if any(value is not None for value in fitted):
                values = ["-" if value is None else with_interval(value) for value in fitted]
                yield [f"{plain(name)}: {labelled(known.name, known.unit)}", known.searched, *values]


def _names(results: Sequence[FitResult]) -> list[str]:
    return [TITLES.get(result.method, result.method) for result in results]


def _attributed(results: Sequence[FitResult], said: Sequence[Sequence[str]]) -> list[str]:
    """Return the sentences of all methods, prefixed with the method's name if they differ."""
    if all(sentences == said[0] for sentences in said):
        return list(said[0])
    return [
        f"{name}: {sentence}"
        for name, sentences in zip(_names(results), said, strict=True)
        for sentence in sentences
    ]


def _history(folder: Path, rig: Rig, results: Sequence[FitResult]) -> list[Picture]:
    """Draw the convergence of each method."""
    noise = tracker_noise(segments(rig))
    histories, evolutions = [], []
    for result, name in zip(results, _names(results), strict=True):
        history = folder / f"history-{result.method}.svg"
        evolution = folder / f"parameters-{result.method}.svg"
        plot_history(history, result, noise=noise)
        plot_parameters(evolution, result)
        # Errors elsewhere on the page are of predictions from the first row.
        states = ", runs begin at their fitted states" if result.method == "least-squares" else ""
        caption = (
            f"{name}: error from {counted(len(result.estimates), 'start')}{states}; "
            f"{result.rollouts:,} simulated runs in {result.seconds:.1f} s of computing."
        )
        histories.append(Picture(history, caption))
        evolutions.append(Picture(evolution, f"{name}: each parameter within its search range."))
    return [*histories, *evolutions]


def _count(contender: Contender, thing: str = "recording") -> str:
    """Return the number of recordings a model is judged by, in words."""
    return counted(len(contender.evaluation.runs), thing)
