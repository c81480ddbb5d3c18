"""Units that look wrong: degrees, metres, pixels, a corner as origin, milliseconds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.checking.responses import EXPECTED, Answer
from irt.checking.result import Finding
from irt.checking.runs import row_step
from irt.engine import SUBSTEP_S
from irt.recording import KNOBS, MARBLE, STAMP
from irt.rig import PARAMETERS, Rig

Array = NDArray[np.float64]

#: Knobs of a labyrinth turn a quarter of a circle at most while a marble is steered [rad].
_MOST_KNOB = np.pi / 2.0
#: No knob of a labyrinth turns more than once [rad].
_FULL_TURN = 2.0 * np.pi
#: Gears this small a share of the largest one searched are another unit, if that unit's gear is plausible.
_SMALL_GEAR = 0.03
#: Positions this far beyond the rim, besides noise, are no slip of the tracker [board edges].
_BEYOND = 0.02
#: A lens shows the rim farther out by this much [board edges], seen on a practice rig.
_LENS = 0.12
#: Extents within this share of the rim's own in metres are metres.
_AS_METRES = 0.06
#: Rows of a camera are 1 ms to 1 s apart [s].
_SHORTEST_S, _LONGEST_S = 0.001, 1.0


def unit_findings(
    rig: Rig, marbles: Sequence[Array], noise: float, answers: dict[str, Answer]
) -> list[Finding]:
    """Return a finding for each unit that looks wrong.

    Parameters
    ----------
    rig : Rig
        The recordings.
    marbles : sequence of (n, 2) arrays
        Positions of each, NaN where they are no measurement.
    noise : float
        Of a position [board edges].
    answers : dict
        Of `irt.checking.responses.responses`.
    """
    return [*_knobs(rig, answers.get("marble")), *_positions(rig, marbles, noise), *_stamps(rig)]


def _knobs(rig: Rig, answer: Answer | None) -> list[Finding]:
    if rig.recordings[0].columns != KNOBS or rig.commands.unit != "rad":
        return []
    largest = max(float(np.abs(one.knobs).max()) for one in rig.recordings)
    advice = "multiply the knobs by pi/180 if they are degrees, or name their unit in [commands]"
    if largest > _MOST_KNOB:
        turn = f"{np.degrees(largest):.0f} degrees"
        return [
            Finding(
                "error" if largest > _FULL_TURN else "warning",
                f"commands reach {largest:.3g} rad, which is {turn}",
                "knob_x_rad, knob_y_rad",
                advice,
            )
        ]
    if answer is None or answer.facts.delay_unit != "s" or answer.facts.explained < 0.5:
        return []
    gears = [one for one in (answer.facts.gain[0][1], answer.facts.gain[1][0]) if one is not None]
    gear = float(np.mean(np.abs(gears))) / EXPECTED
    high = max(rig.ranges["gear_x"][1], rig.ranges["gear_y"][1])
    if gear < _SMALL_GEAR * high and np.degrees(gear) < high:
        return [
            Finding(
                "warning",
                f"gears would be {gear:.2g}, searched up to {high:g}",
                "knob_x_rad, knob_y_rad",
                advice,
            )
        ]
    return []


def _positions(rig: Rig, marbles: Sequence[Array], noise: float) -> list[Finding]:
    together = np.concatenate([one[np.isfinite(one).all(axis=1)] for one in marbles])
    if len(together) == 0:
        return []
    edges = np.array([rig.board.edge_x_m, rig.board.edge_y_m])
    reach_m = edges / 2.0 - rig.marble.radius_m
    reach = reach_m / rig.board.edge_x_m
    low, high = np.quantile(together, [0.002, 0.998], axis=0)
    furthest = reach * rig.ranges["observation_scale"][1] + _BEYOND + 3.0 * noise
    in_corner = bool((low > -_BEYOND - 3.0 * noise).all())
    # A lens may show the rim farther out; a corner as origin shows by the other sign, too.
    limit = furthest if in_corner else furthest + _LENS
    beyond = (high > limit) | (low < -limit)
    if beyond.any():
        wrong = [name for name, is_beyond in zip(MARBLE, beyond, strict=True) if is_beyond]
        place = float(np.where(high > -low, high, low)[beyond][0])
        # Where half of all places are none on the board, or all lie to one side of its centre and some beyond
        # the rim, that is no slip of a tracker and no lens.
        outside = (np.abs(together) > limit).any(axis=1)
        certain = in_corner or bool(np.mean(outside) > 0.5)
        if in_corner:
            advice = (
                f"the origin looks like a corner: subtract 0.5 from marble_x, "
                f"{edges[1] / edges[0] / 2.0:.3g} from marble_y"
            )
        elif beyond[1] and not beyond[0] and (high[1] - low[1]) < 2.0 * furthest[0]:
            advice = "are marble_x and marble_y swapped, or edge_x_m and edge_y_m?"
        else:
            advice = "check the unit of the positions, edge_x_m and edge_y_m"
        return [
            Finding(
                "error" if certain else "warning",
                f"the marble is seen at {place:.3g} edges, beyond the rim at {reach[beyond][0]:.3g}",
                ", ".join(wrong),
                advice,
            )
        ]
    near = [
        abs(end / metres - 1.0) < _AS_METRES
        for end, metres in zip((*high, *-low), (*reach_m, *reach_m), strict=True)
    ]
    if sum(near) >= 3:
        return [
            Finding(
                "warning",
                f"the marble turns back at {high[0]:.3g}, {high[1]:.3g}, which is the rim in metres",
                ", ".join(MARBLE),
                f"divide the positions by the long edge, {rig.board.edge_x_m:g} m",
            )
        ]
    return []


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
