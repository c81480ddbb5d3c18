"""Summary, suggestion and notes of a diagnosis in sentences."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectInfo, effect
from irt.diagnosis.dataset import Dataset, Fitted
from irt.diagnosis.formula import formula, holds_or_brakes, turns, variables
from irt.diagnosis.free_motion import PULL_OF_SLOPE
from irt.diagnosis.hypotheses import INERTIA
from irt.diagnosis.result import UNLISTED, NamedEffect
from irt.display import in_rows, listed, two_digits
from irt.files import as_typed
from irt.fitting.robust import mean_absolute
from irt.model import Parameter

Array = NDArray[np.float64]

#: Origin of errors that are clearly more than noise.
Rest = Literal["", "motion", "noise", "push", "chance", "rim"]

#: Sentences added if effects are named and errors remain that are clearly more than noise, by their origin.
_MORE = {
    "": "",
    "noise": " Errors remain that are larger than the model's own noise allows.",
    "push": " Errors beyond noise remain: no effect of the catalogue describes them.",
    "chance": " Errors beyond noise remain: they do not repeat from run to run, or follow rebounds from the "
    "rim.",
    "rim": " Errors beyond noise remain: rebounds from the rim differ from what any effect of the catalogue "
    "describes.",
}
#: What is said without effects, around the errors.
_NONE = {
    "": ("The five parameters{} explain the recordings", "They reveal no missing physics."),
    "noise": (
        "The five parameters{} leave errors that are larger than their own noise allows, and no known effect "
        "explains them",
        "Therefore nothing is named.",
    ),
    "motion": (
        "The five parameters{} leave most of the motion unexplained, and no known effect explains it",
        "Therefore nothing is named.",
    ),
    "push": ("No known effect explains the residuals of the five-parameter model{}", ""),
    "chance": (
        "No known effect explains the residuals of the five-parameter model{}",
        "No dependence of the rest on anything recorded is certain (at 1 %); it may follow rebounds from the "
        "rim.",
    ),
    "rim": (
        "Between impacts the five parameters{} explain the recordings; rebounds from the rim differ from "
        "what any known effect describes",
        "",
    ),
}
#: Parts of a model that are not named.
LAW_OF_IMPACTS, CORNERS = "a law of impacts", "corrected corners of the picture"
TURNING = "inertial forces of the turning board"
#: Beginning of the note with the formula of a learned correction.
LEARNED = "Learned correction, in SI units: "
#: Fewest recordings, and fewest places of the marble, for a diagnosis without a caveat.
_FEW, _STILL = 3, 30
#: Distance of places that are clearly apart, in standard deviations of the tracker.
_APART = 6.0
#: Widest smoothing of positions that is mentioned [rows]: wider ones round off a path visibly.
_SMOOTHED = 3.0


def summary(
    effects: Sequence[NamedEffect],
    *,
    noise: float,
    before: float,
    after: float,
    heldout: bool,
    rest: Rest = "",
    unnamed: Collection[str] = (),
    row_s: float | None = None,
) -> str:
    """Return the result in one or two sentences.

    Parameters
    ----------
    effects : sequence of NamedEffect
        The missing effects.
    noise : float
        Standard deviation of the tracker [board edges].
    before, after : float
        Mean absolute error of the base model and of the final one [board edges].
    heldout : bool
        Whether these are errors on held-out recordings.
    rest : {"", "motion", "noise", "push", "chance", "rim"}
        Origin of errors that are clearly more than noise: most of the motion, more than the model's own
        noise allows, a push that repeats, one that does not, random rebounds alone, or none.
    unnamed : collection of str
        Parts of the model that are not among the effects.
    row_s : float, optional
        Duration of a row in the simulation [s] if recordings have no stamps; times are then given in rows.
    """
    floor = _percent(mean_absolute(noise))
    more_of_model = "".join(f" and {one}" for one in unnamed)
    if not effects:
        error = (
            f"{'held-out error' if heldout else 'error of the fit'} {_percent(before)} of the board's edge"
        )
        errors = f"({error}; tracker noise alone gives {floor})"
        before_errors, after_errors = _NONE[rest]
        return f"{before_errors.format(more_of_model)} {errors}. {after_errors}".rstrip()
    one = len(effects) == 1
    named = listed(_shown(one, row_s) for one in effects)
    which = "held-out recordings" if heldout else "the only recording"
    ties = "".join(
        f" These recordings do not distinguish {one.name} from {' or '.join(one.confusable_with)}."
        for one in effects
        if one.confusable_with
    )
    more = _MORE[rest] if all(one.name != UNLISTED for one in effects) else ""
    what = f"the error on {which} falls from {_percent(before)} to {_percent(after)} of the board's edge"
    if after >= before or _percent(after) == _percent(before):
        # Effects are also named because each row is likelier with them; errors of long runs may hide it.
        what = (
            f"{which} {'are' if heldout else 'is'} likelier row by row, but the error does not fall "
            f"({_percent(before)} of the board's edge without, {_percent(after)} with)"
        )
    return (
        f"The simulator lacks {named}: with {'it' if one else 'them'}{more_of_model}, {what}; "
        f"tracker noise alone gives {floor}.{ties}{more}"
    )


def unnamed(info: EffectInfo) -> str:
    """Return what an effect is that is in the model and not named."""
    if info.name == INERTIA:
        return TURNING
    return LAW_OF_IMPACTS if info.of_rims else CORNERS


def impacts(restitution: tuple[float, float], friction: tuple[float, float]) -> str:
    """Return a note on a law of impacts that is in the model and not named.

    Parameters
    ----------
    restitution, friction : (float, float)
        Restitution at 0.1 m/s and friction of the rim: of the rig file, and fitted.
    """
    return (
        f"Rebounds from the rim are predicted better with a restitution of {two_digits(restitution[1])} at "
        f"0.1 m/s and a friction of {two_digits(max(0.0, friction[1]))} of the rim (rig.toml: "
        f"{restitution[0]:g} and {friction[0]:g}). Simulators differ by as much: this is in the model, and "
        "not named."
    )


def corners(names: Sequence[str]) -> str:
    """Return a note on effects of the camera that are in the model and not named."""
    one = len(names) == 1
    return (
        f"The picture is displaced a little ({listed(names)}), no more than errors of the tracker's four "
        f"corners by its noise would do: {'this is' if one else 'these are'} in the model, and not named."
    )


def turning(time_s: float, row_s: float | None) -> str:
    """Return a note on inertial forces that are in the model and not named.

    Parameters
    ----------
    time_s : float
        Time constant of the board's turn [s].
    row_s : float, optional
        As for `summary`.
    """
    time = f"{two_digits(1e3 * time_s)} ms" if row_s is None else f"{two_digits(time_s / row_s)} rows"
    return (
        f"The commands change so much and so often that the turning board throws the marble ({INERTIA}; the "
        f"board takes a new angle with a time constant of {time}): this is in the model, and not named, "
        "because it acts on every rig."
    )


def beyond(effects: Sequence[NamedEffect], infos: Mapping[str, EffectInfo]) -> Iterator[str]:
    """Yield a note if named effects are certainly larger than the catalogue expects of them.

    Five effects that together imitated a cord that yields at speed were: two had 1.4 and 2.4 times the
    largest value of their ranges.

    Parameters
    ----------
    effects : sequence of NamedEffect
        The missing effects.
    infos : mapping
        What the catalogue says of each, in the units of its parameters.
    """
    found = []
    for one in effects:
        for info in infos[one.name].required if one.name in infos else ():
            value = one.parameters.get(info.name)
            if info.is_choice or value is None or value.low is None or value.high is None:
                continue
            if value.low > info.high or value.high < info.low:
                found.append(f"{one.name} ({info.name} {value.value:.3g}, not {info.low:g} to {info.high:g})")
    if found:
        does = "lies" if len(found) == 1 else "lie"
        yield (
            f"{listed(found)} {does} beyond what the catalogue expects: this may stand for physics that is "
            "not in the catalogue, or for a rig of another kind."
        )


def smoothed(effects: Sequence[NamedEffect], row_s: float) -> Iterator[str]:
    """Yield a note if a smoothed track would look the same as a named parallax.

    The mean of a path over a window with variance s² is ahead of the path by s²/2 times the acceleration,
    which is 5/7 g times the tilt.

    Parameters
    ----------
    effects : sequence of NamedEffect
        The missing effects.
    row_s : float
        Duration of a row [s].
    """
    heights = [one.parameters["height_m_per_rad"].value for one in effects if one.name == "parallax"]
    for height in heights:
        rows = float(np.sqrt(max(0.0, 2.0 * height / PULL_OF_SLOPE))) / row_s
        if 0.0 < rows < _SMOOTHED:
            yield (
                "Positions that a tracker or filter had smoothed with weights of a standard deviation of "
                f"{rows:.2g} rows would look the same as this parallax. If yours are smoothed, diagnose them "
                "as they were before."
            )


def suggestion(effects: Sequence[NamedEffect], rig: Path, rest: Rest = "") -> str:
    """Return what to do or record next, and why; `rest` as for `summary`."""
    if rest in {"motion", "noise"}:
        return (
            "Check that the commands belong to these recordings (files, order, clock), and their units; then "
            f"the ranges of the parameters in rig.toml. `irt check {as_typed(rig)}` shows what it finds."
        )
    command = f"`irt suggest {as_typed(rig)} --models DIR` (DIR: the folder of these results)"
    tied = [one for one in effects if one.confusable_with]
    if any({one.name, *one.confusable_with} == {"delay", "latency"} for one in tied):
        return (
            "No commands separate delay and latency. A measured tilt of the board does (it follows a delay, "
            "not a latency; see the notes), or a lamp in the picture that is switched with a command."
        )
    if tied:
        pairs = " and ".join(f"{one.name} from {' or '.join(one.confusable_with)}" for one in tied)
        return f"To distinguish {pairs}, record the run designed by {command}, and diagnose again."
    if any(one.name == UNLISTED for one in effects):
        return (
            "The correction is not in the catalogue: look at its formula, and at the positions, speeds or "
            "commands at which it acts. More recordings there would determine it better."
        )
    if effects:
        names = " and ".join(one.name for one in effects)
        return f"There are no ties. The run designed by {command} would sharpen the values of {names}."
    return (
        "Larger and faster commands, reversals and runs along the rim reveal more kinds of physics; see the "
        "table of detectable sizes for those that these recordings could not show."
    )


def of_the_sum(own: str, more: str) -> str:
    """Return a sentence on an interval that was widened to hold beside another effect of the actuator."""
    return (
        f"{own} and {more}: the recordings show little more than the sum of their times. The interval of "
        f"{own} also holds if there is a {more}."
    )


def notes(
    dataset: Dataset, best: Fitted, delays: Mapping[str, Parameter] | None, *, explained: bool
) -> Iterator[str]:
    """Yield notes on the result.

    Parameters
    ----------
    dataset, best
        The dataset, and the selected hypothesis.
    delays : mapping or None
        Mean ``mean_s`` and standard deviation ``sd_s`` of jittered delays [s].
    explained : bool
        Whether the residuals are noise.
    """
    if not explained and delays is None:
        yield (
            f"The residuals are {max(best.noise / dataset.noise, 1.0):.1f} times the tracker's noise and are "
            "not white: part of the mismatch was not found, or does not repeat from run to run."
        )
    if delays is not None:
        mean, spread = delays["mean_s"].value, delays["sd_s"].value
        size = f"{spread:.2g} s"
        if dataset.time_scale is None:
            size = f"{spread / dataset.row_s(best):.2g} rows"
        yield (
            f"Delays vary from command to command by {size}, so no simulation predicts a run "
            "exactly. The model contains their mean effect, a delay and a lag. To simulate the variation, "
            f"replace lag in model.toml by delay_jitter with sd_s = {spread:.2g}, and set delay_s to "
            f"{mean:.2g}."
        )
    if UNLISTED in best.effects:
        yield f"{LEARNED}{formula(best.value_of(UNLISTED))}."
    if dataset.in_parts:
        yield (
            f"There are fewer than three recordings: they are cut into {len(dataset.rig.recordings)} parts, "
            "which are held out in turn. What differs from run to run cannot show in these. Record at least "
            "three."
        )
    elif len(dataset.rig.recordings) == 1:
        yield (
            "There is only one recording: nothing could be held out, so the improvement is not validated. "
            "Record at least three."
        )
    elif len(dataset.rig.recordings) < _FEW:
        yield "With two recordings, an effect that fits both may be due to chance. Record at least three."
    places = sum(_places(segment.observed, _APART * dataset.noise) for segment in dataset.segments)
    if places < _STILL:
        yield (
            f"The marble is seen in only {places} places that are clearly apart: hardly any effect is "
            "detectable. See the table of detectable sizes."
        )


def _places(observed: Array, apart: float) -> int:
    """Return the number of positions (n, 2) that are this far from the one counted before."""
    known = observed[np.isfinite(observed).all(axis=1)]
    count, last = 0, known[:1].sum(axis=0)
    for place in known:
        if np.linalg.norm(place - last) > apart:
            count, last = count + 1, place
    return count


def _shown(one: NamedEffect, row_s: float | None) -> str:
    if one.name == UNLISTED:
        learned = {name: value.value for name, value in one.parameters.items()}
        depends = " and ".join(variables(learned))
        parts = [f"a push that is not in the catalogue and that depends on {depends}"] if depends else []
        parts += ["a force at the rim that is not in the catalogue"] if holds_or_brakes(learned) else []
        parts += ["a picture that turns or grows with the tilt"] if turns(learned) else []
        return " and ".join(parts)
    sizes = [(name, parameter.value, one.units.get(name, "")) for name, parameter in one.parameters.items()]
    if row_s is not None:
        sizes = [in_rows(*parameter, row_s) for parameter in sizes]
    if sizes and effect(one.name).shrunk:
        _, _, unit = sizes[0]
        return f"{one.name} ({slopes((value for _, value, _ in sizes), unit)})"
    # A name such as width_x_rad or x_edges needs no unit beside its unit, or beside another of the commands.
    usual = effect(one.name).units
    values = ", ".join(
        f"{_bare(_bare(name, unit), usual.get(name, unit))} {value:.3g} {unit}".rstrip()
        for name, value, unit in sizes
    )
    return f"{one.name} ({values})" if values else one.name


def _bare(name: str, unit: str) -> str:
    """Return the name of a parameter without a unit as suffix."""
    return name.removesuffix(f"_{unit}").removesuffix(f"_{unit}s")


def slopes(values: Iterable[float], unit: str) -> str:
    """Return the slope of a board that is a sum of waves, in words."""
    rms = float(np.sqrt(sum(value**2 for value in values)))
    return f"slopes of the board of {rms:.2g} {unit}, root mean square"


def _percent(error: float) -> str:
    return f"{two_digits(100.0 * error)} %"
