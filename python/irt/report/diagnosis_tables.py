"""Tables of the diagnosis report."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from irt.catalogue import EffectInfo, EffectParameter, effect
from irt.diagnosis.result import UNLISTED, Diagnosis, NamedEffect
from irt.diagnosis.words import slopes
from irt.fitting.problem import in_unit_of
from irt.fitting.robust import mean_absolute
from irt.model import Effect, Model, Parameter
from irt.report.page import Table
from irt.report.words import (
    UNITS,
    change,
    duration,
    labelled,
    p_value,
    percent,
    plain,
    probability,
    quantity,
    together,
    with_interval,
)
from irt.rig import PARAMETERS

_KINDS = {
    "stage": "stage of the simulator",
    "time": "time in the run",
    "region": "place on the board",
    "regime": "motion",
    "run": "recording",
}
#: Rows of the longest table; `diagnosis.json` holds all.
MOST_CANDIDATES = 80
#: Probability below which an effect is not listed.
LEAST_PROBABLE = 0.01

#: Converts a parameter's name, value and unit for display; without stamps, to rows.
Stated = Callable[[str, Parameter, str], tuple[str, Parameter, str]]


def indistinguishable(diagnosis: Diagnosis, stated: Stated) -> Table | None:
    """Return the models that explain the recordings as well, with their fitted values."""
    if not diagnosis.indistinguishable:
        return None
    return Table(
        "The first model is the one of this report; the others are as likely",
        ["effects", "fitted values", *PARAMETERS],
        [
            [
                together([one.name for one in model.effects]),
                "; ".join(_values(model, one, stated) for one in model.effects),
                *(f"{model.parameters[name].value:.3g}" for name in PARAMETERS),
            ]
            for model in (diagnosis.model, *diagnosis.indistinguishable)
        ],
        words=(1,),
    )


def _values(model: Model, one: Effect, stated: Stated) -> str:
    """Return the values of an effect as text; a learned correction has too many for one line."""
    if one.name == UNLISTED:
        return "in model.toml"
    about = in_unit_of(model, effect(one.name))
    unit = {parameter.name: parameter.unit for parameter in about.parameters}
    if about.shrunk:
        return slopes(one.parameters.values(), about.parameters[0].unit)
    shown = (stated(name, Parameter(value), unit.get(name, "")) for name, value in one.parameters.items())
    return ", ".join(f"{name} {quantity(value.value, known)}" for name, value, known in shown)


def values(one: NamedEffect, info: EffectInfo, stated: Stated) -> Table | None:
    """Return the fitted values of an effect of the catalogue."""
    if not one.parameters:
        return None
    about = {parameter.name: parameter for parameter in info.parameters}
    rows = []
    for name, parameter in one.parameters.items():
        shown, value, unit = stated(name, parameter, one.units.get(name, ""))
        found = about.get(name)
        known = ["-", ""] if found is None else [_searched(found, stated), found.doc]
        rows.append([labelled(shown, unit), with_interval(value), *known])
    return Table(
        "Fitted value and 95 % interval, if the named physics is right; what hardly matters may act, too",
        ["parameter", "value", "search range", "description"],
        rows,
        words=(3,),
    )


def _searched(parameter: EffectParameter, stated: Stated) -> str:
    """Return the search range of a parameter."""
    if parameter.is_choice:
        return parameter.searched
    ends = (stated("", Parameter(end), parameter.unit)[1].value for end in (parameter.low, parameter.high))
    return " to ".join(f"{end:.3g}" for end in ends)


def runs(diagnosis: Diagnosis, *, stamped: bool) -> Table:
    """Return the errors of each run, held out if there are several runs."""
    compared = bool(diagnosis.effects)
    every = [
        (
            run.recording,
            duration(len(run.times), float(run.times[-1] - run.times[0]) if stamped else None),
            run.base_mae,
            run.final_mae,
        )
        for run in diagnosis.runs
    ]
    if diagnosis.is_held_out:
        every.append(("all", "", diagnosis.base_heldout_mae, diagnosis.final_heldout_mae))
    rows = []
    for name, length, before, after in every:
        errors = [percent(before), percent(after), change(before, after)] if compared else [percent(before)]
        rows.append([name, length, *errors])
    which = "held-out runs" if diagnosis.is_held_out else "the run that was fitted"
    columns = ["before", "after", "error"] if compared else ["simulated"]
    return Table(
        f"Mean absolute error on {which}, in percent of the board's long edge. Tracker noise alone "
        f"gives {percent(mean_absolute(diagnosis.noise))}",
        ["recording", "length", *columns],
        rows,
        total=diagnosis.is_held_out,
    )


def where(diagnosis: Diagnosis) -> Table | None:
    """Return the places where residuals of the base model exceed noise, None if there are none."""
    if not diagnosis.where:
        return None
    kinds = list(dict.fromkeys(one.kind for one in diagnosis.where))
    return Table(
        "Where the base model's residuals exceed noise: the share of the mismatch found there, and the "
        "p-value under noise alone, corrected for the number of places tested",
        ["tested", "found", "share", "p-value"],
        [
            [_KINDS.get(one.kind, one.kind), one.what, f"{100 * one.strength:.0f} %", p_value(one.p_value)]
            for one in sorted(diagnosis.where, key=lambda one: kinds.index(one.kind))
        ],
        words=(1,),
    )


def power(diagnosis: Diagnosis, stated: Stated) -> Table | None:
    """Return the smallest detectable size of each effect."""
    if not diagnosis.power:
        return None
    rows = []
    for one in diagnosis.power:
        name, largest, unit = stated(one.parameter, Parameter(one.largest), one.unit)
        least = None if one.least is None else stated("", Parameter(one.least), one.unit)[1].value
        rows.append(
            [
                plain(one.effect),
                name,
                "not detectable" if least is None else quantity(least, unit),
                quantity(largest.value, unit),
            ]
        )
    return Table(
        "Smallest size that is detected with a probability of 80 % or more. A size is the distance from the "
        "value at which an effect does nothing, such as 1 for a ratio",
        ["effect", "parameter", "detected from", "tested up to"],
        rows,
    )


def parameters(diagnosis: Diagnosis) -> Table:
    """Return the five parameters of both models."""
    base, final = diagnosis.base.parameters, diagnosis.model.parameters
    models = (base, final) if diagnosis.effects else (final,)
    return Table(
        "Value and 95 % interval, given that the model's physics is right",
        ["parameter", *(["before", "after"] if diagnosis.effects else ["value"])],
        [
            [labelled(name, UNITS.get(name, "")), *(with_interval(model[name]) for model in models)]
            for name in PARAMETERS
        ],
    )


def candidates(diagnosis: Diagnosis) -> Table | None:
    """Return all hypotheses with gain, penalty, probability and outcome."""
    if not diagnosis.candidates:
        return None
    rows: Sequence[Sequence[str]] = [
        [
            together(one.effects),
            f"{one.gain:+z,.1f}",
            f"{one.penalty:,.1f}",
            probability(one.probability),
            one.outcome,
        ]
        for one in diagnosis.candidates[:MOST_CANDIDATES]
    ]
    return Table(
        "Gain: log-likelihood over the base model [nats], each with the random push that fits it best. "
        "Penalty: for the additional parameters, and for the choice from the catalogue. Probability: of this "
        "set among all scored sets",
        ["hypothesis", "gain", "penalty", "probability", "outcome"],
        rows,
        words=(4,),
    )


def inclusion(diagnosis: Diagnosis) -> Table | None:
    """Return the probability that each effect acts, the most probable first."""
    known = {name: chance for name, chance in diagnosis.inclusion.items() if chance > LEAST_PROBABLE}
    if not known:
        return None
    return Table(
        "Probability that an effect acts: the sum over all sets that contain it. Effects below 1 % are not "
        "listed",
        ["effect", "probability", "in the answer"],
        [
            [plain(name), probability(chance), _part_of_the_answer(name, diagnosis)]
            for name, chance in sorted(known.items(), key=lambda one: (-one[1], one[0]))
        ],
    )


def _part_of_the_answer(name: str, diagnosis: Diagnosis) -> str:
    """Return the role of an effect in the answer."""
    for one in diagnosis.effects:
        if one.name == name:
            return "named"
        if name in one.confusable_with:
            return f"ties with {plain(one.name)}"
    return "not named"
