"""Sections of a proof's page: what was named, held-out runs, other methods, one more run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from irt.diagnosis.result import UNLISTED
from irt.proof.failures import GROUPS, left_out_runs, unread_rigs
from irt.proof.further import KINDS
from irt.proof.metrics import (
    CAMERA,
    CLEAR,
    MUJOCO,
    PYBULLET,
    Quantity,
    Rate,
    gaps,
    in_group,
    in_world,
    is_clear,
    of_catalogue,
    power,
    rate_right,
    world_of,
)
from irt.proof.plan import NULLS
from irt.proof.results import Results
from irt.proof.score import CHANCE, RigScore
from irt.proof.wording import header, picture, quantity, rate, rate_of, row
from irt.rig import Board

#: The paper's board, for noise in millimetres.
_EDGE_MM = 1e3 * Board.edge_x_m
#: The drive of rigs that a controller leads, as a concealed world names it.
CONTROLLED = "controller"
_NOISES_MM = (0.0, 0.3, 0.6, 1.0, 2.5)
_ALL = "all"


def worlds(scores: Sequence[RigScore]) -> list[str]:
    """Return the worlds of the rigs, in the order of the page, and all of them together."""
    present = {world_of(one) for one in scores}
    known = [world for world in (PYBULLET, MUJOCO, CAMERA) if world in present]
    return [*known, *sorted(present - {*known, ""}), _ALL]


def _of_world(scores: Sequence[RigScore], world: str) -> list[RigScore]:
    return list(scores) if world == _ALL else in_world(scores, world)


def named(scores: Sequence[RigScore], folder: str) -> Iterator[str]:
    """Yield the section about right answers, by world and by what was hidden."""
    yield "\n## What was found\n"
    yield (
        "An answer is right if it names the hidden effects, or declares ties that contain them, and nothing "
        "else; if it is `unlisted` for physics that is not in the catalogue; and `sufficient` if nothing was "
        "hidden.\n"
    )
    columns = worlds(scores)
    yield from header(["hidden: right answers", *columns])
    for group, words in GROUPS.items():
        inside = in_group(scores, group)
        if inside:
            yield row([words, *(rate_of(rate_right(_of_world(inside, world))) for world in columns)])
    known = of_catalogue(scores)
    if known:
        clear = [one for one in known if is_clear(one)]
        for words, inside in (
            ("effects of the catalogue together", known),
            (f"the same, where the signal is {CLEAR:g} times the noise", clear),
        ):
            yield row([words, *(rate_of(rate_right(_of_world(inside, world))) for world in columns)])
    yield ""
    yield from header(["hidden", "rigs", "right", "exactly", "tie size", "failed"])
    for group, words in GROUPS.items():
        inside = in_group(scores, group)
        if inside:
            sizes = [one.tie_size for one in inside if one.tie_size and group not in NULLS]
            size = f"{np.mean(sizes):.2f}" if sizes else ""
            failed = sum(one.verdict == "failed" for one in inside)
            exact = Rate.over(inside, lambda one: one.exact)
            yield row([words, f"{len(inside)}", rate(rate_right(inside)), rate(exact), size, f"{failed}"])
    yield from unread_rigs(scores)
    yield from _unlisted(in_group(scores, UNLISTED))
    yield ""
    yield from header(["of rigs with effects of the catalogue", "rigs", "right"])
    for words, inside in _cuts(known):
        yield row([words, f"{len(inside)}", rate(rate_right(inside))])
    yield ""
    yield from picture(
        folder,
        "confusion",
        "Hidden effects by row, named effects by column; numbers are rigs, colours shares of the row. A tie "
        "that contains the truth counts as the truth. The last row holds names for which nothing was hidden.",
    )
    yield from picture(
        folder,
        "power",
        "Share of rigs in which the hidden effects were named, against the distance of the refitted base "
        f"model from the true path. From {CLEAR:g} times the noise on, 95 % are promised.",
    )
    yield from header(["signal over noise", "rigs", "named, or in a tie"])
    for one in power(scores):
        if one.rate.of:
            reach = f"{one.low:g} and more" if math.isinf(one.high) else f"{one.low:g} to {one.high:g}"
            yield row([reach, f"{one.rate.of}", rate(one.rate)])


def _unlisted(scores: Sequence[RigScore]) -> Iterator[str]:
    """Yield the table of physics outside the catalogue; nothing without any."""
    if not scores:
        return
    yield ""
    yield from header(["physics not in the catalogue", "rigs", "reported as such", "gap closed, median"])
    for name in sorted({one.kinds for one in scores}):
        inside = [one for one in scores if one.kinds == name]
        closed = gaps(inside)
        words = " ".join(name).removeprefix(f"{UNLISTED}_").replace("_", " ")
        middle = f"{np.median(closed):.2f}" if closed else ""
        yield row([words, f"{len(inside)}", f"{rate_right(inside).good}", middle])


def _cuts(known: Sequence[RigScore]) -> Iterator[tuple[str, list[RigScore]]]:
    """Yield groups of rigs by what commanded their knobs, and by the noise of the tracker."""
    for words, is_one in (("drawn beforehand", False), ("of a controller that sees the marble", True)):
        inside = [one for one in known if one.drive and (one.drive == CONTROLLED) is is_one]
        if inside:
            yield f"commands {words}", inside
    for noise in sorted({one.noise for one in known}):
        yield f"{noise} noise", [one for one in known if one.noise == noise]
    for low, high in itertools.pairwise(_NOISES_MM):
        inside = [one for one in known if low <= _EDGE_MM * one.sigma < high]
        if inside:
            yield f"noise of {low:g} to {high:g} mm", inside


def held_out_runs(results: Results, folder: str) -> Iterator[str]:
    """Yield the section about errors on held-out runs."""
    yield "\n## Runs held out\n"
    yield (
        "The gap lies between the error of the five parameters, refitted, and the error of the true path, "
        f"which is noise alone. Rigs with an effect that varies at random (`{CHANCE}`) are left out, because "
        "no prediction closes their gap, and so are rigs without a gap. Predictions of all methods start "
        "from the true position, because noise there shifts a whole path.\n"
    )
    yield from header(["rigs", "world", "with a gap", "closed, median", "10th percentile"])
    for words, inside in (
        ("effects of the catalogue", of_catalogue(results.scores)),
        ("unlisted", in_group(results.scores, UNLISTED)),
    ):
        for world in worlds(results.scores):
            of_world = _of_world(inside, world)
            closed = gaps(of_world)
            if closed:
                low = f"{np.quantile(closed, 0.1):.3f}"
                count = f"{len(closed)} of {len(of_world)}"
                yield row([words, world, count, quantity(Quantity.median(closed)), low])
    yield from left_out_runs(results.scores)
    yield ""
    yield from picture(
        folder,
        "gaps",
        "Share of the gap closed in each rig with effects of the catalogue, sorted and cut off at -1; the "
        "dashed line is the true path.",
    )


def methods(results: Results) -> Iterator[str]:
    """Yield the section about other methods on the same rigs; nothing if they did not run."""
    standings = results.standings
    if len(standings) < 2:
        return
    yield "\n## Beside other methods, on the same rigs\n"
    yield from header(
        [
            "method",
            "named exactly or in a tie",
            "reports missing physics where there is some",
            "reports it where there is none",
            "gap closed",
            "error over the true path's",
            "seconds",
        ]
    )
    for one in standings:
        if one.missing:
            yield f"| {one.title} | {one.missing} | | | | | |"
            continue
        said = (one.named, one.detected, one.alarms)
        rates = ("does not say" if each is None else rate(each) for each in said)
        yield row([one.title, *rates, quantity(one.closed), quantity(one.over_oracle), f"{one.seconds:.1f}"])
    yield ""
    tried, all_of_them = len({one.rig for one in results.entries}), len(results.scores)
    few = f" They were run on {tried} of {all_of_them} rigs." if tried < all_of_them else ""
    yield f"Medians over all rigs with hidden physics. The methods are in `python/irt/proof/baselines/`.{few}"


def one_more_run(results: Results) -> Iterator[str]:
    """Yield what one more run does to ties; nothing where the concealed world could not record it."""
    if not results.ties:
        return
    yield "\n## Ties, and one more run\n"
    yield (
        f"For {len(results.ties)} rigs whose tie contained the truth, one more run was recorded and the rig "
        "diagnosed again: once with the run that `irt suggest` designs, once with a random run of the same "
        "families.\n"
    )
    yield from header(["one more run", "named exactly, without a tie", "tie size before", "after"])
    before = np.mean([one.before for one in results.ties])
    for kind in KINDS:
        exact = [one.exact[kind] for one in results.ties]
        sizes = [one.after[kind] or 0.0 for one in results.ties if one.after[kind]]
        after = f"{np.mean(sizes):.2f}" if sizes else ""
        yield row([kind, rate_of(Rate(sum(exact), len(exact))), f"{before:.2f}", after])
