"""Sentences on the purpose of a suggested run, and on other measurements where no run helps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from irt.catalogue import effect
from irt.diagnosis.result import UNLISTED
from irt.suggestion.excitations import Excitation, Limits
from irt.suggestion.separation import Separation

#: Two models with less evidence between them are tied [nats].
TIED = 3.0
#: Most parameters that are named as sharpened, and the largest remaining share of their interval.
_NAMED, _SHARPER = 3, 0.9
#: A start closer to the centre is described as the centre [board edges].
_CENTRE = 0.005
#: Share of rows at a wall from which a sentence says so.
_MUCH_WALL = 0.3

_MOVING = frozenset({"board", "contact", "air", "field"})


def sentences(
    run: Excitation,
    limits: Limits,
    *,
    separation: Sequence[Separation],
    tried: int,
    information: tuple[float, float, float],
    gains: tuple[float, float],
    remaining: dict[str, float],
    at_wall: float,
) -> tuple[str, ...]:
    """Return sentences on what to record and why.

    Parameters
    ----------
    run : Excitation
        The run to play.
    limits : Limits
        Limits of the rig's commands.
    separation : sequence of Separation
        Separation of each pair of models; empty for a single model.
    tried : int
        Number of excitations compared.
    information : (float, float, float)
        Mutual information with the true model of the run, and of one like those recorded, and the entropy of
        the models' probabilities [nats].
    gains : (float, float)
        Information gain of the run, and of one like those recorded, on the first model's parameters [nats].
    remaining : dict
        Ratio of each parameter's interval after the run to that before it.
    at_wall : float
        Share of rows with the marble at a wall.
    """
    found = [_play(run, limits)]
    if at_wall > _MUCH_WALL:
        found.append(f"Expect the marble at a wall for {100 * at_wall:.0f} % of the run.")
    if separation:
        found.append(_doubt(information))
    found += [sentence for pair in separation for sentence in _pair(pair, tried)]
    if all(pair.nats < TIED or pair.alike for pair in separation):
        found.append(_sharpened(gains, remaining))
    return tuple(found)


def label(effects: Sequence[str]) -> str:
    """Return the effects of a model as text."""
    named = ["physics without a name" if name == UNLISTED else name.replace("_", " ") for name in effects]
    return " with ".join(named) or "no missing physics"


def _play(run: Excitation, limits: Limits) -> str:
    x, y = run.start
    centred = np.hypot(x, y) < _CENTRE
    where = "in the centre" if centred else f"at x {x:.3f}, y {y:.3f} board edges from the centre"
    rows = len(run.commands)
    lasts = "" if limits.step_s is None else f" ({limits.lasting(rows)})"
    return f"Place the marble at rest {where}, with level knobs, and play {rows} rows{lasts}: {run.words}."


def _doubt(information: tuple[float, float, float]) -> str:
    run, random, doubt = information
    share, usual = (100.0 * one / doubt if doubt > 0.0 else 0.0 for one in (run, random))
    return (
        f"This run is expected to resolve {share:.0f} % of the uncertainty about the true model "
        f"({_nats(doubt)}), a run like those recorded {usual:.0f} %."
    )


def _pair(pair: Separation, tried: int) -> Iterator[str]:
    first, second = label(pair.first), label(pair.second)
    if pair.nats >= TIED and not pair.alike:
        yield (
            f"Separated: {first} and {second}. After refits the two differ by "
            f"{pair.distance:.2g} times the tracker's noise over the run ({_nats(pair.nats)} of evidence); "
            f"in a run like those recorded by {pair.random_distance:.2g} times ({_nats(pair.random_nats)})."
        )
    elif pair.most_nats >= TIED:
        yield (
            f"This run does not separate {first} and {second}, others do (up to {_nats(pair.most_nats)}): "
            f"run irt suggest with these two models only."
        )
    elif pair.alike:
        yield (
            f"No commands separate {first} and {second}: from rest, the refitted models predict the same "
            f"path for any commands, so another run gives no evidence."
        )
        yield _instead(pair)
    else:
        yield (
            f"One run within this rig's limits hardly separates {first} and {second}: the best of {tried} "
            f"excitations gives {_nats(pair.most_nats)} of evidence; {TIED:g} are needed."
        )
        yield _instead(pair)


def _instead(pair: Separation) -> str:
    """Return another measurement that separates two models, by the stages of their effects."""
    own = set(pair.first) ^ set(pair.second)
    stages = {effect(name).stage for name in own}
    if stages & {"sensing", "timing"} and stages & {"actuation", "timing"} and not stages & _MOVING:
        return (
            "Instead, switch a lamp in the camera's view together with a command to measure the latency of "
            "the pictures, or measure the response of the board with a tilt sensor."
        )
    if "sensing" in stages:
        return (
            "Instead, place the marble by hand at positions measured with a ruler: static errors of the "
            "observed position are errors of the camera."
        )
    if "actuation" in stages and stages & _MOVING:
        return (
            "Instead, measure the board's tilt with a level or a tilt sensor while the knobs are turned: "
            "errors of the tilt come from the actuation, all others from the marble's motion."
        )
    if "actuation" in stages:
        return (
            "Instead, read a tilt sensor on the board while the knobs are turned: it shows the response of "
            "the board to the command without the marble."
        )
    if stages & _MOVING:
        return (
            "Instead, record larger or longer runs, push the marble by hand so that it coasts across the "
            "level board, or use a marble of another size or weight."
        )
    return "Instead, record the same commands several times, or use a more precise tracker."


def _sharpened(gains: tuple[float, float], remaining: dict[str, float]) -> str:
    gain, random = gains
    best = sorted(remaining.items(), key=lambda one: one[1])[:_NAMED]
    named = [f"{name} to {100 * share:.0f} %" for name, share in best if share < _SHARPER]
    shown = f" Expected intervals, relative to the current ones: {', '.join(named)}." if named else ""
    return (
        f"This run sharpens the parameters most: it gives {_nats(gain)} about them, a run like those "
        f"recorded {_nats(random)}.{shown}"
    )


def _nats(value: float) -> str:
    return f"{value:.2g} nats" if value < 100.0 else f"{value:.0f} nats"
