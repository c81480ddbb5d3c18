"""Detection of wrong units of commands and stamps: degrees, milliseconds."""

from __future__ import annotations

import numpy as np

from irt.checking.responses import EXPECTED, SURE, Answer
from irt.checking.result import Finding
from irt.checking.runs import row_step
from irt.engine import SUBSTEP_S
from irt.recording import KNOBS, STAMP
from irt.rig import PARAMETERS, RANGES, Rig

#: Largest knob angle while a marble is steered [rad]: a quarter of a turn.
_MOST_KNOB = np.pi / 2.0
#: No knob of a labyrinth turns further from level: its board meets a stop before [rad].
_HALF_TURN = np.pi
#: Gears this small a share of the largest one searched are another unit, if that unit's gear is plausible.
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
    return [*_knobs(rig, _gear(answers)), *_stamps(rig)]


def _knobs(rig: Rig, gear: float | None) -> list[Finding]:
    """Return the finding on knobs that look like degrees; `gear` is theirs if they are radians.

    The recordings give the tilt of the board, and so the gear, once for radians and 57.3 times that for
    degrees. Under a flat prior over the gears searched degrees are then 57.3 times likelier, if their gear is
    among those. With knobs that no servo turns, or where the gear of radians is not among those, that is
    certain; a range in rig.toml that holds the gear of radians alone says that they are radians.
    Without stamps or a measured tilt the gear is unknown: knobs beyond half a turn are certainly degrees,
    unless rig.toml has a range for the gears, so that somebody has thought about them.
    """
    if rig.recordings[0].columns != KNOBS or rig.commands.unit != "rad":
        return []
    largest = max(float(np.abs(one.knobs).max()) for one in rig.recordings)
    ends = np.array([rig.ranges["gear_x"], rig.ranges["gear_y"]])
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    by_degrees = None if gear is None else float(np.degrees(gear))
    plausible = by_degrees is not None and low / _LEAVES <= by_degrees <= _LEAVES * high
    if gear is not None and plausible:
        certain = largest > _MOST_KNOB or gear < low / _LEAVES
    else:
        own_range = any(rig.ranges[name] != RANGES[name] for name in ("gear_x", "gear_y"))
        certain = gear is None and largest > _HALF_TURN and not own_range
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


def _gear(answers: dict[str, Answer]) -> float | None:
    """Return the mean gear if the commands are radians; None where the recordings do not say it.

    The marble says it where stamps give the time, the measured tilt always.
    """
    marble, tilt = answers.get("marble"), answers.get("tilt")
    if marble is not None and marble.facts.delay_unit == "s" and marble.facts.explained >= SURE:
        (_, first), (second, _) = marble.facts.gain
        expected = EXPECTED
    elif tilt is not None and tilt.facts.explained >= SURE:
        (first, _), (_, second) = tilt.facts.gain
        expected = 1.0
    else:
        return None
    gears = [one for one in (first, second) if one is not None]
    return float(np.mean(np.abs(gears))) / expected if gears else None


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
