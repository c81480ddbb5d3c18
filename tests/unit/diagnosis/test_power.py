"""What recordings are said to show, they show."""

import numpy as np
import pytest

from irt.diagnosis.evidence import Evidence
from irt.diagnosis.impacts import between_impacts, shows
from irt.diagnosis.power import power


@pytest.fixture
def least(plant):
    """Return the smallest sizes that a case without effects would show, by effect."""
    case = plant()
    base = case.fit(starts=4)
    return {one.effect: one.least for one in power(case, base, Evidence.of(case, [base]))}


@pytest.mark.parametrize(("name", "parameter"), [("viscous_drag", "rate_per_s"), ("lag", "time_constant_s")])
def test_twice_the_least_is_named(plant, least, name, parameter):
    case = plant([{"name": name, parameter: 2.0 * least[name]}], seed=3)
    base = case.fit(starts=4)
    one = case.refine([name], np.append(base.values, 2.0 * least[name])[None])[0]
    assert Evidence.of(case, [base, one]).is_better(one, base)
    assert shows(between_impacts(case, base), one, base)


def test_a_rebound_below_what_engines_differ_by_is_not_promised(least):
    assert least["wall_restitution"] is None or least["wall_restitution"] > 0.1
