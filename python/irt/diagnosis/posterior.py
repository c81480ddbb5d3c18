"""The sets of effects that may be true, and how probable which values of each are, for ``model.toml``.

The values of the answer are spread as its intervals say: the widest of two curvatures, with their
correlations, and the jackknife. Other sets have both curvatures, widened as much as the jackknife widens the
answer's, since a jackknife of each would cost a fit for each recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from irt.diagnosis import intervals
from irt.diagnosis.hypotheses import SPIN
from irt.diagnosis.score import Scored
from irt.diagnosis.time_symmetry import time_is_known
from irt.diagnosis.validation import HeldOut
from irt.fitting.information import Information
from irt.fitting.posterior import NORMAL, component, within
from irt.model import Parameter
from irt.posterior import SPINNING, Component

#: A stated interval bounds draws on a side where it is narrower than this share of a normal one.
_NARROWER = 0.8


def posterior(
    likely: Sequence[tuple[Scored, float]], held: HeldOut, stated: Mapping[str, Parameter]
) -> tuple[Component, ...]:
    """Return how probable which values of a rig's simulator are.

    Parameters
    ----------
    likely : sequence of (Scored, float)
        Sets and their probabilities, which add up to 1; the answer first.
    held : HeldOut
        The answer as recordings held out see it.
    stated : mapping
        The answer's parameters with their intervals.
    """
    (answer, chance), *others = likely
    alone, scattered = intervals.curvature(answer), intervals.information_of(answer, held)
    known = ~scattered.flat & (alone.half_width > 0.0)
    ratios = scattered.half_width[known] / alone.half_width[known]
    widening = float(np.exp(np.mean(np.log(ratios)))) if len(ratios) else 1.0
    first = _bounded(_component(answer, scattered, chance), stated)
    # What is held is as the model has it: a learned correction holds hundreds of numbers.
    spread = {name: one for name, one in first.parameters.items() if one.linear}
    found = [replace(first, parameters=spread)]
    found += [_component(one, intervals.curvature(one), each, widening) for one, each in others]
    return () if len(found) == 1 and found[0].is_point else tuple(found)


def _component(one: Scored, information: Information, chance: float, widening: float = 1.0) -> Component:
    own = [one.names.index(name) for name in information.names]
    # Where time is unknown the filter knows no more along the symmetry than the prior.
    covariance = one.top.covariance[np.ix_(own, own)] if time_is_known(one.dataset) else None
    model = one.fitted.model
    found = component(
        information,
        [effect.name for effect in model.effects],
        probability=chance,
        covariance=covariance,
        widening=widening,
        renamed={SPIN: SPINNING},
    )
    spin = found.parameters[SPINNING]
    # The engine takes what the friction is more than the rig's; a model has the sum.
    own_friction = model.board.spinning_friction - spin.value
    shifted = replace(
        spin, value=model.board.spinning_friction, low=max(0.0, spin.low + own_friction), high=np.inf
    )
    return replace(found, parameters={**found.parameters, SPINNING: shifted})


def _bounded(one: Component, stated: Mapping[str, Parameter]) -> Component:
    """Return a distribution within stated intervals where these are narrower than a normal one."""
    bounds = {}
    for name, spread in one.parameters.items():
        interval = stated.get(name)
        if interval is None or interval.low is None or interval.high is None or any(spread.power):
            continue
        reach = _NARROWER * NORMAL * float(np.linalg.norm(spread.linear))
        low = interval.low if interval.low > spread.value - reach else -np.inf
        high = interval.high if interval.high < spread.value + reach else np.inf
        bounds[name] = (min(low, spread.value), max(high, spread.value))
    return within(one, bounds)
