"""Findings about runs: gaps, held places, jumps, idle axes, clipping, rest, rim, repeated commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from irt.checking.result import Finding, RunFacts
from irt.checking.runs import row_step
from irt.recording import MARBLE, STAMP, Recording
from irt.rig import Rig

#: Number of rows below which a run hardly determines more than its own start state.
SHORT_ROWS = 8
#: Shares of rows above which a fact becomes a finding.
MOSTLY_LOST, SOME_HELD, OFTEN_CLIPPED, MOSTLY_REST, MOSTLY_RIM = 0.5, 0.005, 0.1, 0.6, 0.6
#: Tolerated relative difference of the rates of runs.
_SAME_RATE = 0.1
#: Smallest steps of a marble that was rolling before row 0 [board edges].
_ROLLING = 0.004
#: Jitter of the stamps, as a share of a row, above which there is a note.
UNEVEN = 0.2


def run_findings(rig: Rig, runs: Sequence[RunFacts]) -> Iterator[Finding]:
    """Yield findings about runs, one for all runs that share it."""
    step = row_step(rig)
    seconds = "" if step is None else f" of {step:.3g} s"
    # Severity, whether it applies to a run, text, advice; in order of harm to a fit.
    rules: tuple[tuple[str, Callable[[RunFacts], bool], str, str], ...] = (
        (
            "warning",
            lambda run: run.rows < SHORT_ROWS,
            f"fewer than {SHORT_ROWS} rows",
            "leave it out, or record a longer one",
        ),
        (
            "warning",
            lambda run: run.lost > MOSTLY_LOST and not _lacks_marble(rig, run),
            "the marble is lost in most rows",
            "improve light or tracker and record again",
        ),
        (
            "warning",
            lambda run: run.held > SOME_HELD,
            "positions of a lost marble are held, as exact repeats",
            "leave both marble cells empty in these rows",
        ),
        (
            "warning",
            lambda run: run.garbage > 0,
            "the first rows were logged before the tracker had found the marble",
            "cut them and renumber the steps from 0",
        ),
        (
            "warning",
            lambda run: run.tilt_jumps > 0,
            "the tilt jumps for some rows, as with a hidden marker",
            "leave the tilt cells empty in these rows",
        ),
        (
            "note",
            lambda run: run.pauses > 0,
            f"rows are missing between stamps, more than 1.5 rows{seconds} apart",
            "keep rows in which the marble was lost, with empty cells",
        ),
        (
            "note",
            lambda run: (run.jitter_s or 0.0) * (run.rate_hz or 0.0) > UNEVEN,
            "the time between rows varies by more than a fifth",
            "stamp the exposure of a picture, not its receipt",
        ),
        (
            "note",
            lambda run: max(run.clipped) > OFTEN_CLIPPED,
            "commands stay at their extreme values in a tenth of the rows or more",
            "stay below the actuators' limit, so that the log holds the actual commands",
        ),
        (
            "note",
            lambda run: run.at_rest > MOSTLY_REST and not _is_held(rig, run),
            "the marble rests in most rows",
            "tilt more, unless the run is meant to show static friction",
        ),
        (
            "note",
            lambda run: _is_held(rig, run),
            "the marble rests in most rows although the board tilts by more than friction holds",
            "if it lies in a hole, leave its marble cells empty: its tilt still counts; else tilt more",
        ),
        ("note", lambda run: run.at_rim > MOSTLY_RIM, "the marble is at the rim in most rows", "tilt less"),
        (
            "note",
            lambda run: run.repeats is not None,
            "the commands repeat those of an earlier run",
            "vary them",
        ),
    )
    for severity, holds, what, advice in rules:
        wrong = [run.name for run in runs if holds(run)]
        if wrong:
            yield Finding(severity, what, names(wrong), advice)  # type: ignore[arg-type]
    yield from _idle(runs)
    yield from _moving_start(rig, runs)
    yield from _rates(runs)


def names(of_runs: Sequence[str]) -> str:
    """Return the names of runs, shortened to the first ones."""
    return ", ".join(of_runs[:4]) + (f" and {len(of_runs) - 4} more" if len(of_runs) > 4 else "")


def _recording(rig: Rig, run: RunFacts) -> Recording:
    return next(one for one in rig.recordings if one.name == run.name)


def _lacks_marble(rig: Rig, run: RunFacts) -> bool:
    return not _recording(rig, run).has_marble


def _is_held(rig: Rig, run: RunFacts) -> bool:
    """Whether a marble rests in rows whose measured tilt exceeds any plausible rolling friction.

    Some rows do both if the shares of those that do either add up to more than all. A slow marble may seem to
    rest.
    """
    tilt = _recording(rig, run).tilt
    if run.at_rest <= MOSTLY_REST or tilt is None or not np.isfinite(tilt).any():
        return False
    _, friction = rig.ranges["rolling_friction"]
    inclined = np.hypot(*(tilt - np.nanmedian(tilt, axis=0)).T) > friction
    return run.at_rest + float(np.mean(inclined)) > 1.0


def _idle(runs: Sequence[RunFacts]) -> Iterator[Finding]:
    """Yield a note for each column that is constant in all runs that have it."""
    always = set(runs[0].idle).intersection(*(run.idle for run in runs))
    for column in sorted(always):
        if column in MARBLE:
            advice = "its noise and errors do not count; move it if the rig can"
        else:
            advice = "its effect cannot be identified; move it if the rig can"
        yield Finding("note", "never changes in any run", column, advice)


def _moving_start(rig: Rig, runs: Sequence[RunFacts]) -> Iterator[Finding]:
    """Yield a warning if the rig declares runs from rest and most of them are not."""
    if rig.start != "rest":
        return
    rolling = []
    for recording in rig.recordings:
        head = recording.marble[:4]
        if len(head) < 4 or not np.isfinite(head).all():
            continue
        steps = np.linalg.norm(np.diff(head, axis=0), axis=1)
        # From rest the second and third step are three and five times the first; noise adds its own.
        later = float(np.nanmedian(np.linalg.norm(np.diff(recording.marble, axis=0), axis=1)))
        if steps.min() > max(_ROLLING, 0.8 * later) and np.ptp(steps) < 0.5 * steps.max():
            rolling.append(recording.name)
    if len(rolling) > len(runs) / 2:
        yield Finding(
            "warning",
            "the marble is rolling in the first rows, but rig.toml declares a start at rest",
            names(rolling),
            'set start = "moving" under [recordings] in rig.toml',
        )


def _rates(runs: Sequence[RunFacts]) -> Iterator[Finding]:
    """Yield an error if only some runs have stamps, a warning if rates differ."""
    rates = {run.name: run.rate_hz for run in runs if run.rate_hz is not None}
    bare = [run.name for run in runs if run.rate_hz is None]
    if rates and bare:
        yield Finding(
            "error",
            "no stamps, while other runs have them",
            names(bare),
            f"add {STAMP}, or remove it from all runs",
        )
    elif rates:
        usual = float(np.median(list(rates.values())))
        other = [name for name, rate in rates.items() if abs(rate / usual - 1.0) > _SAME_RATE]
        if other:
            yield Finding(
                "warning",
                f"{rates[other[0]]:.3g} rows per second, but {usual:.3g} in most runs",
                names(other),
                "fit only runs of equal rate together: delays in rows are different times",
            )
