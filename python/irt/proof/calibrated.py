"""Section of a proof's page: whether probabilities, intervals and the error budget are right."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from irt.diagnosis.result import UNLISTED
from irt.proof.found import worlds
from irt.proof.metrics import calibration, coverage, in_group, in_world
from irt.proof.score import Budget, RigScore
from irt.proof.wording import header, picture, rate, rate_of, row


def calibrated(scores: Sequence[RigScore], folder: str) -> Iterator[str]:
    """Yield the section."""
    yield "\n## Calibration"
    yield from _inclusion(scores, folder)
    yield from _intervals(scores, folder)
    yield from _budgets(scores, folder)


def listed(scores: Sequence[RigScore]) -> list[RigScore]:
    """Return the rigs for which the catalogue has all hidden physics."""
    return [one for one in scores if one.group != UNLISTED]


def budgets(scores: Sequence[RigScore]) -> list[Budget]:
    """Return the error budgets that have a truth beside them."""
    return [one.budget for one in scores if one.budget is not None]


def _inclusion(scores: Sequence[RigScore], folder: str) -> Iterator[str]:
    yield "\n### Inclusion probabilities\n"
    deciles = calibration(listed(scores))
    yield (
        "Each diagnosis states for each effect of the catalogue how probable it is that the effect acts; "
        "effects that it does not list count with probability 0. Rigs with physics outside the catalogue, in "
        "which no effect of it acts, have a column of their own.\n"
    )
    beyond = {one.number: one.rate for one in calibration(in_group(scores, UNLISTED))}
    yield from header(["stated probability", "mean", "acts", "rigs with unlisted physics: acts"])
    for one in deciles:
        other = rate_of(beyond[one.number]) if one.number in beyond else ""
        reach = f"{one.number / 10:.1f} to {(one.number + 1) / 10:.1f}"
        yield row([reach, f"{one.mean:.3f}", rate_of(one.rate), other])
    yield ""
    yield from picture(
        folder,
        "reliability",
        "Share of effects that act, against the stated probability that they do; the dashed line is a "
        "diagnosis that is calibrated. Rigs with physics outside the catalogue are left out.",
    )


def _intervals(scores: Sequence[RigScore], folder: str) -> Iterator[str]:
    yield "\n### Intervals\n"
    columns = worlds(scores)
    yield from header(["95 % intervals that contain the truth", *columns, "with an open end, not counted"])
    for words, of_effects in (
        ("the five parameters", False),
        ("effects that were named rightly", True),
        ("all", None),
    ):
        cells = [
            rate_of(coverage(in_world(scores, world), of_effects=of_effects)[0]) for world in columns[:-1]
        ]
        everywhere, ajar = coverage(scores, of_effects=of_effects)
        yield row([words, *cells, f"{rate(everywhere)} of {everywhere.of}", f"{ajar}"])
    yield ""
    yield from picture(
        folder, "coverage", "Share of the closed intervals that contain the truth, by parameter."
    )
    seconds = [one.seconds for one in scores if math.isfinite(one.seconds)]
    if seconds:
        yield (
            f"A diagnosis took {np.median(seconds):.0f} s of one core (median; the longest "
            f"{np.max(seconds):.0f} s)."
        )


def _budgets(scores: Sequence[RigScore], folder: str) -> Iterator[str]:
    yield "\n### Error budget\n"
    known = budgets(scores)
    if not known:
        yield "No diagnosis of a rig with hidden effects of the catalogue has an error budget.\n"
        return
    yield (
        "Where the error of the five parameters in complete held-out runs goes, in "
        f"{len(known)} rigs with effects of the catalogue: the shares that the diagnosis gives to its named "
        "effects and to the tracker, and the shares of the hidden effects and of the tracker's noise by the "
        "true paths. How several effects divide their share depends on a refit without each of them, for "
        "which there is no truth.\n"
    )
    yield from header(["share of", "stated, median", "true, median", "distance, median", "90th percentile"])
    for words, said, true in (
        ("effects", [one.effects for one in known], [one.true_effects for one in known]),
        ("tracker", [one.tracker for one in known], [one.true_tracker for one in known]),
    ):
        apart = np.abs(np.subtract(said, true))
        numbers = (np.median(said), np.median(true), np.median(apart), np.quantile(apart, 0.9))
        yield row([words, *(f"{number:.3f}" for number in numbers)])
    yield ""
    yield from picture(
        folder, "budget", "Share of the base model's squared error: by the diagnosis, against the truth's."
    )
