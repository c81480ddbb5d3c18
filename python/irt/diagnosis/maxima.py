"""Local maxima of the likelihood of one set of effects, and the effects that show at each of them.

Where much physics is missing, the likelihood has many maxima. At the highest, parameters and random push may
hide the missing effects: a picture so large that no marble reaches a wall, or a slowly varying push that
absorbs any constant. Two fits are distinct maxima if the likelihood is lower between them (the hill-valley
test: Ursem, "Multinational evolutionary algorithms", 1999).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from irt.catalogue import effect
from irt.diagnosis import config
from irt.diagnosis.hypotheses import SPINNING, simulated
from irt.diagnosis.score import PULL, PULL_S, PUSH, Scored, Scores, quiet
from irt.diagnosis.screening import Promise, Screening, draws
from irt.fitting.problem import in_unit_of

#: Points between two maxima, as shares of the way.
BETWEEN = (0.25, 0.5, 0.75)


def distinct(scores: Scores, fits: Sequence[Scored]) -> list[Scored]:
    """Return the distinct maxima among fits of one set, the most probable first, at most `config.MAXIMA`."""
    found: list[Scored] = []
    for one in sorted((fit for fit in fits if math.isfinite(fit.score)), key=lambda fit: -fit.score):
        if len(found) < config.MAXIMA and all(_valley(scores, other, one) > config.SURE for other in found):
            found.append(one)
    return found


def promising(
    scores: Scores, names: Sequence[str], screened: Mapping[Scored, list[Promise]]
) -> list[tuple[Scored, list[Promise]]]:
    """Return maxima of the five parameters alone with their screened effects, the largest gain first.

    Maxima in `screened` are not screened again. Of the maxima at which the same effect gains most, only the
    one with the largest sum of score and gain is returned.
    """
    best: dict[str, tuple[Scored, list[Promise]]] = {}
    for one in distinct(scores, scores.fits_of_base):
        promises = screened[one] if one in screened else Screening(scores, one).promises(names)
        kept = best.get(promises[0].name)
        if kept is None or one.score + promises[0].gain > kept[0].score + kept[1][0].gain:
            best[promises[0].name] = (one, promises)
    return list(best.values())


def as_expected(scores: Scores, one: Scored) -> Scored:
    """Return a set with the five parameters in the middle of their ranges and hardly any push."""
    values, rig = one.values, scores.dataset.rig
    for name, (low, high) in rig.ranges.items():
        if name != "time_scale" or scores.dataset.time_scale is None:
            # A board moves for gears of either sign.
            moving = np.copysign(0.5 * max(-low, high), values[name])
            values[name] = 0.5 * (low + high) if low * high >= 0.0 else float(moving)
    top = replace(
        one.top,
        values=np.array([values[name] for name in one.names]),
        noise=scores.noise(config.PUSHES[0]),
    )
    return replace(one, top=top)


def from_draws(scores: Scores, one: Scored) -> Scored:
    """Fit a set anew from draws of its effects' values, and return the best fit of the set.

    The five parameters start in the middle of their ranges, with hardly any push.
    """
    expected = as_expected(scores, one)
    values = np.tile(expected.top.values, (config.DRAWS, 1))
    names = [name for name in simulated(one.effects) if name != SPINNING]
    for number, name in enumerate(names):
        info = in_unit_of(scores.dataset.rig, effect(name))
        if info.shrunk:
            continue
        columns = [one.names.index(f"{name}.{each.name}") for each in info.required]
        values[:, columns] = draws(info, config.DRAWS, scores.dataset.seed + number)
    noise = quiet(np.tile(one.noise, (config.DRAWS, 1)))
    begun = scores.ascend(one.effects, values, noise, one.top.states, iterations=config.FIRST)
    for each in sorted(begun, key=lambda fit: -fit.score)[: config.SECOND]:
        scores.ascend(
            one.effects, each.top.values[None], each.noise[None], each.top.states, iterations=config.THOROUGH
        )
    return scores.known[frozenset(one.effects)]


def without_pull(scores: Scores, one: Scored, names: Sequence[str]) -> tuple[Scored, list[Promise]]:
    """Return a set that is fitted with a white push only, and its screened effects.

    Their start noise sizes include a correlated push again.
    """
    noise = np.tile(one.noise, (2, 1))
    noise[:, PULL], noise[:, PUSH] = 0.0, config.PUSHES[1:3]
    values = np.tile(one.top.values, (len(noise), 1))
    found = scores.ascend(one.effects, values, noise, one.top.states, iterations=config.THOROUGH)
    still = max(found, key=lambda each: each.score)
    return still, [_pulled(promise) for promise in Screening(scores, still).promises(names)]


def _pulled(promise: Promise) -> Promise:
    noise = promise.noise.copy()
    noise[:, [PULL, PULL_S]] = config.PULL, config.PULL_S
    return replace(promise, noise=noise)


def _valley(scores: Scores, one: Scored, other: Scored) -> float:
    """Return by how much the likelihood between two maxima is below that of the lower one [nats]."""
    shares = np.array(BETWEEN)[:, None]
    values = (1.0 - shares) * one.top.values + shares * other.top.values
    sizes = [np.log(np.maximum(each.noise, 1e-12)) for each in (one, other)]
    noise = np.exp((1.0 - shares) * sizes[0] + shares * sizes[1])
    states = [(1.0 - share) * one.top.states + share * other.top.states for share in BETWEEN]
    found = scores.problem(one.effects).filter(values, noise, states)
    least = min(float(each.log_likelihood.sum()) for each in found)
    return min(float(one.top.log_likelihood), float(other.top.log_likelihood)) - least
