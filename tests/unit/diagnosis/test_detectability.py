"""Detectable sizes are detected."""

import numpy as np
import pytest

from irt.diagnosis import config
from irt.diagnosis.detectability import detectability
from irt.diagnosis.score import Scores
from irt.diagnosis.selection import Selection


def least(dataset):
    """Return the smallest detectable sizes in a dataset without effects; infinite if not detectable."""
    scores = Scores(dataset)
    found = detectability(scores, scores.base())
    assert all(one.least is None or 0.0 < one.least <= one.largest for one in found)
    return {(one.effect, one.parameter): np.inf if one.least is None else one.least for one in found}


@pytest.mark.slow
def test_more_recordings_show_smaller_effects(plant):
    few, many = (least(plant(runs=runs, stamped=True)) for runs in (2, 8))
    assert few.keys() == many.keys()
    names = {name for name, _ in many}
    assert {"lag", "bump", "parallax", "viscous_drag"} <= names
    assert not names & {"delay_jitter", "unlisted"}
    shown = [one for one in many if np.isfinite(many[one])]
    assert len(shown) > 0.5 * len(many)
    # Other start states and noise change the result by a step of the ladder.
    assert sum(many[one] <= few[one] for one in many) > 0.9 * len(many)
    assert sum(many[one] < 0.9 * few[one] for one in shown) > 0.3 * len(shown)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameter"), [("viscous_drag", "rate_per_s"), ("lag", "time_constant_s")])
def test_twice_the_least_is_named(plant, name, parameter):
    size = 2.0 * least(plant(stamped=True))[name, parameter]
    scores = Scores(plant([{"name": name, parameter: size}], seed=3, stamped=True))
    best = Selection(scores, [name], lambda _: None).run().best
    assert best.effects == (name,)
    assert best.score > scores.base().score + config.SURE
