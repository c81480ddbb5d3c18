"""The error budget of the base model in words, for the report, the terminal and the docs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from irt.diagnosis.budget import REST, TRACKER
from irt.diagnosis.result import UNLISTED, Diagnosis, Remains
from irt.report.words import percent, plain, share

Kind = Literal["effect", "tracker", "rest"]

#: Smallest share of the squared error whose origin is discussed.
_NOTHING = 0.005
#: Origin of the remaining error, by `Remains.stage`.
_STAGES = {
    "board": "It arises on the board, between impacts: a random push there increases the likelihood.",
    "contact": "It arises at the rim: random rebounds increase the likelihood.",
}


@dataclass(frozen=True)
class Part:
    """A part of a bar.

    Attributes
    ----------
    name : str
        Label.
    kind : {"effect", "tracker", "rest"}
        Source of the error.
    share : float
        Share of the squared error, from 0 to 1.
    """

    name: str
    kind: Kind
    share: float


@dataclass(frozen=True)
class Bar:
    """The whole squared error at one horizon.

    Attributes
    ----------
    title : str
        The prediction horizon.
    parts : tuple of Part
        From left to right; their shares add up to 1.
    """

    title: str
    parts: tuple[Part, ...]


def bars(diagnosis: Diagnosis, row_s: float | None = None) -> list[Bar]:
    """Return the bars of an error budget, whole runs first.

    Parameters
    ----------
    diagnosis : Diagnosis
        Its `budget` is empty if nothing was held out.
    row_s : float, optional
        Duration of a row [s] by which horizons are counted if recordings have no stamps (`horizon_row_s`).
    """
    horizons = dict.fromkeys(one.horizon_s for one in diagnosis.budget)
    return [
        Bar(
            _horizon(horizon, row_s),
            tuple(
                Part(_name(one.what, diagnosis.remains), _kind(one.what), one.share)
                for one in diagnosis.budget
                if one.horizon_s == horizon
            ),
        )
        for horizon in sorted(horizons, key=lambda one: -float("inf") if one is None else -one)
    ]


def remainder(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield sentences on the error that neither effects nor tracker explain; none if nothing was held out."""
    found = diagnosis.remains
    if found is None:
        return
    yield _amount(diagnosis, found)
    if found.share >= _NOTHING:
        if found.stage is not None:
            yield _STAGES[found.stage]
        if found.repeats:
            yield "It depends on something that repeats, so a better model could still explain it."
        elif found.stage is not None:
            yield "No dependence on anything that repeats from run to run was found."
        else:
            yield (
                "The residuals of a fit to all runs are close to noise. This error comes from tracker "
                "outliers, or from something that only the held-out run shows."
            )
        if (name := _worst_run(diagnosis)) is not None:
            yield f"Most of the error is in {name}: look at that run."
    if found.floor_of_the_log > 0.0:
        yield (
            f"Even a perfect simulator would have an error of {percent(found.floor_of_the_log)} of the edge "
            "on average, from tracker noise and uncertain start states."
        )


def squares_explained(diagnosis: Diagnosis) -> str:
    """Return a sentence on the share that the effects explain by the budget; empty without a budget.

    Half of an error is a quarter of its square, so the share of the errors seems to contradict the budget.
    """
    rest = [one.share for one in diagnosis.budget if one.horizon_s is None and one.what in {TRACKER, REST}]
    if not rest:
        return ""
    return f" Of the squared error, in which large errors weigh more, it is {share(1.0 - sum(rest))}."


def _worst_run(diagnosis: Diagnosis) -> str | None:
    """Return the one of several runs with more than half of the squared held-out error; None if none has."""
    squares = {one.recording: float(np.nansum((one.final - one.observed) ** 2)) for one in diagnosis.runs}
    half = sum(squares.values()) / 2.0
    return next((name for name, own in squares.items() if len(squares) > 2 and own > half), None)


def _amount(diagnosis: Diagnosis, found: Remains) -> str:
    beyond = "the effects and the tracker" if diagnosis.effects else "the tracker"
    if found.share < _NOTHING:
        return f"Less than 1 % of the squared error on held-out runs comes from anything but {beyond}."
    return (
        f"{share(found.share)} of the base model's squared error on held-out runs comes from sources other "
        f"than {beyond}."
    )


def _horizon(horizon_s: float | None, row_s: float | None) -> str:
    if horizon_s is None:
        return "whole runs"
    return f"{horizon_s:g} s ahead" if row_s is None else f"{horizon_s / row_s:.0f} rows ahead"


def _name(what: str, remains: Remains | None) -> str:
    if what == REST:
        by_chance = remains is not None and remains.stage is not None and not remains.repeats
        return "does not repeat" if by_chance else "not explained"
    if what == TRACKER:
        return "tracker noise"
    return "learned correction" if what == UNLISTED else plain(what)


def _kind(what: str) -> Kind:
    return "rest" if what == REST else "tracker" if what == TRACKER else "effect"
