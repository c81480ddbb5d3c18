"""No clock is read off impacts."""

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnose.case import Fitted
from irt.diagnose.clock import _BY_NAME, _power, without_clock
from irt.fitting.identifiability import intervals
from irt.fitting.information import Information
from irt.rollouts import rollouts

DRAG = {"name": "viscous_drag", "rate_per_s": 0.8}
OTHERS = {"bump": {"width_m": 0.04}, "eccentric_marble": {"phase_rad": 1.0}}


def test_without_stamps_the_truth_lies_within_the_intervals_whatever_time_scale_came_out(plant):
    case = plant([DRAG], rows=120, runs=6)
    fitted = case.fit(["viscous_drag"])
    problem = case.problem(fitted.effects)
    told = Information.of(problem, fitted.values, problem.inform(fitted.values, case.noise))
    known = without_clock(case, fitted, told)
    low, high = intervals(known)
    truth = np.array([0.06, 0.05, 4e-4, 15.0, 1.03, 0.8])
    assert (low <= truth).all()
    assert (truth <= high).all()
    assert high[3] > 1.5 * low[3]


@pytest.mark.parametrize(
    "name", [*sorted(_BY_NAME), "delay.delay_s", "viscous_drag.rate_per_s", "backlash.width_x_rad"]
)
def test_powers_leave_the_path_as_it_is(name):
    of_effect, parameter = name.split(".")
    one = next(one for one in effect(of_effect).parameters if one.name == parameter)
    value = one.neutral + 0.2 * (one.high - one.neutral)
    power = _power(name, Fitted((of_effect,), (), np.zeros(0), (), 0.0, 0))
    knobs = 0.03 * np.sin(np.arange(60)[:, None] / [9.0, 13.0])

    def path(factor):
        base = np.array([[0.06, 0.05, 4e-4, 20.0, 1.0]])
        base[0, :4] *= [factor**-2, factor**-2, factor**-2, factor]
        planted = {"name": of_effect, parameter: value * factor**power, **OTHERS.get(of_effect, {})}
        return rollouts(base, knobs, effects=[planted])[0]

    moved = np.abs(path(1.0) - path(1.0)[0]).max()
    assert np.abs(path(1.5) - path(1.0)).max() < 0.03 * moved
