"""Locate the residuals of a hypothesis: runs, times, regions of the board, regimes of motion, stages."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.dataset import Dataset, Fitted
from irt.diagnosis.latent_force import Source
from irt.diagnosis.result import Finding, Kind
from irt.diagnosis.terms import Term
from irt.diagnosis.windows import ROWS, Windows
from irt.engine import SUBSTEP_S

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Number of simulated nulls, and smallest share of rows of a place that is tested.
NULLS, FEWEST = 199, 0.02
#: Largest p-value of a reported place, and most reported places of each kind.
CLEAR, MOST = 0.05, 3
#: Largest speed of a marble at rest [board edges per row], and rows after a reversal that count as near it.
_REST, _NEAR = 0.001, 2


def locate(fitted: Fitted, noise: float) -> list[Finding]:
    """Find the places where residuals in short windows exceed those of simulated nulls.

    The noise [board edges] is that of the tracker. The strength of a place is its share of the squared
    residuals beyond noise. Its p-value is the share of nulls in which any place stands out as much, which
    corrects for the number of places tested.
    """
    dataset, screen = fitted.dataset, Windows(fitted, ROWS)
    squares, nulls = screen.squared(NULLS, dataset.seed, noise)
    beyond = squares - nulls.mean(axis=0)
    total = max(float(beyond.sum()), 1e-300)
    places = [
        (kind, what, mask)
        for kind, what, mask in _places(dataset, fitted.model.reach, screen)
        if mask.mean() > FEWEST
    ]
    results, highest = [], np.zeros(NULLS)
    for kind, what, mask in places:
        sums = nulls[:, mask].sum(axis=1)
        mean, spread = float(sums.mean()), max(float(sums.std()), 1e-12)
        highest = np.maximum(highest, (sums - mean) / spread)
        results.append(
            (kind, what, float(beyond[mask].sum()) / total, (float(squares[mask].sum()) - mean) / spread)
        )
    findings = []
    for kind, what, share, height in results:
        chance = float((1 + (highest >= height).sum()) / (1 + NULLS))
        findings.append(Finding(kind, what, min(max(share, 0.0), 1.0), chance))
    return _strongest(findings)


def stages(fitted: Fitted, sources: Sequence[Source], found: Collection[str] = ()) -> list[Finding]:
    """Return the stages that could cause the residuals, with variable and size.

    A flexible push or shift at each stage is compared by restricted likelihood. The strength is the ratio of
    its log-likelihood to that of the best stage, so that equal explanations have equal strengths.

    Parameters
    ----------
    fitted : Fitted
        The model whose residuals are explained.
    sources : sequence of Source
        What they may depend on, the likeliest first.
    found : collection of str
        Stages of effects that explain all of the residuals, as in `effect`: a flexible push at another stage
        only resembles these. Empty where something remains.
    """
    acting = {_SOURCES[stage] for stage in found} or _STAGES.keys()
    clear = [
        one
        for one in sources
        if one.stage in acting and one.p_value <= CLEAR and one.gain > 0.0 and one.repeats
    ]
    best: dict[str, Source] = {}
    for one in clear:
        best.setdefault(one.stage, one)
    return [
        Finding(
            "stage",
            f"{_STAGES[one.stage]}: {_size(fitted, one)} that depends on {_VARIABLES[one.variable]}",
            one.gain / clear[0].gain,
            one.p_value,
        )
        for one in best.values()
    ]


def _size(fitted: Fitted, source: Source) -> str:
    """Return the RMS of a push or of a shift of the picture, in words."""
    dataset = fitted.dataset
    metres = source.push * dataset.edge_m(fitted)
    if source.stage == "camera":
        return f"a shift of {1000.0 * metres:.2g} mm"
    if dataset.time_scale is None:
        return f"a push of {1000.0 * metres:.2g} mm/row²"
    return f"a push of {metres / dataset.row_s(fitted) ** 2:.2g} m/s²"


def variables(terms: Sequence[Term], sources: Sequence[Source]) -> list[Finding]:
    """Return the variables of a learned push, with the shares of the residuals that they explain."""
    found = []
    for variable in dict.fromkeys(name for term in terms for name in term.depends_on):
        chances = [one.p_value for one in sources if one.variable == variable]
        found.append(
            Finding(
                _KINDS[variable],
                f"the missing push depends on {_VARIABLES[variable]}",
                min(1.0, sum(term.explained for term in terms if variable in term.depends_on)),
                min(chances, default=CLEAR),
            )
        )
    return found


_STAGES = {
    "force": "between board and marble",
    "command": "between command and board",
    "camera": "between marble and picture",
}
#: Stages of effects, and the stage at which a flexible push or shift acts like them.
_SOURCES = {
    "actuation": "command",
    "timing": "command",
    "board": "force",
    "contact": "force",
    "air": "force",
    "field": "force",
    "sensing": "camera",
}
_VARIABLES = {
    "position": "the position on the board",
    "velocity": "the velocity of the marble",
    "command": "the command",
    "command history": "the command and its history",
    "command rate": "the rate of the command",
    "time": "the time since the start of the recording",
    "heading": "the direction of motion",
    "way": "the path length of the marble",
}
_KINDS: dict[str, Kind] = {
    "position": "region",
    "velocity": "regime",
    "heading": "regime",
    "time": "time",
    "way": "time",
    "command": "stage",
    "command rate": "stage",
}


def _places(dataset: Dataset, reach: Array, screen: Windows) -> Iterator[tuple[Kind, str, Mask]]:
    """Yield the places to test, with masks of the rows of all windows, (w * n,)."""
    windows = screen.windows()
    place = np.concatenate([one.place for one in windows])
    velocity = np.concatenate([np.gradient(one.place, axis=0) for one in windows])
    knobs = np.concatenate([one.knobs for one in windows])
    turn = np.concatenate([one.turn for one in windows])
    rows = np.concatenate([one.first + np.arange(len(one.place)) for one in windows])
    run = np.concatenate([np.full(len(one.place), one.run) for one in windows])
    for fold in np.unique(run):
        yield "run", dataset.rig.recordings[fold].name, run == fold
    quarters = np.linspace(0, rows.max() + 1, 5).astype(int)
    for first, after in pairwise(quarters):
        between = f"rows {first} to {after - 1}"
        if dataset.time_scale is not None:
            row_s = dataset.time_scale * SUBSTEP_S
            between += f" ({first * row_s:.1f} to {after * row_s:.1f} s)"
        yield "time", between, (rows >= first) & (rows < after)
    yield from _regions(dataset, place)
    yield from _regimes(reach, place, velocity, knobs, turn)


def _regions(dataset: Dataset, place: Array) -> Iterator[tuple[Kind, str, Mask]]:
    board = dataset.rig.board
    half = np.array([0.5, 0.5 * board.edge_y_m / board.edge_x_m])
    cells = np.clip(np.floor((place / half + 1.0) * 1.5), 0, 2).astype(int)
    across, along = ("left", "middle", "right"), ("near", "middle", "far")
    for i, x in enumerate(across):
        for j, y in enumerate(along):
            what = "the middle of the board" if x == y == "middle" else f"{x} in x, {y} in y"
            yield "region", what, (cells == [i, j]).all(axis=1)


def _regimes(
    reach: Array, place: Array, velocity: Array, knobs: Array, turn: Array
) -> Iterator[tuple[Kind, str, Mask]]:
    speed = np.linalg.norm(velocity, axis=1)
    moving = speed > _REST
    fast = np.asarray(speed > (float(np.median(speed[moving])) if moving.any() else np.inf))
    at_wall = (np.abs(place) > reach - 0.01).any(axis=1)
    reversal = np.zeros(len(knobs), dtype=bool)
    signs = np.sign(turn)
    for axis in (0, 1):
        turned = np.flatnonzero(signs[1:, axis] * signs[:-1, axis] < 0.0) + 1
        for shift in range(_NEAR + 1):
            reversal[np.minimum(turned + shift, len(knobs) - 1)] = True
    # A turn about y pushes along x, a turn about x against y.
    uphill = (velocity * np.stack([knobs[:, 1], -knobs[:, 0]], axis=1)).sum(axis=1) < 0.0
    yield "regime", "at the wall", np.asarray(at_wall)
    yield "regime", "at rest", np.asarray(~moving & ~at_wall)
    yield "regime", "rolling slowly", np.asarray(moving & ~fast & ~at_wall)
    yield "regime", "rolling fast", np.asarray(fast & ~at_wall)
    yield "regime", "rolling uphill", np.asarray(moving & uphill & ~at_wall)
    yield "regime", "rolling downhill", np.asarray(moving & ~uphill & ~at_wall)
    yield "regime", "after the command reverses", reversal
    across = np.abs(velocity)
    yield "regime", "along x", np.asarray(moving & (across[:, 0] > 2.0 * across[:, 1]))
    yield "regime", "along y", np.asarray(moving & (across[:, 1] > 2.0 * across[:, 0]))


def _strongest(findings: Sequence[Finding]) -> list[Finding]:
    """Return the significant findings, the strongest of each kind first."""
    kept: list[Finding] = []
    for kind in ("run", "time", "region", "regime"):
        clear = [one for one in findings if one.kind == kind and one.p_value <= CLEAR]
        kept += sorted(clear, key=lambda one: -one.strength)[:MOST]
    return kept
