"""The page that a diagnosis leaves behind: what the simulator leaves out, and why to believe it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from irt.diagnosis.result import UNLISTED, Diagnosis, RunProof
from irt.files import PathLike, make_folder
from irt.report import diagnosis_tables as tables
from irt.report.animation import add_animation
from irt.report.diagnosis_plots import (
    Side,
    evidence_for,
    highest_error,
    plot_board,
    plot_errors,
    plot_map,
    plot_over_time,
    plot_ranking,
    sides,
)
from irt.report.page import Page, Picture, add_warnings
from irt.report.plots import PERCENT, mean_absolute
from irt.report.words import listed, millimetres, percent, plain, times_less
from irt.rig import Rig

#: Least noise that pictures are scaled by [board edges]: about 3 um, which no tracker sees.
_LEAST_NOISE = 1e-5
#: Runs that get a picture of their own.
_MOST_RUNS = 8
#: Kinds of findings of which the first stands at the top of the page, and the chance above which none does.
_TELLING, _CLEAR = ("region", "regime", "stage"), 0.05
#: Bars of hypotheses of one and of more effects.
_MOST_BARS = 12


def write_diagnosis_report(
    folder: PathLike, rig: Rig, diagnosis: Diagnosis, warnings: Sequence[str] = ()
) -> Path:
    """Write ``report.html`` and its pictures as SVG files into a folder, and return the page's path.

    Parameters
    ----------
    folder : path
        Made where it is missing.
    rig : Rig
        What was diagnosed.
    diagnosis : Diagnosis
        The outcome.
    warnings : sequence of str
        What a check of the recordings warned of.

    Raises
    ------
    IrtError
        If a file cannot be written.
    """
    folder = make_folder(folder)
    page = Page(f"{rig.path.name}: {_title(diagnosis)}", diagnosis.summary)
    _add_answer(page, rig, diagnosis)
    add_warnings(page, warnings)
    if diagnosis.runs:
        _add_motion(page, folder, rig, diagnosis)
    tables.add_effects(page, diagnosis)
    tables.add_rivals(page, diagnosis)
    tables.add_power(page, diagnosis)
    if diagnosis.runs:
        _add_proof(page, folder, rig, diagnosis)
    _add_place(page, folder, diagnosis)
    _add_ranking(page, folder, diagnosis)
    tables.add_parameters(page, diagnosis)
    tables.add_next(page, diagnosis)
    tables.add_candidates(page, diagnosis)
    tables.add_settings(page, rig, diagnosis)
    path = folder / "report.html"
    page.write(path)
    return path


def _title(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few words."""
    if diagnosis.verdict == "sufficient":
        return "nothing is missing that these recordings can show"
    if diagnosis.verdict == "unlisted":
        return "something is missing that no known effect explains"
    return f"{listed(plain(one.name) for one in diagnosis.effects)} is missing".replace(
        " is ", " are " if len(diagnosis.effects) > 1 else " is "
    )


def _add_answer(page: Page, rig: Rig, diagnosis: Diagnosis) -> None:
    """Add the three numbers that matter, and what stands against taking the answer at its word."""
    page.key_figures(_key_figures(rig, diagnosis))
    for one in diagnosis.effects:
        if one.confusable_with:
            rivals = listed((plain(name) for name in one.confusable_with), "or")
            page.callout(
                "A tie, not a certainty.",
                f"In place of {plain(one.name)}, {rivals} would explain these recordings as well. "
                f"{one.reason}",
            )
    found: dict[str, str] = {}
    for finding in diagnosis.where:
        if finding.p_value < _CLEAR and finding.kind in _TELLING:
            found.setdefault(finding.kind, finding.what)
    if diagnosis.verdict == "unlisted" and found:
        page.callout("What is left over repeats itself.", f"Found: {'; '.join(found.values())}.")


def _key_figures(rig: Rig, diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return the errors before and after on runs held out, beside the least that there can be."""
    edge = rig.board.edge_x_m
    before, after = diagnosis.base_heldout_mae, diagnosis.final_heldout_mae
    mean, proof = "mean error on runs held out, of the board's edge", "to which no model was fitted"
    if not diagnosis.is_held_out:
        before, after = diagnosis.base_mae, diagnosis.final_mae
        mean, proof = "mean error on the runs given, of the board's edge", "none could be held out"
    floor = mean_absolute(diagnosis.noise)
    noise = (percent(floor), f"the tracker's noise: no model can do better ({millimetres(floor, edge)})")
    if not diagnosis.effects:
        return [(percent(before), f"{mean} ({millimetres(before, edge)})"), noise]
    return [
        (percent(before), f"before: {mean} ({millimetres(before, edge)}), the best fit of five parameters"),
        (percent(after), f"after: the same with {_added(diagnosis)} ({millimetres(after, edge)})"),
        noise,
        (times_less(before, after), f"{mean.split(',')[0]}, {proof}"),
    ]


def _added(diagnosis: Diagnosis) -> str:
    """Return what the final model has more than the first one."""
    if any(one.name == UNLISTED for one in diagnosis.effects):
        return "a correction learned from the recordings"
    return f"{listed(plain(one.name) for one in diagnosis.effects)} added"


def _how(rig: Rig) -> str:
    """Return what a prediction is made from, in words."""
    if rig.start == "moving":
        return "in windows, each from the state that the rows before it tell"
    return "from the first position and the commands alone"


def _add_motion(page: Page, folder: Path, rig: Rig, diagnosis: Diagnosis) -> None:
    """Add the marble in motion, and the run that is hardest to predict as plots."""
    shown = sides(diagnosis)
    runs = sorted(diagnosis.runs, key=lambda run: -_or_zero(run.final_mae))
    hardest = runs[0]
    model = "final model" if len(shown) > 1 else "simulator"
    compared = "simulated before and after" if len(shown) > 1 else "simulated"
    page.heading(f"The marble, recorded and {compared}")
    page.paragraph(
        f"{hardest.recording} is the run that the {model} predicts worst. Each run was predicted "
        f"{_how(rig)}, by a model fitted to the other runs."
        if diagnosis.is_held_out
        else f"The run was predicted {_how(rig)}, by a model fitted to it."
    )
    stills, over_time = [], []
    for side in shown:
        path = folder / f"path-{side.label}.svg"
        plot_board(path, hardest, diagnosis.model, [side])
        stills.append(Picture(path, f"{hardest.recording}, {side.label}, from above."))
    # Without an after there is room for a second run.
    for number, run in enumerate(runs[: 3 - len(shown)], start=1):
        over_time += _over_time(folder, number, run, shown, _noise(diagnosis))
    rings = "rings are simulated" if len(shown) > 1 else "the ring is simulated"
    add_animation(
        page,
        runs,
        diagnosis.model,
        shown,
        stills=stills,
        hint=f"The disc is the recorded marble, {rings}; the other runs can be chosen above.",
        caption="The board from above. The dotted line is as far as a marble's centre can go.",
    )
    page.pictures(*over_time)
    if len(shown) > 1:
        page.paragraph("The differences before and after are drawn on scales of their own: mind the numbers.")


def _over_time(
    folder: Path, number: int, run: RunProof, shown: Sequence[Side], noise: float
) -> list[Picture]:
    """Return a run over time, as each of the models predicts it."""
    pictures = []
    limit = 1.05 * _reach(run, shown)
    for side in shown:
        path = folder / f"time-{side.label}-{number}.svg"
        plot_over_time(path, run, side, noise, limit=limit)
        pictures.append(
            Picture(
                path,
                f"{run.recording}, {side.label}: {percent(side.mae(run))} of the edge off. Below each "
                "coordinate, predicted less recorded; the band holds 95 % of the tracker's noise.",
            )
        )
    return pictures


def _add_proof(page: Page, folder: Path, rig: Rig, diagnosis: Diagnosis) -> None:
    """Add the errors on runs held out, as a table and from above."""
    shown = sides(diagnosis)
    page.heading("Proof: runs held out" if diagnosis.is_held_out else "No proof: one recording only")
    by = (
        "Each run was predicted by models that were fitted to the other runs alone: a model that only "
        "retraces what it was given fails here."
        if diagnosis.is_held_out
        else "The run was predicted by models that were fitted to it, so this shows how well they retrace "
        "it and no more. With three recordings or more each is predicted by a fit to the others."
    )
    page.paragraph(
        f"{by} Predictions are made {_how(rig)}. An error is the mean of |x| and |y| over all rows of a run."
    )
    tables.add_runs(page, diagnosis)
    pictures = []
    for number, run in enumerate(diagnosis.runs[:_MOST_RUNS], start=1):
        path = folder / f"heldout-{number}.svg"
        plot_board(path, run, diagnosis.model, shown)
        errors = ", ".join(f"{percent(side.mae(run))} {side.label}" for side in shown)
        pictures.append(Picture(path, f"{run.recording}: {errors}."))
    page.pictures(*pictures)
    if len(diagnosis.runs) > _MOST_RUNS:
        page.paragraph(f"The first {_MOST_RUNS} of {len(diagnosis.runs)} runs are drawn.")


def _add_place(page: Page, folder: Path, diagnosis: Diagnosis) -> None:
    """Add where on the board and when predictions are off."""
    if not diagnosis.runs and not diagnosis.where:
        return
    shown = sides(diagnosis)
    page.heading("Where and when the " + ("simulator is off" if len(shown) == 1 else "mismatch lives"))
    tables.add_where(page, diagnosis)
    if not diagnosis.runs:
        return
    maps = []
    for side in shown:
        path = folder / f"map-{side.label}.svg"
        plot_map(path, diagnosis.runs, diagnosis.model, side, _noise(diagnosis))
        maps.append(
            Picture(
                path,
                f"Where on the board, {side.label}: the typical error while the recorded marble was in a "
                "cell, over all runs. 1 is the tracker's noise; empty cells were never visited.",
            )
        )
    page.paragraph(
        "A marble that was pushed wrongly stays wrong: an error grows along a run, so the map shows where it "
        "is felt, and the lines over time show when it begins."
    )
    page.pictures(*maps, *_errors(folder, diagnosis, shown))


def _errors(folder: Path, diagnosis: Diagnosis, shown: Sequence[Side]) -> list[Picture]:
    """Return the errors over time, as many pictures beside each other as there are maps above them."""
    runs = diagnosis.runs[:_MOST_RUNS]
    top = 1.3 * max(highest_error(runs, shown), 2 * PERCENT * mean_absolute(_noise(diagnosis)))
    pictures = []
    for number in range(min(len(shown), len(runs))):
        path = folder / f"errors-{number + 1}.svg"
        plot_errors(path, runs[number :: len(shown)], shown, _noise(diagnosis), top=top)
        pictures.append(Picture(path, "When: the error along each run, on a logarithmic scale."))
    return pictures


def _add_ranking(page: Page, folder: Path, diagnosis: Diagnosis) -> None:
    """Add the hypotheses in the order of the evidence for them."""
    tried = [one for one in diagnosis.candidates if one.effects]
    if not tried:
        return
    page.heading("The hypotheses, ranked")
    page.paragraph(
        f"{len(tried)} ways to extend the base model were fitted, all parameters anew each time. A bar is "
        "how much better the recordings are explained than by the base model, less what the additional "
        "parameters and the number of attempts would win by chance. It is the logarithm of odds: 3 is 20 to "
        "1, 10 is 20,000 to 1, and below 0 the base model is to be preferred. A difference of less than 3 "
        "between two bars decides nothing."
    )
    if diagnosis.effects:
        page.paragraph("The answer is blue; what ties with it is a hollow bar.")
    answer, ties = answers(diagnosis)
    evidence = [evidence_for(one) for one in tried]
    span = min(evidence), max(evidence)
    pictures = []
    groups = {
        "one": ("One effect added", [one for one in tried if len(one.effects) == 1]),
        "several": ("Several effects together", [one for one in tried if len(one.effects) > 1]),
    }
    for name, (title, group) in groups.items():
        if not group:
            continue
        best = sorted(group, key=evidence_for, reverse=True)[:_MOST_BARS]
        path = folder / f"ranking-{name}.svg"
        # One scale for both pictures, so that bars can be compared.
        plot_ranking(path, best, answer, ties, span=span)
        which = f"the best {len(best)} of {len(group)}" if len(group) > len(best) else "all that were tried"
        pictures.append(Picture(path, f"{title}: {which}."))
    page.pictures(*pictures)


def answers(diagnosis: Diagnosis) -> tuple[frozenset[str], set[frozenset[str]]]:
    """Return the hypothesis that is the answer, and those that tie: rivals, or one named effect replaced."""
    named = frozenset(one.name for one in diagnosis.effects)
    ties = {named - {one.name} | {rival} for one in diagnosis.effects for rival in one.confusable_with}
    ties |= {frozenset(one.name for one in rival.effects) for rival in diagnosis.rivals}
    return named, ties


def _reach(run: RunProof, shown: Sequence[Side]) -> float:
    """Return how far a run goes from the centre, recorded or predicted [board edges]."""
    marbles = [run.observed, *(side.marble(run) for side in shown)]
    farthest = max(float(np.nanmax(np.abs(marble), initial=0.0)) for marble in marbles)
    return min(max(farthest, 0.05), 1.0)


def _noise(diagnosis: Diagnosis) -> float:
    """Return the noise that pictures are drawn in units of: simulated recordings may have none."""
    return max(diagnosis.noise, _LEAST_NOISE)


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value
