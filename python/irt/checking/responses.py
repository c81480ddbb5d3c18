"""Check of axes and signs: the marble must respond to commands and tilt as the formats declare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.checking.result import Finding, ResponseFacts
from irt.checking.runs import row_step
from irt.conventions import (
    CONVENTIONS,
    FITTED,
    LEAST_BLOCKS,
    Convention,
    Response,
    Signals,
    fit_acceleration,
    fit_level,
    resampled,
)
from irt.engine import GRAVITY, SUBSTEP_S
from irt.recording import MARBLE, TILT
from irt.rig import PARAMETERS, Rig

Array = NDArray[np.float64]

_TIME = PARAMETERS.index("time_scale")
#: Acceleration of a solid sphere that rolls without slipping, per radian of tilt [m/s^2].
EXPECTED = 5.0 / 7.0 * GRAVITY
#: Longest delay in the search [s], and without stamps [rows]; real rigs have 0.1 s and a lag of up to 0.2 s.
_LONGEST_S, _LONGEST_ROWS = 0.5, 6
#: Largest offset of the tilt against the marble, by filters or another camera [s].
_SKEW_S = 0.15
#: Approximate number of delays in the search.
_DELAYS = 16
#: Standard errors and share of the variance by which another convention must be better. Of 122 simulated and
#: 39 practice rigs in 7 wrong conventions each, 99 % are detected. For right conventions, and for noise
#: alone, no other convention explains 1 % more.
Z, SHARE = 1.3, 0.15
#: Log likelihood ratio [nats] for a certainly wrong convention: another one is a million times likelier,
#: corrected for the seven alternatives.
CERTAIN = float(np.log(1e6) + np.log(len(CONVENTIONS) - 1))
#: Factor on the expected gain that indicates another unit and not friction or slip.
_FACTOR = 2.0
#: Tolerance, as a factor, of a ratio of units: slopes of the board, friction and slip change a gain by less.
_SAME = 1.5
#: Standard errors for a significant deviation of a gain.
_APART = 5.0
#: Explained share below which a gain does not indicate units.
SURE = 0.5


@dataclass(frozen=True, eq=False)
class Answer:
    """A response with its columns."""

    response: Response
    facts: ResponseFacts


def responses(
    rig: Rig,
    cleaned: Sequence[tuple[Array, Array | None]],
    rim: Sequence[NDArray[np.bool_]],
) -> dict[str, Answer]:
    """Return the responses that the recordings allow: "marble", "tilt to marble", "tilt"."""
    commands = rig.recordings[0].columns
    step = row_step(rig)
    held = delays_to_try(step)
    of_runs = marble_signals(rig, cleaned, rim)
    to_marble = [one for run, one in zip(rig.recordings, of_runs, strict=True) if run.has_marble]
    from_tilt, to_tilt = [], []
    for run, (_, tilt), own in zip(rig.recordings, cleaned, of_runs, strict=True):
        if tilt is not None and run.has_tilt:
            (angles,) = resampled(run.stamps if step is not None else None, tilt, held=(False,))
            to_tilt.append(Signals(own.inputs, angles))
            if run.has_marble:
                from_tilt.append(replace(own, inputs=angles))
    found = {}
    scale = 1.0 if step is None else rig.board.edge_x_m / step**2
    per = "rad" if rig.commands.unit == "rad" else rig.commands.unit
    unit = f"edges a row^2 per {per}" if step is None else f"m/s^2 per {per}"
    ends = (commands, MARBLE)
    if to_marble and (one := fit_acceleration(to_marble, held)) is not None:
        found["marble"] = _answer(one, ends, unit, scale, step)
    if from_tilt:
        skew = _grid(-_SKEW_S, _SKEW_S, step)
        if (one := fit_acceleration(from_tilt, skew, inputs="sampled")) is not None:
            unit = "edges a row^2 per rad" if step is None else "m/s^2 per rad"
            found["tilt to marble"] = _answer(one, (TILT, MARBLE), unit, scale, step)
    if to_tilt and (one := fit_level(to_tilt, held)) is not None:
        found["tilt"] = _answer(one, (commands, TILT), f"rad per {per}", 1.0, step)
    return found


def marble_signals(
    rig: Rig, cleaned: Sequence[tuple[Array, Array | None]], rim: Sequence[NDArray[np.bool_]]
) -> list[Signals]:
    """Return commands and places of each run at equal steps; places are all NaN in a run without a marble."""
    step = row_step(rig)
    found = []
    for run, (marble, _), touches in zip(rig.recordings, cleaned, rim, strict=True):
        times = run.stamps if step is not None else None
        knobs, places, walls = resampled(
            times, run.knobs, marble, touches.astype(float), held=(True, False, False)
        )
        found.append(Signals(knobs, places, ~(walls > 0.0)))
    return found


def delays_to_try(step: float | None) -> Array:
    """Return the delays of commands that a fit tries [rows], from the duration of a row [s]."""
    return _grid(0.0, _LONGEST_S, step)


def first_values(rig: Rig, time_scale: float | None, answer: Answer | None) -> Array:
    """Return start values of the five parameters, (5,): gears of the regression, else mid-range.

    Parameters
    ----------
    rig : Rig
        The recordings.
    time_scale : float or None
        Time scale from the stamps; None without stamps.
    answer : Answer or None
        The response of the marble to the commands.
    """
    values = np.array([sum(rig.ranges[name]) / 2.0 for name in PARAMETERS])
    if time_scale is not None:
        values[_TIME] = time_scale
    if answer is not None:
        step_s = values[_TIME] * SUBSTEP_S
        gain = answer.response.gain * rig.board.edge_x_m / step_s**2 / EXPECTED
        for index, found in enumerate((-gain[1, 0], gain[0, 1])):
            low, high = rig.ranges[PARAMETERS[index]]
            if np.isfinite(found):
                values[index] = np.clip(found, low + 0.01 * (high - low), high)
    return values


def _grid(low_s: float, high_s: float, step: float | None) -> Array:
    """Return delays to try [rows]."""
    if step is None:
        return np.arange(-2 if low_s < 0.0 else 0, _LONGEST_ROWS + 1, dtype=float)
    low, high = np.floor(2.0 * low_s / step) / 2.0, np.ceil(2.0 * high_s / step) / 2.0
    return np.arange(low, high + 0.25, max(0.5, np.ceil(2.0 * (high - low) / _DELAYS) / 2.0))


def _answer(
    response: Response,
    columns: tuple[tuple[str, str], tuple[str, str]],
    unit: str,
    scale: float,
    step: float | None,
) -> Answer:
    def pair(values: Array) -> tuple[float | None, float | None]:
        known = [float(one) if np.isfinite(one) else None for one in values]
        return known[0], known[1]

    inputs, outputs = columns
    delay = response.delay if step is None else response.delay * step
    facts = ResponseFacts(
        inputs=inputs,
        outputs=outputs,
        unit=unit,
        gain=(pair(scale * response.gain[0]), pair(scale * response.gain[1])),
        error=(pair(scale * response.error[0]), pair(scale * response.error[1])),
        delay=pair(delay),
        delay_unit="rows" if step is None else "s",
        explained=float(response.shares[0]),
        best=correction(response.best, inputs, outputs),
        best_explained=float(response.shares.max()),
        contradicts=response.contradicts(z=Z, share=SHARE),
    )
    return Answer(response, facts)


def correction(found: Convention, swapped: tuple[str, str], mirrored: tuple[str, str]) -> str:
    """Return the correction of columns: which two to swap, then which to mirror; empty if none."""
    parts = [f"swap {swapped[0]} and {swapped[1]}"] if found.swapped else []
    wrong = [name for name, sign in zip(mirrored, found.signs, strict=True) if sign < 0]
    if wrong:
        parts.append(f"{'then ' if parts else ''}change the sign of {' and '.join(wrong)}")
    return ", ".join(parts)


def has_free_signs(rig: Rig) -> bool:
    """Whether any convention of the commands is valid: with a gear matrix, or gears of either sign."""
    return rig.commands.matrix or any(rig.ranges[name][0] < 0.0 for name in ("gear_x", "gear_y"))


def response_findings(rig: Rig, answers: dict[str, Answer]) -> list[Finding]:
    """Return findings on axes and signs, with the columns to change, and on gains of another unit."""
    findings = []
    free_signs = has_free_signs(rig)
    wrong = {
        name
        for name, one in answers.items()
        if one.facts.contradicts and not (free_signs and name in ("marble", "tilt"))
    }
    commands = rig.recordings[0].columns
    if {"marble", "tilt to marble"} <= wrong:
        findings.append(_contradiction(answers["tilt to marble"], MARBLE))
    elif "tilt to marble" in wrong:
        findings.append(_contradiction(answers["tilt to marble"], TILT))
    elif "marble" in wrong:
        findings.append(_contradiction(answers["marble"], None if "tilt" not in answers else commands))
    elif "tilt" in wrong:
        findings.append(_contradiction(answers["tilt"], commands))
    findings += _other_unit(rig, answers.get("tilt to marble"))
    return findings


def _contradiction(answer: Answer, guilty: tuple[str, str] | None) -> Finding:
    """Return the finding for a response; `guilty` are the columns to change, None if unknown."""
    facts, found = answer.facts, answer.response.best
    if guilty is None:
        swap = correction(found, facts.inputs, facts.outputs)
        advice = f"{swap}{_or_command(found, facts.inputs)}"
    elif guilty == facts.outputs and facts.outputs == MARBLE:
        # Swapped outputs: each then has the other's sign.
        signs = found.signs[::-1] if found.swapped else found.signs
        turned = (-signs[0], -signs[1]) if found.swapped else signs
        advice = correction(Convention(found.swapped, turned), MARBLE, MARBLE)
    else:
        # Output x answers to input y where the outputs are the marble's.
        crossed = facts.outputs == MARBLE
        names = (guilty[1], guilty[0]) if crossed else guilty
        advice = correction(found, guilty, names)
    response = answer.response
    nats = likelier_by(float(response.shares.max()), float(response.shares[0]), response.blocks)
    certain = nats >= CERTAIN and facts.best_explained >= SURE
    return Finding(
        "error" if certain else "warning",
        f"{_listed(facts.inputs)} move {_listed(facts.outputs)} against physics: of the eight ways to name "
        f"and turn two axes the declared one explains {100 * max(facts.explained, 0.0):.0f} % of the motion, "
        f"another {100 * facts.best_explained:.0f} %",
        "axes",
        advice,
    )


def likelier_by(explained: float, declared: float, blocks: int) -> float:
    """Return the log likelihood ratio of a fit against the declared one, by their explained shares [nats].

    Both likelihoods are normal with the residual variance of their fit. The degrees of freedom are the nearly
    independent blocks minus the fitted columns.
    """
    # A share of exactly 1 is rounding.
    left, before = max(1.0 - explained, 1e-12), max(1.0 - declared, 1e-12)
    return max(blocks - FITTED, 0) * float(np.log(before / left))


def _or_command(found: Convention, inputs: tuple[str, str]) -> str:
    """Return the command whose sign could be wrong instead of the marble's."""
    movers = (inputs[1], inputs[0])
    wrong = [name for name, sign in zip(movers, found.signs, strict=True) if sign < 0]
    return f" (or of {' and '.join(wrong)})" if wrong else ""


def _other_unit(rig: Rig, answer: Answer | None) -> list[Finding]:
    """Return a finding if the marble's acceleration per tilt is not that of a rolling sphere.

    A gain that matches a known error of units and differs significantly from a rolling sphere's is that
    error: neither friction nor spin halves the acceleration over a whole log.
    """
    if answer is None or answer.facts.delay_unit != "s" or answer.facts.contradicts:
        return []
    if answer.response.blocks < LEAST_BLOCKS or answer.facts.explained < SURE:
        return []
    facts = answer.facts
    pairs = [(facts.gain[0][1], facts.error[0][1]), (facts.gain[1][0], facts.error[1][0])]
    known = [(abs(gain), error) for gain, error in pairs if gain is not None and error is not None]
    if not known:
        return []
    gain = float(np.mean([one for one, _ in known]))
    if EXPECTED / _FACTOR < gain < EXPECTED * _FACTOR:
        return []
    apart = all(abs(one - EXPECTED) > _APART * error for one, error in known)
    slip = _slip(gain / EXPECTED, rig.board.edge_x_m)
    return [
        Finding(
            "error" if slip and apart else "warning",
            f"the marble accelerates by {gain:.3g} m/s^2 per rad of measured tilt, but a rolling sphere's "
            f"5/7 g is {EXPECTED:.2f}",
            "tilt to marble",
            slip or "check the units of tilt, positions and stamps, and edge_x_m",
        )
    ]


def _slip(ratio: float, edge_m: float) -> str:
    """Return the correction of units that explains a gain relative to the expected one; empty if none."""
    known = {
        np.pi / 180.0: "give the tilt in radians, it looks like degrees",
        edge_m: "divide the positions by the long edge, they look like metres",
    }
    for expected, advice in known.items():
        if 1.0 / _SAME < ratio / expected < _SAME:
            return advice
    return ""


def _listed(names: tuple[str, str]) -> str:
    return f"{names[0]} and {names[1]}"
