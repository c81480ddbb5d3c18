"""Facts about each run: time base, gaps, held positions, rest, rim, and range of commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.checking.result import RunFacts, SignalFacts
from irt.checking.signals import held_mask
from irt.cleaning import garbage_rows, mask_spans, tilt_jumps
from irt.recording import MARBLE, TILT, Recording
from irt.rig import PARAMETERS, Rig
from irt.segments import row_seconds

Array = NDArray[np.float64]

#: Step between stamps, relative to the median, that is a pause with missing rows.
PAUSE = 1.5
#: A marble rests if it stays within this many standard deviations of the tracker ...
_STILL = 6.0
#: ... for this time [s] and at least this many rows.
_REST_S, _REST_ROWS = 0.4, 5
#: Distance from the rim within which a marble touches it [board edges]: 1 mm on the paper's board, plus
#: noise.
_AT_RIM = 0.004
#: Largest distance from the centre a row after a start there [board edges].
_START_STEP = 0.02
#: Number of successive rows at an extreme for clipped commands; a turning point lasts a row or two.
_CLIPPED_ROWS = 3
#: Number of levels below which commands are steps by design, which stay at their extremes.
_LEAST_LEVELS = 9


def run_facts(
    rig: Rig, cleaned: Sequence[tuple[Array, Array | None]], signals: Sequence[SignalFacts]
) -> tuple[RunFacts, ...]:
    """Return the facts of every run."""
    noise = [one.noise or 0.0 for one in signals if one.column in MARBLE] or [0.0, 0.0]
    rim = rim_masks(rig, [marble for marble, _ in cleaned], max(noise))
    commands = np.concatenate([one.knobs for one in rig.recordings])
    extremes = [(float(of_axis.min()), float(of_axis.max())) for of_axis in commands.T]
    seen: dict[bytes, str] = {}
    found = []
    for recording, (marble, _), touches in zip(rig.recordings, cleaned, rim, strict=True):
        key = recording.knobs.tobytes()
        repeats = seen.setdefault(key, recording.name)
        found.append(
            _facts(
                rig,
                recording,
                marble,
                touches,
                noise=max(noise),
                extremes=extremes,
                repeats=None if repeats == recording.name else repeats,
            )
        )
    return tuple(found)


def row_step(rig: Rig) -> float | None:
    """Return the median time between two rows [s]; None unless all runs have stamps."""
    steps = [one.durations for one in rig.recordings if one.durations is not None]
    return float(np.median(np.concatenate(steps))) if len(steps) == len(rig.recordings) else None


def rim_masks(rig: Rig, marbles: Sequence[Array], noise: float) -> list[NDArray[np.bool_]]:
    """Return the rows in which the marble of each run touches the rim along x and y, (n, 2) each.

    The rim is at the extreme positions of the marble, if these agree with the board's size, the marble's
    radius and the range of the observation scale, for either assignment of the axes.
    """
    together = np.concatenate([one[np.isfinite(one).all(axis=1)] for one in marbles])
    if len(together) == 0:
        return [np.zeros(one.shape, dtype=bool) for one in marbles]
    low, high = np.quantile(together, [0.001, 0.999], axis=0)
    short = min(rig.board.edge_x_m, rig.board.edge_y_m) / 2.0 - rig.marble.radius_m
    least = short / rig.board.edge_x_m * rig.ranges["observation_scale"][0] - 3.0 * noise
    margin = _AT_RIM + 3.0 * noise
    with np.errstate(invalid="ignore"):
        return [
            ((one > high - margin) & (high > least)) | ((one < low + margin) & (low < -least))
            for one in marbles
        ]


def _facts(
    rig: Rig,
    recording: Recording,
    marble: Array,
    touches: NDArray[np.bool_],
    *,
    noise: float,
    extremes: Sequence[tuple[float, float]],
    repeats: str | None,
) -> RunFacts:
    rows = len(recording.knobs)
    timing = _timing(recording)
    seen = np.isfinite(marble[:, 0])
    held = held_mask(recording.marble) if recording.has_marble else np.zeros(rows, dtype=bool)
    gaps = mask_spans(~seen) if recording.has_marble else []
    step = row_seconds(recording, sum(rig.ranges[PARAMETERS[3]]) / 2.0)
    rests = at_rest(marble, noise, step)
    count = max(int(seen.sum()), 1)
    knobs = recording.knobs
    jumps = 0 if recording.tilt is None else int(tilt_jumps(recording.tilt, recording.stamps).sum())
    return RunFacts(
        name=recording.name,
        rows=rows,
        seconds=timing.get("seconds"),
        rate_hz=timing.get("rate"),
        jitter_s=timing.get("jitter"),
        pauses=int(timing.get("pauses", 0)),
        lost=float(np.mean(~recording.seen)) if recording.has_marble else 0.0,
        longest_gap=max((end - first for first, end in gaps), default=0),
        held=float(held.mean()),
        tilt_jumps=jumps,
        garbage=_garbage(recording),
        at_rest=float((rests & seen).sum() / count),
        at_rim=float((touches.any(axis=1) & seen).sum() / count),
        command_range=(
            (float(knobs[:, 0].min()), float(knobs[:, 0].max())),
            (float(knobs[:, 1].min()), float(knobs[:, 1].max())),
        ),
        clipped=(_clipped(knobs[:, 0], extremes[0]), _clipped(knobs[:, 1], extremes[1])),
        idle=_idle(recording, marble),
        repeats=repeats,
    )


def _garbage(recording: Recording) -> int:
    """Return the number of first rows that were logged before the tracker had found the marble.

    A simulated marble may start exactly in the centre; it then continues from there.
    """
    rows = garbage_rows(recording.marble, recording.tilt) if recording.has_marble else 0
    if rows == 0 or (recording.tilt is not None and (recording.tilt[:rows] == 0.0).all()):
        return rows
    return rows if float(np.linalg.norm(recording.marble[rows])) > _START_STEP else 0


def _timing(recording: Recording) -> Mapping[str, float]:
    """Return duration [s], rate [1/s], jitter [s] and number of pauses, if there are stamps."""
    if recording.stamps is None:
        return {}
    steps = np.diff(recording.stamps)
    median = float(np.median(steps))
    regular = steps[steps < PAUSE * median]
    return {
        "seconds": float(recording.stamps[-1] - recording.stamps[0]),
        "rate": 1.0 / median,
        "jitter": float(regular.std()),
        "pauses": float(len(steps) - len(regular)),
    }


def at_rest(marble: Array, noise: float, step_s: float) -> NDArray[np.bool_]:
    """Return the rows of (n, 2) positions in which the marble rests, (n,)."""
    rows = max(_REST_ROWS, round(_REST_S / step_s))
    rests = np.zeros(len(marble), dtype=bool)
    if len(marble) < rows:
        return rests
    stretches = np.lib.stride_tricks.sliding_window_view(marble, rows, axis=0)
    still = (np.ptp(stretches, axis=2) <= _STILL * noise).all(axis=1)
    for first in np.flatnonzero(still):
        rests[first : first + rows] = True
    return rests


def _clipped(commands: Array, extremes: tuple[float, float]) -> float:
    """Return the share of rows in which a command stays at an extreme of all runs; 0 for few levels."""
    if len(np.unique(commands)) < _LEAST_LEVELS:
        return 0.0
    rows = 0
    for end in extremes:
        spans = mask_spans(commands == end)
        rows += sum(last - first for first, last in spans if last - first >= _CLIPPED_ROWS)
    return rows / len(commands)


def _idle(recording: Recording, marble: Array) -> tuple[str, ...]:
    """Return the columns that never change."""
    columns = dict(zip(recording.columns, recording.knobs.T, strict=True))
    if recording.has_marble:
        columns.update(zip(MARBLE, marble.T, strict=True))
    if recording.tilt is not None:
        columns.update(zip(TILT, recording.tilt.T, strict=True))
    idle = []
    for name, values in columns.items():
        known = values[np.isfinite(values)]
        if len(known) > 1 and not np.ptp(known) > 0.0:
            idle.append(name)
    return tuple(idle)
