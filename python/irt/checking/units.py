"""Detection of wrong units of commands and stamps: degrees, milliseconds."""

from __future__ import annotations

import numpy as np

from irt.checking.responses import EXPECTED, SURE, Answer
from irt.checking.result import Finding
from irt.checking.runs import row_step
from irt.engine import SUBSTEP_S
from irt.recording import KNOBS, STAMP
from irt.rig import PARAMETERS, Rig

#: Largest knob angle while a marble is steered [rad]: a quarter of a turn.
_MOST_KNOB = np.pi / 2.0
#: Largest knob angle of a labyrinth [rad]: one turn.
_FULL_TURN = 2.0 * np.pi
#: Share of the largest searched gear below which a gear indicates another unit, if that unit's gear is
#: plausible.
_SMALL_GEAR = 0.03
#: Factor by which least squares may leave the ranges.
_LEAVES = 3.0
#: Plausible times between a camera's rows [s].
_SHORTEST_S, _LONGEST_S = 0.001, 1.0


def unit_findings(rig: Rig, answers: dict[str, Answer]) -> list[Finding]:
    """Return a finding for each unit of commands and stamps that looks wrong.

    Parameters
    ----------
    rig : Rig
        The recordings.
    answers : dict
        From `irt.checking.responses.responses`.
    """
    return [*_knobs(rig, answers.get("marble")), *_stamps(rig)]


def _knobs(rig: Rig, answer: Answer | None) -> list[Finding]:
    """Return the finding on knobs that look like degrees.

    The recordings determine the board's tilt and thus the gear, which is 57.3 times larger for degrees than
    for radians. With a flat prior over the searched gears, degrees are 57.3 times likelier if their gear is
    in the range. The finding is certain for knob angles that no servo reaches, or if the gear of radians is
    out of the range. A range in rig.toml that only contains the gear of radians declares radians.
    """
    if rig.recordings[0].columns != KNOBS or rig.commands.unit != "rad":
        return []
    largest = max(float(np.abs(one.knobs).max()) for one in rig.recordings)
    ends = np.array([rig.ranges["gear_x"], rig.ranges["gear_y"]])
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    gear = _gear(answer)
    by_degrees = None if gear is None else float(np.degrees(gear))
    plausible = by_degrees is not None and low / _LEAVES <= by_degrees <= _LEAVES * high
    if gear is not None and plausible:
        certain = largest > _MOST_KNOB or gear < low / _LEAVES
    else:
        certain = gear is None and largest > _FULL_TURN
    small = gear is not None and plausible and gear < _SMALL_GEAR * high
    if not (certain or small or largest > _MOST_KNOB):
        return []
    what = f"commands reach {largest:.3g} rad, which is {np.degrees(largest):.0f} degrees"
    if gear is not None:
        what += (
            f"; the board moves by gears of {gear:.2g} if they are radians, {by_degrees:.2g} if they are "
            f"degrees, searched from {low:g} to {high:g}"
        )
    advice = (
        "they are degrees: multiply the knobs by pi/180, or name their unit in [commands]"
        if certain and gear is not None
        else "multiply the knobs by pi/180 if they are degrees, or name their unit in [commands]"
    )
    return [Finding("error" if certain else "warning", what, "knob_x_rad, knob_y_rad", advice)]


def _gear(answer: Answer | None) -> float | None:
    """Return the mean gear if the commands are radians; None if the recordings do not determine it."""
    if answer is None or answer.facts.delay_unit != "s" or answer.facts.explained < SURE:
        return None
    gears = [one for one in (answer.facts.gain[0][1], answer.facts.gain[1][0]) if one is not None]
    return float(np.mean(np.abs(gears))) / EXPECTED if gears else None


def _stamps(rig: Rig) -> list[Finding]:
    median = row_step(rig)
    if median is None:
        return []
    findings = []
    if not _SHORTEST_S <= median <= _LONGEST_S:
        unit = "milliseconds" if median > _LONGEST_S else "another unit"
        findings.append(
            Finding(
                "warning",
                f"rows are {median:.3g} s apart",
                STAMP,
                f"give stamps in seconds; are they {unit}?",
            )
        )
    else:
        low, high = rig.ranges[PARAMETERS[3]]
        scale = median / SUBSTEP_S
        if not low <= scale <= high:
            findings.append(
                Finding(
                    "warning",
                    f"rows are {median:.4g} s apart, which is a time_scale of {scale:.3g}, outside the range "
                    f"of {low:g} to {high:g}",
                    STAMP,
                    "check the unit of the stamps, or the range in rig.toml",
                )
            )
    return findings
