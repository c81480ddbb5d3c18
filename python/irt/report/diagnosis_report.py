"""HTML report of a diagnosis: missing physics, certainty, held-out errors, next step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from irt import arguments
from irt.catalogue import EffectInfo, effect, effects
from irt.diagnosis.dataset import horizon_row_s
from irt.diagnosis.result import UNLISTED, Candidate, Diagnosis, NamedEffect, RunProof
from irt.diagnosis.words import LEARNED
from irt.display import listed
from irt.engine import SUBSTEP_S
from irt.files import PathLike, make_folder
from irt.fitting.problem import in_unit_of
from irt.fitting.robust import mean_absolute
from irt.model import Model, Parameter
from irt.report import diagnosis_tables as tables
from irt.report.animation import PLAYER, Animation
from irt.report.budget_plots import plot_budget
from irt.report.diagnosis_plots import (
    Side,
    evidence_for,
    highest_error,
    plot_board,
    plot_errors,
    plot_map,
    plot_over_time,
    plot_push,
    plot_ranking,
    sides,
)
from irt.report.error_budget import bars, remainder, squares_explained
from irt.report.learned import terms_table
from irt.report.learned_plots import learned_pictures
from irt.report.page import Picture, write_page
from irt.report.plots import PERCENT
from irt.report.tilt_picture import tilt_picture
from irt.report.words import (
    counted,
    explained,
    in_rows,
    millimetres,
    percent,
    plain,
    probability,
    share,
    together,
    versions,
)
from irt.rig import Rig

#: Lower bound of the noise that scales plots [board edges]: about 3 um, below any tracker's noise.
_LEAST_NOISE = 1e-5
#: Most runs with their own plots.
_MOST_RUNS = 8
#: Kinds of findings shown at the top of the page, and the largest p-value of a finding shown there.
_TOP_KINDS, _CLEAR = ("region", "regime", "stage"), 0.05
#: Most bars in each ranking of hypotheses.
_MOST_BARS = 12


@arguments.entry
def write_diagnosis_report(
    folder: PathLike, rig: Rig, diagnosis: Diagnosis, warnings: Sequence[str] = ()
) -> Path:
    """Write ``report.html`` and its pictures as SVG files into a folder, and return the page's path.

    Parameters
    ----------
    folder : path
        Created if missing.
    rig : Rig
        The diagnosed rig.
    diagnosis : Diagnosis
        The diagnosis.
    warnings : sequence of str
        Warnings of a check of the recordings.

    Raises
    ------
    IrtError
        If an argument has the wrong type, or a file cannot be written.
    """
    arguments.instance("rig", rig, Rig)
    arguments.instance("diagnosis", diagnosis, Diagnosis)
    arguments.listed("warnings", warnings, str, expected="a sequence of sentences")
    folder = make_folder(arguments.path("folder", folder))
    path = folder / "report.html"
    report = _Report(folder, rig, diagnosis)
    content = {**report.answer(), **report.motion(), **report.findings(), **report.details()}
    scripts = [PLAYER] if diagnosis.runs else []
    title = f"{rig.path.name}: {_title(diagnosis)}"
    write_page(path, "diagnosis.html", scripts=scripts, title=title, warnings=warnings, **content)
    return path


def _title(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few words."""
    if diagnosis.verdict == "sufficient":
        return "no missing physics detected"
    if diagnosis.verdict == "unlisted":
        lacks = "the simulator lacks physics that is not in the catalogue"
        return lacks if diagnosis.effects else "a mismatch that no effect of the catalogue explains"
    return f"the simulator lacks {listed(plain(one.name) for one in diagnosis.effects)}"


class _Report:
    """Collects the content of the template, and writes its pictures into a folder."""

    def __init__(self, folder: Path, rig: Rig, diagnosis: Diagnosis) -> None:
        self.folder, self.rig, self.diagnosis = folder, rig, diagnosis
        self.shown = sides(diagnosis)
        self.stamped = all(recording.stamps is not None for recording in rig.recordings)
        self.row_s = _row_s(diagnosis.model)
        # Simulated recordings may have no noise.
        self.noise = max(diagnosis.noise, _LEAST_NOISE)
        self.floor = mean_absolute(diagnosis.noise)

    def stated(self, name: str, value: Parameter, unit: str) -> tuple[str, Parameter, str]:
        """Return a parameter's name, value and unit, in rows if the recordings have no stamps."""
        return (name, value, unit) if self.stamped else in_rows(name, value, unit, self.row_s)

    def answer(self) -> dict[str, Any]:
        """Return the content of the first screen."""
        return {
            "diagnosis": self.diagnosis,
            "compared": len(self.shown) > 1,
            "stamped": self.stamped,
            "row_ms": f"{1000 * self.row_s:.3g}",
            "floor": self.floor,
            "how": "in windows, each from the state estimated on the rows before it"
            if self.rig.start == "moving"
            else "from the first position and the commands alone",
            "key_figures": _key_figures(self.rig, self.diagnosis),
            "budget": self._budget(),
            "certainty": " ".join(_certainty(self.diagnosis)),
            "explanation": _explanation(self.diagnosis),
            "remainder": " ".join(remainder(self.diagnosis)),
            "patterns": _patterns(self.diagnosis),
            "repeats": _repeats(self.diagnosis),
        }

    def _budget(self) -> Picture | None:
        """Draw the error budget of the base model."""
        found = bars(self.diagnosis, horizon_row_s(self.rig))
        if not found:
            return None
        path = self.folder / "budget.svg"
        plot_budget(path, found)
        caption = (
            "Error budget: parts of the five-parameter model's squared error on held-out runs, from left to "
            "right in the order of the key."
        )
        shares = "; ".join(
            f"{bar.title}: {', '.join(f'{part.name} {share(part.share)}' for part in bar.parts)}"
            for bar in found
        )
        return Picture(path, caption, f"{caption} {_capital(shares)}.")

    def motion(self) -> dict[str, Any]:
        """Return the animation, and plots of the run with the largest error."""
        diagnosis, shown = self.diagnosis, self.shown
        if not diagnosis.runs:
            return {"animation": None}
        # The run with the largest error before the correction comes first.
        runs = sorted(diagnosis.runs, key=lambda run: -_or_zero(run.base_mae))
        stills, over_time = [], []
        for side in shown:
            path = self.folder / f"path-{side.label}.svg"
            plot_board(path, runs[0], diagnosis.model, [side])
            stills.append(Picture(path, f"{runs[0].recording}, {side.label}, from above."))
        # If no effects were added, there is room for a second run.
        for number, run in enumerate(runs[: 3 - len(shown)], start=1):
            limit = 1.05 * _reach(run, shown)
            for side in shown:
                path = self.folder / f"time-{side.label}-{number}.svg"
                plot_over_time(path, run, side, self.noise, limit=limit, stamped=self.stamped)
                caption = (
                    f"{run.recording}, {side.label}: mean error {percent(side.mae(run))} of the edge. Below "
                    "each coordinate its residual (predicted minus recorded); the band holds 95 % of the "
                    "tracker noise."
                )
                over_time.append(Picture(path, caption))
        animation = Animation.of(runs, diagnosis.model, shown, stamped=self.stamped)
        return {"animation": animation, "stills": stills, "over_time": over_time}

    def findings(self) -> dict[str, Any]:
        """Return the named effects, the held-out errors, and where residuals exceed noise."""
        diagnosis = self.diagnosis
        known = {one.name: one for one in effects()}
        return {
            "effects": [self._effect(one, known) for one in diagnosis.effects],
            "formulas": [
                note.removeprefix(LEARNED).removesuffix(".")
                for note in diagnosis.notes
                if note.startswith(LEARNED)
            ],
            "indistinguishable": tables.indistinguishable(diagnosis, self.stated),
            "power": tables.power(diagnosis, self.stated),
            "runs": tables.runs(diagnosis, stamped=self.stamped) if diagnosis.runs else None,
            "boards": self._boards(),
            "tilt": tilt_picture(self.folder, self.rig, diagnosis.runs),
            "where": tables.where(diagnosis),
            "push": self._push(),
            "maps": [*self._maps(), *self._errors()] if diagnosis.runs else [],
        }

    def details(self) -> dict[str, Any]:
        """Return the ranked hypotheses, the parameters, the notes and the settings."""
        diagnosis, rig = self.diagnosis, self.rig
        rows = sum(len(recording.knobs) for recording in rig.recordings)
        names = ", ".join(recording.name for recording in rig.recordings)
        tried = [one for one in diagnosis.candidates if one.effects]
        return {
            "rankings": self._rankings(tried),
            "tried": len(tried),
            "inclusion": tables.inclusion(diagnosis),
            "parameters": tables.parameters(diagnosis),
            "notes": [note for note in diagnosis.notes if not note.startswith(LEARNED)],
            "candidates": tables.candidates(diagnosis),
            "settings": {
                **{str(name): str(value) for name, value in diagnosis.settings.items()},
                "recordings": f"{rig.path.name}: {names} ({counted(rows, 'row')})",
                "seed": f"{diagnosis.seed}",
                "tracker noise": f"{percent(diagnosis.noise)} of the edge, standard deviation",
                "computing time": "-" if math.isnan(diagnosis.seconds) else f"{diagnosis.seconds:.1f} s",
                **versions(),
            },
        }

    def _effect(self, one: NamedEffect, known: dict[str, EffectInfo]) -> dict[str, Any]:
        """Return the content of the section on one effect."""
        info, row_s = known.get(one.name), None if self.stamped else self.row_s
        content: dict[str, Any] = {
            "effect": one,
            "probability": f"{probability(one.probability)} for {_with_ties(one)}, "
            "given these recordings and the catalogue",
            "info": info,
            "table": None if info is None else tables.values(one, in_unit_of(self.rig, info), self.stated),
            "confusable": [
                f"{plain(name)}: {known[name].does}" if name in known else plain(name)
                for name in one.confusable_with
            ],
        }
        learned = one.name == UNLISTED
        content["terms"] = terms_table(one, row_s) if learned else None
        shown = (self.folder, one, self.rig, self.diagnosis, self.row_s)
        content["pictures"] = learned_pictures(*shown, stamped=self.stamped) if learned else []
        return content

    def _boards(self) -> list[Picture]:
        """Draw each run from above."""
        pictures = []
        for number, run in enumerate(self.diagnosis.runs[:_MOST_RUNS], start=1):
            path = self.folder / f"heldout-{number}.svg"
            plot_board(path, run, self.diagnosis.model, self.shown)
            errors = ", ".join(f"{percent(side.mae(run))} {side.label}" for side in self.shown)
            pictures.append(Picture(path, f"{run.recording}: mean error {errors}."))
        return pictures

    def _maps(self) -> Iterator[Picture]:
        """Draw the error over the board."""
        for side in self.shown:
            path = self.folder / f"map-{side.label}.svg"
            plot_map(path, self.diagnosis.runs, self.diagnosis.model, side, self.noise)
            caption = (
                f"Error over the board, {side.label}: root mean square of the residuals in a cell, over all "
                "runs. 1 is the tracker noise; empty cells were never visited."
            )
            yield Picture(path, caption)

    def _push(self) -> list[Picture]:
        """Draw the missing push of the recording in which it is largest."""
        pushes = self.diagnosis.pushes
        if not pushes:
            return []
        most = max(pushes, key=lambda one: float(np.nan_to_num(one.base**2).mean()))
        path = self.folder / "push.svg"
        models = {"base": self.diagnosis.base, "final": self.diagnosis.model}
        rows_s = [_row_s(models[side.which]) for side in self.shown]
        plot_push(path, most, self.shown, rows_s, stamped=self.stamped)
        caption = (
            f"{most.recording}: acceleration of the marble that is missing in the simulator, estimated from "
            "all rows, with 95 % bands. Where the physics is complete, the bands contain zero. No push can "
            "be observed where friction holds the marble."
        )
        return [Picture(path, caption)]

    def _errors(self) -> Iterator[Picture]:
        """Draw the errors over time, in as many columns as there are maps."""
        shown, runs = self.shown, self.diagnosis.runs[:_MOST_RUNS]
        top = 1.3 * max(highest_error(runs, shown), 2 * PERCENT * mean_absolute(self.noise))
        for number in range(min(len(shown), len(runs))):
            path = self.folder / f"errors-{number + 1}.svg"
            plot_errors(path, runs[number :: len(shown)], shown, self.noise, top=top, stamped=self.stamped)
            yield Picture(path, "Error along each run, on a logarithmic scale.")

    def _rankings(self, tried: Sequence[Candidate]) -> list[Picture]:
        """Draw the hypotheses by evidence, those of one effect and those of several separately."""
        if not tried:
            return []
        answer, ties = answers(self.diagnosis)
        evidence = [evidence_for(one) for one in tried]
        # Both plots share one scale, so that bars can be compared.
        span = min(evidence), max(evidence)
        pictures = []
        for name, title, group in (
            ("one", "Hypotheses of one effect", [one for one in tried if len(one.effects) == 1]),
            ("several", "Hypotheses of several effects", [one for one in tried if len(one.effects) > 1]),
        ):
            if not group:
                continue
            best = sorted(group, key=evidence_for, reverse=True)[:_MOST_BARS]
            path = self.folder / f"ranking-{name}.svg"
            plot_ranking(path, best, answer, ties, span=span)
            which = f", the best {len(best)} of {len(group)}" if len(group) > len(best) else ""
            pictures.append(Picture(path, f"{title}{which}."))
        return pictures


def _least(diagnosis: Diagnosis) -> tuple[float, str]:
    """Return the lower bound of any model's error [board edges], and its sources in words."""
    if diagnosis.remains is None:
        return mean_absolute(diagnosis.noise), "tracker noise"
    return diagnosis.remains.floor_of_the_log, "tracker noise and unknown start states"


def _key_figures(rig: Rig, diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return the errors before and after, that of a perfect simulator, and the explained share."""
    edge = rig.board.edge_x_m
    floor, floor_is = _least(diagnosis)
    before, after = _errors_of(diagnosis)
    mean = "mean held-out error, of the board's edge" if diagnosis.is_held_out else "mean error of the fit"
    noise = (
        percent(floor),
        f"expected of a perfect simulator, from {floor_is} ({millimetres(floor, edge)})",
    )
    if not diagnosis.effects:
        return [(percent(before), f"{mean} ({millimetres(before, edge)})"), noise]
    figures = [
        (percent(before), f"before: {mean} ({millimetres(before, edge)}), with five parameters"),
        (percent(after), f"after: the same with {_added(diagnosis)} ({millimetres(after, edge)})"),
        noise,
    ]
    part = explained(before, after, floor)
    if not math.isnan(part):
        figures.append((share(part), f"of the error above that floor is explained by {_added(diagnosis)}"))
    return figures


def _row_s(model: Model) -> float:
    """Return the duration of a row in a model [s]."""
    return model.parameters["time_scale"].value * SUBSTEP_S


def _added(diagnosis: Diagnosis) -> str:
    """Return the additions of the final model to the base model, in words."""
    if any(one.name == UNLISTED for one in diagnosis.effects):
        return "the learned correction"
    return listed(plain(one.name) for one in diagnosis.effects)


def _errors_of(diagnosis: Diagnosis) -> tuple[float, float]:
    """Return the errors before and after: on held-out runs if there are any, else of the fit."""
    if diagnosis.is_held_out:
        return diagnosis.base_heldout_mae, diagnosis.final_heldout_mae
    return diagnosis.base_mae, diagnosis.final_mae


def _certainty(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield sentences on the certainty of the answer."""
    tried = [one for one in diagnosis.candidates if one.effects]
    answer, ties = answers(diagnosis)
    is_sufficient = diagnosis.verdict == "sufficient"
    if not diagnosis.effects:
        refused = [one for one in tried if frozenset(one.effects) != answer]
        if refused:
            number = counted(len(refused), "hypothesis", "hypotheses")
            does = "is supported by the recordings" if is_sufficient else "explains the remaining error"
            yield f"None of the {number} {does}."
        else:
            yield "No effect of the catalogue promised to explain more than chance does, so none was fitted."
        if diagnosis.power and is_sufficient:
            yield "A small effect may still be present; see the table of detectable sizes."
    tied = False
    named = [one for one in diagnosis.effects if one.name != UNLISTED]
    if named:
        chances = listed(f"{_with_ties(one)} {probability(one.probability)}" for one in named)
        yield f"Probability, given these recordings and the catalogue: {chances}."
    for one in diagnosis.effects:
        if one.confusable_with:
            tied = True
            others = listed((plain(name) for name in one.confusable_with), "or")
            yield (
                f"Not unique: {others} instead of {plain(one.name)} explains these recordings as well. "
                f"{one.reason}"
            )
    found = next((one for one in tried if frozenset(one.effects) == answer), None)
    # A hypothesis that contains the answer is no alternative to it.
    others_tried = [
        one for one in tried if not frozenset(one.effects) >= answer and frozenset(one.effects) not in ties
    ]
    if diagnosis.effects and found is not None and others_tried:
        best = max(others_tried, key=evidence_for)
        ahead = evidence_for(found) - evidence_for(best)
        odds = f"{ahead:,.0f} nats behind (3 nats are odds of 20 to 1)"
        if ahead < 0.0:
            odds = f"{-ahead:,.0f} nats ahead, but held-out recordings do not confirm all of it"
        yield f"The next best hypothesis, {together(best.effects)}, is {odds}."
    if diagnosis.effects and diagnosis.is_held_out and diagnosis.runs:
        better = sum(run.final_mae < run.base_mae for run in diagnosis.runs)
        yield f"The error falls on {better} of {counted(len(diagnosis.runs), 'held-out run')}."
        count = len(diagnosis.runs)
        chosen = listed(
            f"{_with_ties(one)} {round(one.chosen_again * count)} of {count} times"
            for one in diagnosis.effects
        )
        yield (
            f"With each run in turn left out, the selection among the most probable sets contains {chosen}. "
            f"Its error on that run is {percent(diagnosis.nested_heldout_mae)} of the edge."
        )
    elif diagnosis.effects and not tied:
        yield "Not validated: there were no held-out runs."


def _with_ties(one: NamedEffect) -> str:
    """Return an effect with its ties, which share its probability."""
    if one.name == UNLISTED:
        return "the learned correction"
    return listed(map(plain, [one.name, *one.confusable_with]), "or")


def _explanation(diagnosis: Diagnosis) -> str:
    """Return a sentence on the share of the error that the answer explains."""
    floor, floor_is = _least(diagnosis)
    before, after = (percent(error) for error in _errors_of(diagnosis))
    part = explained(*_errors_of(diagnosis), floor)
    where = (
        "On held-out runs" if diagnosis.is_held_out else "On the run that was fitted, as none was held out,"
    )
    if not diagnosis.effects:
        return (
            f"{where} the five parameters leave an error of {before} of the edge; {percent(floor)} is "
            f"expected of a perfect simulator, from {floor_is}."
        )
    if math.isnan(part):
        return (
            f"{where} the error was near that of a perfect simulator already: {before} of the edge, and "
            f"{after} after."
        )
    return (
        f"{where} the error falls from {before} to {after} of the edge: {share(part)} of what exceeds "
        f"{floor_is} ({percent(floor)}).{squares_explained(diagnosis)}"
    )


def _patterns(diagnosis: Diagnosis) -> list[str]:
    """Return what unexplained residuals depend on; empty unless the verdict is "unlisted"."""
    found: dict[str, str] = {}
    if diagnosis.verdict == "unlisted":
        for finding in diagnosis.where:
            if finding.p_value < _CLEAR and finding.kind in _TOP_KINDS:
                found.setdefault(finding.kind, finding.what)
    return list(found.values())


def _repeats(diagnosis: Diagnosis) -> bool:
    """Whether residuals of the base model depend on something that repeats from run to run."""
    return bool(diagnosis.effects) or (diagnosis.remains is not None and diagnosis.remains.repeats)


def answers(diagnosis: Diagnosis) -> tuple[frozenset[str], set[frozenset[str]]]:
    """Return the answer, and the sets that tie with it, as they are or with one named effect replaced."""
    of_rims = {one.name for one in diagnosis.model.effects if effect(one.name).of_rims}
    named = frozenset(of_rims | {one.name for one in diagnosis.effects})
    ties = {named - {one.name} | {other} for one in diagnosis.effects for other in one.confusable_with}
    ties |= {frozenset(one.name for one in other.effects) for other in diagnosis.indistinguishable}
    return named, ties


def _reach(run: RunProof, shown: Sequence[Side]) -> float:
    """Return the largest distance of a run from the centre, recorded or predicted [board edges]."""
    marbles = [run.observed, *(side.marble(run) for side in shown)]
    farthest = max(float(np.nanmax(np.abs(marble), initial=0.0)) for marble in marbles)
    return min(max(farthest, 0.05), 1.0)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value
