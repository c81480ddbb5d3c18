"""When pictures were taken: gaps between them, the same one twice, and where the commands' clock stands.

A video and a file of commands have clocks of their own. What joins them is that the marble accelerates as the
knobs say: along x with knob_y, along y against knob_x. Both sides are weighed with the same smooth bump, its
second derivative on the positions (an integration by parts, so that no noise is differentiated), and the
offset is where the commands explain the accelerations best. A delay of the rig looks like an offset, and is
in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError

Array = NDArray[np.float64]

#: Interval between pictures, over the usual one, from which on some are missing.
DROPPED = 1.5
#: Share of the usual interval by which another one differs from it.
UNEVEN = 0.1
#: A converter of frame rates repeats a picture up to so many times in a row, and an encoder changes the
#: repeats: by less than this share of what the pictures on either side change by.
MOST_CODED, CODED = 3, 1.0 / 3.0
#: Width of the bump [s], and the step at which both sides are weighed.
BUMP_S, STEP_S = 0.4, 1.0 / 240.0
#: Parts of a run whose offsets, each left out in turn, show how sure their mean is.
PARTS = 8
#: Accelerations that miss the explained ones by so many times the median are no answers.
UNANSWERED = 3.0
#: Least share of the accelerations that commands must explain.
EXPLAINED = 0.2


@dataclass(frozen=True)
class Gaps:
    """What is wrong with the stamps of a run.

    Attributes
    ----------
    interval : float
        The usual time from picture to picture [s].
    jitter : float
        Standard deviation of the others about it [s].
    dropped : int
        Pictures that are missing, by the intervals that are longer.
    longest : float
        The longest interval [s].
    repeated : int
        Pictures that show the one before once more.
    uneven : float
        Share of the intervals that differ from the usual one by more than a tenth of it.
    """

    interval: float
    jitter: float
    dropped: int
    longest: float
    repeated: int
    uneven: float


def find_gaps(stamps: Array, repeated: NDArray[np.bool_]) -> Gaps:
    """Return what stamps (n,) [s] and repetitions (n,) show."""
    if len(stamps) < 2:
        return Gaps(0.0, 0.0, 0, 0.0, int(repeated.sum()), 0.0)
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    missing = np.where(steps > DROPPED * usual, np.rint(steps / usual) - 1, 0)
    normal = steps[steps <= DROPPED * usual]
    uneven = float((np.abs(steps - usual) > UNEVEN * usual).mean())
    return Gaps(
        usual, float(normal.std()), int(missing.sum()), float(steps.max()), int(repeated.sum()), uneven
    )


def repeated_by_encoder(changes: Array) -> NDArray[np.bool_]:
    """Return which pictures (n,) show the one before once more, although an encoder changed them a little.

    They change less than the pictures on either side of up to `MOST_CODED` in a row. Pictures of a marble at
    rest do so for longer.

    Parameters
    ----------
    changes : (n,) array
        By how much each picture differs from the one before; infinite for the first.
    """
    again = np.zeros(len(changes), dtype=bool)
    for count in range(1, MOST_CODED + 1):
        for first in range(1, len(changes) - count):
            sides = min(changes[first - 1], changes[first + count])
            if changes[first : first + count].max() < CODED * sides:
                again[first : first + count] = True
    return again


@dataclass(frozen=True)
class Alignment:
    """How two clocks lie to each other.

    Attributes
    ----------
    offset : float
        What to add to the commands' stamps to have those of the pictures [s].
    error : float
        Its standard error [s].
    explained : float
        Share of the marble's accelerations that the commands explain, from 0 to 1.
    """

    offset: float
    error: float
    explained: float


def align(
    command_stamps: Array, knobs: Array, stamps: Array, marble: Array, reach: float | None = None
) -> Alignment:
    """Find the offset between the clocks of commands and pictures.

    Parameters
    ----------
    command_stamps, knobs : (m,) [s] and (m, 2) [rad] arrays
        Each command holds until the next.
    stamps, marble : (n,) [s] and (n, 2) [board edges] arrays
        NaN where the marble is lost.
    reach : float, optional
        Largest offset that is tried [s]; by default all at which half of the shorter run overlaps.

    Raises
    ------
    IrtError
        If the accelerations follow the commands nowhere.
    """
    shorter = min(np.ptp(stamps), np.ptp(command_stamps))
    if shorter < 4 * BUMP_S:
        raise IrtError(f"{shorter:.2g} s are too short to align commands and video by")
    seen, weights, ways = _accelerations(stamps, marble)
    pushes = _weighed_commands(command_stamps, knobs)
    low = stamps[0] - command_stamps[-1] + shorter / 2
    high = stamps[-1] - command_stamps[0] - shorter / 2
    if reach is not None:
        low, high = max(low, -reach), min(high, reach)
    # Both lie on grids of the same step from their own first stamps.
    base = stamps[0] - command_stamps[0]
    lags = np.arange(int(np.ceil((low - base) / STEP_S)), int(np.floor((high - base) / STEP_S)) + 1)
    if not len(lags):
        lags = np.array([0])
    scores = np.array([_explained(seen, ways, weights, pushes, int(lag))[0] for lag in lags])
    # By likelihood: where little overlaps, chance explains more.
    shared = np.array([weights[max(lag, 0) : max(lag + len(pushes), 0)].sum() for lag in lags])
    best = int(np.argmax(-shared * np.log1p(-np.clip(scores, 0.0, 1.0 - 1e-9))))
    if not scores[best] > EXPLAINED:
        raise IrtError(
            "the marble's accelerations follow these commands at no offset: are they of this run, and in the "
            "board's axes? --offset SECONDS says where they begin"
        )
    near = slice(max(best - 30, 0), best + 31)
    for _ in range(3):
        # A marble that leans on the rim answers no command.
        weights = _answering(seen, ways, weights, pushes, int(lags[best]))
        scores[near] = [_explained(seen, ways, weights, pushes, int(lag))[0] for lag in lags[near]]
        best = near.start + int(np.argmax(scores[near]))
    offset = base + STEP_S * _peak(lags[near], scores[near])
    pieces = []
    edges = np.linspace(0, len(weights), PARTS + 1).astype(int)
    for first, last in pairwise(edges):
        kept = weights.copy()
        kept[first:last] = 0.0
        if kept.sum() > 0.3 * weights.sum():
            part = np.array([_explained(seen, ways, kept, pushes, int(lag))[0] for lag in lags[near]])
            pieces.append(base + STEP_S * _peak(lags[near], part))
    # The jackknife: offsets of the parts left in, about their mean.
    count = len(pieces)
    error = float(np.sqrt((count - 1) / count * np.sum((np.array(pieces) - np.mean(pieces)) ** 2)))
    return Alignment(float(offset), error, float(scores[best]))


def _bump() -> tuple[Array, Array]:
    """Return a smooth bump of area 1 over the grid, and its second derivative."""
    half = round(BUMP_S / 2 / STEP_S)
    place = np.arange(-half, half + 1) / half
    bump = (1 - place**2) ** 3
    second = -6 * (1 - place**2) ** 2 + 24 * place**2 * (1 - place**2)
    area = bump.sum() * STEP_S
    return bump / area, second / area / (half * STEP_S) ** 2


def _accelerations(stamps: Array, marble: Array) -> tuple[Array, Array, Array]:
    """Return accelerations (k, 2) [edges/s^2] on the grid, whether each is known (k,), and ways (k, 2).

    A way is the direction of motion, of length 1 at most.
    """
    grid = np.arange(stamps[0], stamps[-1], STEP_S)
    seen = ~np.isnan(marble[:, 0])
    path = np.column_stack([np.interp(grid, stamps[seen], marble[seen, axis]) for axis in range(2)])
    after = np.clip(np.searchsorted(stamps[seen], grid), 1, seen.sum() - 1)
    apart = stamps[seen][after] - stamps[seen][after - 1]
    hole = apart > 2.5 * float(np.median(np.diff(stamps)))
    _, second = _bump()
    width = len(second)
    known = np.convolve(hole, np.ones(width), mode="same") == 0
    known[: width // 2] = known[len(known) - width // 2 :] = False
    # The bump's second derivative has no mean: positions are taken from about zero, which rounding thanks.
    path = path - path.mean(axis=0)
    curved = np.column_stack([np.convolve(path[:, axis], second, mode="same") for axis in range(2)]) * STEP_S
    # What the rim does to a marble is no answer to a command.
    size = np.abs(curved).max(axis=1)
    known &= size < 6.0 * np.median(size[known]) if known.any() else False
    return curved, known.astype(np.float64), _ways(path)


def _ways(path: Array) -> Array:
    """Return the directions of motion (k, 2) along a path on the grid, weighed with the bump."""
    bump, _ = _bump()
    speed = np.gradient(path, STEP_S, axis=0)
    smooth = np.column_stack([np.convolve(speed[:, axis], bump, mode="same") for axis in range(2)]) * STEP_S
    size = np.linalg.norm(smooth, axis=1, keepdims=True)
    return np.asarray(smooth / (size + 0.2 * np.median(size) + 1e-12))


def _weighed_commands(stamps: Array, knobs: Array) -> Array:
    """Return the commands as they push along x and y (k, 2), weighed with the bump, on the grid."""
    grid = np.arange(stamps[0], stamps[-1], STEP_S)
    row = np.searchsorted(stamps, grid, side="right") - 1
    pushes = np.column_stack([knobs[row, 1], -knobs[row, 0]])
    bump, _ = _bump()
    return np.column_stack([np.convolve(pushes[:, axis], bump, mode="same") for axis in range(2)]) * STEP_S


def _explained(
    seen: Array, ways: Array, weights: Array, pushes: Array, lag: int
) -> tuple[float, Array, Array]:
    """Return the share of the accelerations that commands moved by a lag explain, their gears, and drags.

    A tilt that stays is allowed for: means are taken off. What drag alone explains is nobody's credit.
    """
    none = np.zeros(2)
    first, last = max(lag, 0), min(lag + len(pushes), len(seen))
    if last - first < 2 * round(BUMP_S / STEP_S):
        return 0.0, none, none
    kept = weights[first:last, None]
    total = kept.sum()
    if total < 10:
        return 0.0, none, none

    def freed(values: Array) -> Array:
        return np.asarray(values - (kept * values).sum(axis=0) / total)

    push, way, answer = (
        freed(pushes[first - lag : last - lag]),
        freed(ways[first:last]),
        freed(seen[first:last]),
    )
    pp, pw, ww = (kept * push**2).sum(axis=0), (kept * push * way).sum(axis=0), (kept * way**2).sum(axis=0)
    pa, wa = (kept * push * answer).sum(axis=0), (kept * way * answer).sum(axis=0)
    size = pp * ww - pw**2 + 1e-30
    gears, drags = (pa * ww - wa * pw) / size, (wa * pp - pa * pw) / size
    left = (kept * (answer - gears * push - drags * way) ** 2).sum()
    alone = (kept * (answer - wa / (ww + 1e-30) * way) ** 2).sum()
    return float(1.0 - left / (alone + 1e-30)), gears, drags


def _answering(seen: Array, ways: Array, weights: Array, pushes: Array, lag: int) -> Array:
    """Return the weights without the accelerations that commands moved by a lag do not explain."""
    first, last = max(lag, 0), min(lag + len(pushes), len(seen))
    _, gears, drags = _explained(seen, ways, weights, pushes, lag)
    known = weights[first:last] > 0
    left = seen[first:last] - gears * pushes[first - lag : last - lag] - drags * ways[first:last]
    left = np.abs(left - np.median(left[known], axis=0)).max(axis=1)
    kept = np.zeros_like(weights)
    kept[first:last] = known & (left < UNANSWERED * np.median(left[known]))
    return kept


def _peak(lags: NDArray[np.int64], scores: Array) -> float:
    """Return where a parabola through the largest score and those beside it is highest."""
    best = int(np.clip(int(np.argmax(scores)), 2, max(len(scores) - 3, 2)))
    near = slice(best - 2, best + 3)
    if len(lags[near]) < 3:
        return float(lags[int(np.argmax(scores))])
    curve = np.polyfit(lags[near] - lags[best], scores[near], 2)
    if curve[0] >= 0:
        return float(lags[best])
    return float(lags[best] + np.clip(-curve[1] / (2 * curve[0]), -2.0, 2.0))


def at_commands(stamps: Array, marble: Array, times: Array) -> Array:
    """Return where the marble is (m, 2) at the times of commands (m,), NaN where no picture shows it.

    Between two pictures in a row it lies on the cubic through those two and their neighbours. A picture
    speaks for one command only: where commands are faster, the others stay empty.
    """
    usual = float(np.median(np.diff(stamps)))
    answer = np.full((len(times), 2), np.nan)
    nearest = _nearest(stamps, times)
    close = np.abs(stamps[nearest] - times) <= 0.5 * usual * 1.05
    best: dict[int, int] = {}
    for row in np.flatnonzero(close).tolist():
        picture = int(nearest[row])
        other = best.get(picture)
        if other is None or abs(times[row] - stamps[picture]) < abs(times[other] - stamps[picture]):
            best[picture] = row
    for seen, row in best.items():
        answer[row] = _between(stamps, marble, float(times[row]), seen, usual)
    return answer


def _nearest(stamps: Array, times: Array) -> NDArray[np.int64]:
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    return np.where(times - stamps[after - 1] < stamps[after] - times, after - 1, after)


def _between(stamps: Array, marble: Array, time: float, picture: int, usual: float) -> Array:
    """Return the place at a time near a picture, NaN if that picture or its neighbour there is lost."""
    if abs(time - stamps[picture]) < 1e-6 * usual:
        return np.asarray(marble[picture])
    first = picture if time > stamps[picture] else picture - 1
    rows = [row for row in range(first - 1, first + 3) if 0 <= row < len(stamps)]
    if first < 0 or first + 1 >= len(stamps) or np.isnan(marble[[first, first + 1]]).any():
        return np.full(2, np.nan)
    whole = len(rows) == 4 and not np.isnan(marble[rows]).any() and np.ptp(stamps[rows]) < 4.5 * usual
    rows = rows if whole else [first, first + 1]
    if stamps[first + 1] - stamps[first] > DROPPED * usual:
        return np.full(2, np.nan)
    weights = np.array(
        [np.prod([(time - stamps[k]) / (stamps[j] - stamps[k]) for k in rows if k != j]) for j in rows]
    )
    return np.asarray(weights @ marble[rows])
