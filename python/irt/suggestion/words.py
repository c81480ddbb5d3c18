"""What a suggested run is for, in plain words, and what else could tell where no run can."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from irt.catalogue import effect
from irt.diagnosis.result import UNLISTED
from irt.suggestion.excitations import Excitation, Limits
from irt.suggestion.separation import Separation

#: Less evidence than this leaves two models tied [nats].
TIED = 3.0
#: Parameters that are named as sharpened, and the share of their interval at which that is worth saying.
_NAMED, _SHARPER = 3, 0.9
#: A start this close to the centre is the centre [board edges].
_CENTRE = 0.005
#: A run with a larger share of rows at a wall is announced as one.
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
    """Return what to record and why.

    Parameters
    ----------
    run : Excitation
        What to play.
    limits : Limits
        Of the rig.
    separation : sequence of Separation
        What the run tells between models; none where there is one alone.
    tried : int
        Excitations that were compared.
    information : (float, float, float)
        Mutual information of the run, and of one like those recorded, with which model is true; and how much
        is in doubt [nats].
    gains : (float, float)
        What the run, and one like those recorded, tells about the first model's parameters [nats].
    remaining : dict
        Interval of each parameter after the run over that before it.
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
    """Return the effects of a model in words."""
    named = ["physics without a name" if name == UNLISTED else name.replace("_", " ") for name in effects]
    return " with ".join(named) or "nothing left out"


def _play(run: Excitation, limits: Limits) -> str:
    x, y = run.start
    centred = np.hypot(x, y) < _CENTRE
    where = "in the centre" if centred else f"at x {x:.3f}, y {y:.3f} board edges from the centre"
    rows = len(run.commands)
    lasts = "" if limits.step_s is None else f" ({limits.lasting(rows)})"
    return f"Lay the marble down at rest {where}, the knobs level, and play {rows} rows{lasts}: {run.words}."


def _doubt(information: tuple[float, float, float]) -> str:
    run, random, doubt = information
    share, usual = (100.0 * one / doubt if doubt > 0.0 else 0.0 for one in (run, random))
    return (
        f"Of the doubt which model is true ({_nats(doubt)}) this run is expected to settle {share:.0f} %, "
        f"one like those recorded {usual:.0f} %."
    )


def _pair(pair: Separation, tried: int) -> Iterator[str]:
    first, second = label(pair.first), label(pair.second)
    if pair.nats >= TIED and not pair.alike:
        yield (
            f"Told apart: {first} from {second}. Refitted, the two would still differ by "
            f"{pair.distance:.2g} times the tracker's scatter over the run ({_nats(pair.nats)} of evidence); "
            f"in a run like those recorded by {pair.random_distance:.2g} times ({_nats(pair.random_nats)})."
        )
    elif pair.most_nats >= TIED:
        yield (
            f"This run does not tell {first} from {second}, others do (up to {_nats(pair.most_nats)}): ask "
            f"for a run for these two alone."
        )
    elif pair.alike:
        yield (
            f"No drive of the knobs tells {first} from {second}: from rest the two, refitted, predict the "
            f"same path whatever is played, and so no evidence is to be had from a run like these."
        )
        yield _instead(pair)
    else:
        yield (
            f"One run within what this rig can play hardly tells {first} from {second}: the best of {tried} "
            f"excitations gives {_nats(pair.most_nats)} of evidence, where {TIED:g} would settle it."
        )
        yield _instead(pair)


def _instead(pair: Separation) -> str:
    """Return what tells two models apart by other means, from where their effects sit."""
    own = set(pair.first) ^ set(pair.second)
    stages = {effect(name).stage for name in own}
    if stages & {"sensing", "timing"} and stages & {"actuation", "timing"} and not stages & _MOVING:
        return (
            "What could: a lamp in the camera's view that is switched together with a command shows how late "
            "pictures are; a tilt sensor on the board shows how late and how far the board follows."
        )
    if "sensing" in stages:
        return (
            "What could: lay the marble by hand in places measured with a ruler; what the camera shows wrong "
            "there, with nothing moving, is the camera's."
        )
    if "actuation" in stages and stages & _MOVING:
        return (
            "What could: read the board's tilt with a level or a tilt sensor while the knobs are turned; "
            "what the board follows wrongly is the actuation's, the rest the marble's."
        )
    if "actuation" in stages:
        return (
            "What could: a tilt sensor on the board, read while the knobs are turned, shows what lies "
            "between the command and the board without the marble."
        )
    if stages & _MOVING:
        return (
            "What could: larger or longer runs than those recorded, a push by hand that lets the marble "
            "coast across the level board, or a marble of another size or weight."
        )
    return "What could: several recordings of the same commands, or a more precise tracker."


def _sharpened(gains: tuple[float, float], remaining: dict[str, float]) -> str:
    gain, random = gains
    best = sorted(remaining.items(), key=lambda one: one[1])[:_NAMED]
    named = [f"{name} to {100 * share:.0f} %" for name, share in best if share < _SHARPER]
    shown = f" The intervals would shrink: {', '.join(named)} of what they are." if named else ""
    return (
        f"It is the run that sharpens the parameters most: {_nats(gain)} about them, where one like those "
        f"recorded gives {_nats(random)}.{shown}"
    )


def _nats(value: float) -> str:
    return f"{value:.2g} nats" if value < 100.0 else f"{value:.0f} nats"
