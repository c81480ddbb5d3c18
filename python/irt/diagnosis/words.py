"""The answer of a diagnosis in plain words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from irt.catalogue import effect
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.formula import formula, variables
from irt.diagnosis.result import UNLISTED, NamedEffect
from irt.display import in_rows
from irt.files import as_typed
from irt.model import Parameter

#: Mean absolute value of a normal variable over its standard deviation.
_MEAN_ABSOLUTE = float(np.sqrt(2.0 / np.pi))
#: What is said of names that leave far more than noise.
_MORE = (
    " More than noise is not explained: it does not repeat from run to run, or no effect of the catalogue "
    "describes it."
)
#: How the note begins that tells what was learned without a name, as a formula.
LEARNED = "What was learned, in SI units: "
#: Recordings, and rows in which the marble moves, below which little could have been shown.
_FEW, _STILL = 3, 30


def summary(
    effects: Sequence[NamedEffect],
    *,
    noise: float,
    before: float,
    after: float,
    heldout: bool,
    explained: bool = True,
    leaves: bool = False,
    row_s: float | None = None,
) -> str:
    """Return the answer in one or two sentences.

    Parameters
    ----------
    effects : sequence of NamedEffect
        What was left out.
    noise : float
        Standard deviation of the tracker [board edges].
    before, after : float
        Mean absolute error of the base model and of the final one [board edges].
    heldout : bool
        Whether these are errors on recordings that the models were not fitted to.
    explained : bool
        Whether noise is all that is left.
    leaves : bool
        Whether what is not explained is far beyond noise.
    row_s : float, optional
        What a row lasts in the simulation [s], where recordings have no stamps: rows stand for seconds then.
    """
    floor = _percent(_MEAN_ABSOLUTE * noise)
    if not effects:
        told = (
            f"recordings: held out, each is predicted to {_percent(before)}"
            if heldout
            else f"recording: it is fitted to {_percent(before)}"
        )
        if not explained:
            return (
                f"Nothing that is known explains what the five parameters leave of the {told} of the board's "
                f"edge, and the tracker's noise alone makes {floor}."
            )
        return (
            f"The five parameters explain the {told} of the board's edge, and the tracker's noise alone "
            f"makes {floor}. No physics is missing that these recordings could show."
        )
    one = len(effects) == 1
    named = f"{' and '.join(_shown(one, row_s) for one in effects)} {'was' if one else 'were'} left out"
    better = "recordings held out are predicted" if heldout else "the only recording is fitted"
    ties = "".join(
        f" These recordings do not tell {one.name} from {' or '.join(one.confusable_with)}."
        for one in effects
        if one.confusable_with
    )
    more = _MORE if leaves and all(one.name != UNLISTED for one in effects) else ""
    return (
        f"{_capital(named)}: with {'it' if one else 'them'}, {better} to {_percent(after)} of the board's "
        f"edge instead of {_percent(before)}; the tracker's noise alone makes {floor}.{ties}{more}"
    )


def suggestion(effects: Sequence[NamedEffect], rig: Path) -> str:
    """Return what to record next, and why."""
    command = f"`irt suggest {as_typed(rig)}`"
    tied = [one for one in effects if one.confusable_with]
    if any({one.name, *one.confusable_with} == {"delay", "latency"} for one in tied):
        return (
            "No drive of the knobs tells delay from latency: put a lamp into the picture that is switched "
            "with a command, or a sensor of the board's tilt beside the camera."
        )
    if tied:
        pairs = " and ".join(f"{one.name} from {' or '.join(one.confusable_with)}" for one in tied)
        return f"To distinguish {pairs}, record the run that {command} designs for it, and diagnose again."
    if any(one.name == UNLISTED for one in effects):
        return (
            "The push has no name yet: look at the formula, and at where on the board, at what speed or at "
            "what command it acts; recordings that go there more often pin it down."
        )
    if effects:
        names = " and ".join(one.name for one in effects)
        return (
            f"No effect is tied with another; the run that {command} designs would sharpen the "
            f"values of {names}."
        )
    return (
        "Larger and faster commands, reversals and runs along the rim show more kinds of physics; the table "
        "of what these recordings could have shown says which of them matter here."
    )


def notes(
    case: Case, best: Fitted, delays: Mapping[str, Parameter] | None, *, explained: bool
) -> Iterator[str]:
    """Say what else the user should know.

    Parameters
    ----------
    case, best
        The recordings, and the hypothesis chosen.
    delays : mapping or None
        Mean ``mean_s`` and standard deviation ``sd_s`` of delays that differ [s].
    explained : bool
        Whether the hypothesis leaves nothing but noise.
    """
    if not explained and delays is None:
        yield (
            f"The predictions miss by {max(best.noise / case.noise, 1.0):.1f} times the tracker's scatter, "
            "and what is left does not look like noise: part of the mismatch was not found, or does not "
            "repeat from run to run."
        )
    if delays is not None:
        mean, spread = delays["mean_s"].value, delays["sd_s"].value
        size = f"{spread:.2g} s"
        if case.time_scale is None:
            size = f"{spread / case.row_s(best):.2g} rows"
        yield (
            f"Delays differ from command to command by {size}, so no simulation predicts a run "
            "exactly: the model holds what they are on average, a delay and a lag. To see what the spread "
            f"does, put delay_jitter with sd_s = {spread:.2g} in the place of lag in model.toml, with a "
            f"delay_s of {mean:.2g}."
        )
    if UNLISTED in best.effects:
        yield f"{LEARNED}{formula(best.value_of(UNLISTED))}."
    if len(case.rig.recordings) == 1:
        yield (
            "There is one recording only: nothing could be held out, so the improvement is not proved. "
            "Record at least three."
        )
    elif len(case.rig.recordings) < _FEW:
        yield "Two recordings are few: an effect that both ask for may be chance. Record at least three."
    moving = sum(
        int((np.linalg.norm(np.diff(segment.observed, axis=0), axis=1) > 6.0 * case.noise).sum())
        for segment in case.segments
    )
    if moving < _STILL:
        yield (
            f"The marble moves in {moving} rows only: these recordings could hardly have shown any effect. "
            "See the table of what they could."
        )


def _shown(one: NamedEffect, row_s: float | None) -> str:
    if one.name == UNLISTED:
        depends = " and ".join(variables({name: told.value for name, told in one.parameters.items()}))
        return f"a push that the catalogue does not have and that depends on {depends}"
    sizes = [(name, parameter.value, one.units.get(name, "")) for name, parameter in one.parameters.items()]
    if row_s is not None:
        sizes = [in_rows(*parameter, row_s) for parameter in sizes]
    if sizes and effect(one.name).shrunk:
        _, _, unit = sizes[0]
        rms = float(np.sqrt(sum(value**2 for _, value, _ in sizes)))
        return f"{one.name} (slopes of the board of {rms:.2g} {unit}, root mean square)"
    # A name such as width_x_rad needs no unit beside its unit.
    values = ", ".join(
        f"{name.removesuffix(f'_{unit}')} {value:.3g} {unit}".rstrip() for name, value, unit in sizes
    )
    return f"{one.name} ({values})" if values else one.name


def _percent(error: float) -> str:
    return f"{100.0 * error:.2g} %"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
