"""Advice on the next recording."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from irt.checking.findings import MOSTLY_LOST, MOSTLY_REST, MOSTLY_RIM
from irt.checking.result import Finding, Identified, RunFacts
from irt.rig import Rig

#: Correlation of the commands above which they move along one direction only.
_ONE_DIRECTION = 0.98
#: Share of a command's variance at one frequency above which it is a sinusoid ...
_SINUSOID = 0.9
#: ... and number of periods per run below which it is slow.
_FEW_PERIODS = 4.0
#: Minimum number of runs for cross-validation.
_LEAST_RUNS = 3
#: Maximum number of runs in an advice, relative to the recorded ones: half an hour of recording becomes two.
_MOST_TIMES = 4.0


def next_recording(  # noqa: PLR0911  # a list of rules; the first that applies is used
    rig: Rig, runs: Sequence[RunFacts], findings: Sequence[Finding], identified: Identified | None
) -> str:
    """Return the most useful next step in a sentence.

    Errors and warnings come first, then the time base, the commands, the positions of the marble, and last
    the number of runs.
    """
    for severity in ("error", "warning"):
        for one in findings:
            if one.severity == severity:
                return f"Fix this first: {one.where}: {one.advice}."
    if any(run.seconds is None for run in runs):
        return "Add stamps (a column t_s) to the next runs: without them times and speeds are unknown."
    commands = np.concatenate([one.knobs - one.knobs.mean(axis=0) for one in rig.recordings])
    spread = commands.std(axis=0)
    columns = rig.recordings[0].columns
    for axis in (0, 1):
        if not spread[axis] > 0.0:
            return f"Move {columns[axis]} too: it never changes, so its effect cannot be identified."
    if abs(float(np.corrcoef(commands.T)[0, 1])) > _ONE_DIRECTION:
        return f"Move {columns[0]} and {columns[1]} independently: so far they move along one direction only."
    shares = {
        name: float(np.average([getattr(run, name) for run in runs], weights=[run.rows for run in runs]))
        for name in ("at_rim", "at_rest", "lost")
    }
    if shares["at_rim"] > MOSTLY_RIM:
        return (
            f"Use smaller amplitudes: the marble is at the rim in {100 * shares['at_rim']:.0f} % of the rows."
        )
    if shares["at_rest"] > MOSTLY_REST:
        return f"Use larger amplitudes: the marble rests in {100 * shares['at_rest']:.0f} % of the rows."
    if shares["lost"] > MOSTLY_LOST:
        return f"Improve the tracker: the marble is lost in {100 * shares['lost']:.0f} % of the rows."
    if all(_is_slow_sinusoid(one.knobs[:, axis]) for one in rig.recordings for axis in (0, 1)):
        return "Add steps and faster changes: both commands follow one slow sinusoid, which hides delays."
    if identified is not None and (more := _more_runs(rig, identified)):
        return more
    return _to_hold_out(len(rig.recordings))


def _to_hold_out(runs: int) -> str:
    """Return the advice on the number of runs for held-out tests."""
    few = _LEAST_RUNS - runs
    if few <= 0:
        return "No further recording is needed: tune and diagnose these recordings."
    more = "1 more run" if few == 1 else f"{few} more runs"
    return f"These recordings suffice for a fit. Record {more} with other commands to hold out."


def _is_slow_sinusoid(command: np.ndarray) -> bool:
    power = np.abs(np.fft.rfft(command - command.mean())) ** 2
    if len(power) < 3 or not power.sum() > 0.0:
        return False
    line = int(np.argmax(power))
    # A period that does not divide the run leaks into the neighbouring lines.
    share = float(power[max(line - 1, 0) : line + 2].sum() / power.sum())
    return share > _SINUSOID and line < _FEW_PERIODS


def _more_runs(rig: Rig, identified: Identified) -> str:
    """Return the advice on more runs like these that would reveal effects nearly within reach."""
    near = [one for one in identified.effects if 1.0 < one.runs <= _MOST_TIMES]
    if not near:
        return ""
    near.sort(key=lambda one: one.runs)
    # Only half of the effects within reach, because the rest need many more runs.
    wanted = near[: (len(near) + 1) // 2]
    count = math.ceil(len(rig.recordings) * (wanted[-1].runs - 1.0))
    return (
        f"Record {count} more run{'s' if count > 1 else ''} like these: then "
        f"{', '.join(dict.fromkeys(one.effect for one in wanted))} of usual size would be detectable as well."
    )
