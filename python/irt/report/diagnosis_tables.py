"""Sections of a diagnosis' page that are words and tables."""

from __future__ import annotations

import math
from collections.abc import Mapping

from irt.catalogue import EffectInfo, EffectParameter, effect, effects
from irt.diagnosis.result import UNLISTED, Diagnosis, NamedEffect
from irt.diagnosis.words import LEARNED
from irt.model import Effect, Parameter
from irt.report.page import Page
from irt.report.plots import mean_absolute
from irt.report.words import (
    UNITS,
    counted,
    labelled,
    odds,
    percent,
    plain,
    quantity,
    times_less,
    together,
    versions,
    with_interval,
)
from irt.rig import PARAMETERS, Rig

_KINDS = {
    "stage": "on the way from command to picture",
    "time": "when",
    "region": "where on the board",
    "regime": "in which motion",
    "run": "in which recording",
}
#: Rows of the longest tables.
_MOST_ROWS = 80
_MOST_PARAMETERS = 16


def add_effects(page: Page, diagnosis: Diagnosis) -> None:
    """Add what was named, explained from the catalogue, with its fitted values."""
    known = {one.name: one for one in effects()}
    if diagnosis.effects:
        page.heading("What was left out" if len(diagnosis.effects) == 1 else "What was left out, one by one")
    for one in diagnosis.effects:
        info = known.get(one.name)
        title = "physics that is not in the catalogue" if one.name == UNLISTED else plain(one.name)
        page.subheading(f"{title} ({one.stage})")
        if one.name == UNLISTED:
            together = any(len(other.effects) > 1 for other in diagnosis.candidates)
            tried = ", nor two together," if together else " alone"
            why = "" if together else "Two together were not tried: what was learned leaves about noise. "
            page.paragraph(
                f"No effect of the catalogue{tried} explains what is left over, yet it repeats from run to "
                f"run. {why}A correction was learned from the recordings instead; it is in model.toml and "
                "simulates like any other effect:"
            )
            for note in filter(_is_formula, diagnosis.notes):
                page.equation(note.removeprefix(LEARNED).removesuffix("."))
            page.paragraph(
                "An acceleration of the rolling marble in SI units: places from the board's centre, angles "
                "in radians, time and way since the recording began."
            )
        if info is not None:
            _explain(page, info)
        _add_values(page, one, info)
        without, with_it = one.heldout_mae_without, one.heldout_mae_with
        if diagnosis.is_held_out:
            page.paragraph(
                f"Runs held out are {percent(without)} of the edge off without it, all else fitted anew, and "
                f"{percent(with_it)} with it: {times_less(without, with_it)}."
            )
        _add_rivals(page, one, known)
        if info is not None and info.references:
            page.paragraph(f"To read more: {'; '.join(info.references)}.")


def add_rivals(page: Page, diagnosis: Diagnosis) -> None:
    """Add the models that explain the recordings as well, with the values that they need for it."""
    if not diagnosis.rivals:
        return
    page.subheading("Models that explain these recordings as well")
    models = [diagnosis.model, *diagnosis.rivals]
    page.table(
        "The first is the one that this page shows; the others are as likely",
        ["effects", "fitted values", *PARAMETERS],
        [
            [
                together([one.name for one in model.effects]),
                "; ".join(_told(one) for one in model.effects),
                *(f"{model.parameters[name].value:.3g}" for name in PARAMETERS),
            ]
            for model in models
        ],
        words=(1,),
    )


def _told(one: Effect) -> str:
    """Return the values of an effect in a few digits; what was learned is too much for a line."""
    if one.name == UNLISTED:
        return "in model.toml"
    return ", ".join(f"{name} {value:.3g}" for name, value in one.parameters.items())


def _explain(page: Page, info: EffectInfo) -> None:
    page.equation(info.equation)
    page.facts({"what it does": info.does, "when it matters": info.matters, "in the data": info.looks})


def _add_values(page: Page, one: NamedEffect, info: EffectInfo | None) -> None:
    """Add the fitted values of an effect; of what was learned, those that say something."""
    neutral = {parameter.name: parameter.neutral for parameter in effect(UNLISTED).parameters}
    said = {
        name: value
        for name, value in one.parameters.items()
        if info is not None or value.value != neutral.get(name, 0.0)
    }
    if not said:
        return
    rows = [
        [labelled(name, one.units.get(name, "")), with_interval(value)]
        for name, value in list(said.items())[:_MOST_PARAMETERS]
    ]
    if info is None:
        page.table("Fitted value and 95 % interval", ["parameter", "value"], rows)
    else:
        about = {parameter.name: parameter for parameter in info.parameters}
        page.table(
            "Fitted value and 95 % interval, given that the named physics is right",
            ["parameter", "value", "searched", "what it is"],
            [row + _searched(about.get(name)) for name, row in zip(said, rows, strict=False)],
            words=(3,),
        )
    if len(said) > _MOST_PARAMETERS:
        page.paragraph(f"The first {_MOST_PARAMETERS} of {len(said)} numbers; all are in model.toml.")


def _searched(parameter: EffectParameter | None) -> list[str]:
    """Return where a search looked for a parameter, and what it is."""
    return ["-", ""] if parameter is None else [parameter.searched, parameter.doc]


def _add_rivals(page: Page, one: NamedEffect, known: Mapping[str, EffectInfo]) -> None:
    """Add the effects that explain the recordings as well."""
    if not one.confusable_with:
        return
    page.paragraph(f"These recordings cannot tell {plain(one.name)} from:")
    page.bullets(
        f"{plain(name)}: {known[name].does}" if name in known else plain(name) for name in one.confusable_with
    )


def add_runs(page: Page, diagnosis: Diagnosis) -> None:
    """Add the errors on each run, held out where there are several."""
    floor = mean_absolute(diagnosis.noise)
    compared = bool(diagnosis.effects)
    header = ["recording", "length", *(["before", "after", "error"] if compared else ["simulated"])]
    rows = []
    every = [
        (run.recording, f"{run.times[-1] - run.times[0]:.1f} s", run.base_mae, run.final_mae)
        for run in diagnosis.runs
    ]
    if diagnosis.is_held_out:
        every.append(("all", "", diagnosis.base_heldout_mae, diagnosis.final_heldout_mae))
    for name, length, before, after in every:
        errors = [percent(before)]
        if compared:
            errors += [percent(after), times_less(before, after)]
        rows.append([name, length, *errors, percent(floor)])
    which = "runs held out" if diagnosis.is_held_out else "the run fitted"
    page.table(
        f"Mean absolute error on {which}, in percent of the board's long edge",
        [*header, "tracker's noise"],
        rows,
        total=diagnosis.is_held_out,
    )


def add_where(page: Page, diagnosis: Diagnosis) -> None:
    """Add the places where residuals of the base model stand out."""
    if not diagnosis.where:
        return
    page.table(
        "Where the base model's errors stand out from noise: the share of the mismatch found there, and how "
        "often noise alone would do as much, given how many places were looked at",
        ["asked", "found", "share", "by chance"],
        [
            [_KINDS.get(one.kind, one.kind), one.what, f"{100 * one.strength:.0f} %", odds(one.p_value)]
            for one in diagnosis.where
        ],
        words=(1,),
    )


def add_power(page: Page, diagnosis: Diagnosis) -> None:
    """Add what these recordings would have shown."""
    if not diagnosis.power:
        return
    page.heading("What would have been seen")
    page.paragraph(
        "A diagnosis finds what the recordings can show. From the size below on, an effect would have been "
        "named with a probability of at least 80 %, its other parameters at typical values; what is smaller "
        "could hide."
    )
    page.table(
        "Smallest size that these recordings show",
        ["effect", "parameter", "seen from", "looked at up to"],
        [
            [
                plain(one.effect),
                one.parameter,
                "not seen" if one.least is None else quantity(one.least, one.unit),
                quantity(one.largest, one.unit),
            ]
            for one in diagnosis.power
        ],
    )


def add_parameters(page: Page, diagnosis: Diagnosis) -> None:
    """Add the five parameters of both models, and what the recordings do not say about them."""
    page.heading("The parameters")
    base, final = diagnosis.base.parameters, diagnosis.model.parameters
    compared = bool(diagnosis.effects)
    page.table(
        "Value and 95 % interval, given that the model's physics is right",
        ["parameter", *(["before", "after"] if compared else ["value"])],
        [
            [labelled(name, UNITS.get(name, "")), *_values(base[name], final[name], compared)]
            for name in PARAMETERS
        ],
    )
    off = percent(diagnosis.base_mae)
    if compared:
        off = f"{off} before and {percent(diagnosis.final_mae)} after"
    page.paragraph(
        f"On the runs that they were fitted to, predictions are off by {off}; the tracker's noise alone "
        f"makes {percent(mean_absolute(diagnosis.noise))}."
    )
    if diagnosis.unidentifiable:
        page.paragraph("What these recordings cannot pin down:")
        page.bullets(diagnosis.unidentifiable)


def _values(before: Parameter, after: Parameter, compared: bool) -> list[str]:
    return [with_interval(before), with_interval(after)] if compared else [with_interval(after)]


def add_next(page: Page, diagnosis: Diagnosis) -> None:
    """Add what to record next, and what else there is to know."""
    if diagnosis.suggestion:
        page.heading("What to record next")
        page.paragraph(diagnosis.suggestion)
    others = [note for note in diagnosis.notes if not _is_formula(note)]
    if others:
        page.heading("To know besides")
        page.bullets(others)


def _is_formula(note: str) -> bool:
    """Whether a note tells what was learned: it stands with the values."""
    return note.startswith(LEARNED)


def add_candidates(page: Page, diagnosis: Diagnosis) -> None:
    """Add every hypothesis with its numbers, for those who want to check the ranking."""
    tried = diagnosis.candidates[:_MOST_ROWS]
    if not tried:
        return
    page.heading("Every hypothesis, in numbers")
    page.table(
        "Gain: log-likelihood over the base model's. Cost: what is taken off for its parameters and the "
        "width of the search. Held out: the gain on runs held out. Left: standard deviation of what remains",
        ["hypothesis", "gain", "cost", "held out", "left", "outcome"],
        [
            [
                together(one.effects),
                f"{one.gain:+,.1f}",
                f"{one.penalty:,.1f}",
                "-" if one.heldout_gain is None else f"{one.heldout_gain:+,.1f}",
                percent(one.noise),
                one.outcome,
            ]
            for one in tried
        ],
        words=(5,),
    )
    if len(diagnosis.candidates) > len(tried):
        page.paragraph(
            f"The best {len(tried)} of {len(diagnosis.candidates)}; all of them are in diagnosis.json."
        )


def add_settings(page: Page, rig: Rig, diagnosis: Diagnosis) -> None:
    """Add what it takes to do the same again."""
    page.heading("To do the same again")
    names = ", ".join(recording.name for recording in rig.recordings)
    rows = sum(len(recording.knobs) for recording in rig.recordings)
    page.facts(
        {
            "recordings": f"{rig.path.name}: {names} ({counted(rows, 'row')})",
            **{str(name): str(value) for name, value in diagnosis.settings.items()},
            "seed": f"{diagnosis.seed}",
            "tracker's noise": f"{percent(diagnosis.noise)} of the edge, standard deviation",
            "time": "-" if math.isnan(diagnosis.seconds) else f"{diagnosis.seconds:.1f} s",
            **versions(),
        }
    )
