"""No clock is read off impacts."""

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis.case import Fitted
from irt.diagnosis.clock import _power, without_clock
from irt.diagnosis.result import UNLISTED
from irt.engine import rollouts
from irt.fitting.identifiability import intervals
from irt.fitting.information import Information
from irt.rig import PARAMETERS

DRAG = {"name": "viscous_drag", "rate_per_s": 0.8}
TRUTH = (0.06, 0.05, 4e-4, 20.0, 1.0)


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
    "learned",
    [
        {"drag_strength": 0.03, "drag_power": 2.0},
        {"side_strength": 0.03, "side_power": 0.5},
        {"push_1_x_m_per_s2": 0.01, "velocity_1_x_s_per_m": 5.0, "rate_1_per_s": 2.0},
        {"shape_1": 1.0, "push_1_y_m_per_s2": 0.01, "tilt_1_x_per_rad": 500.0, "wave_1_x_per_m": 20.0},
        {"shape_1": 2.0, "brake_1_m_per_s2": 0.004, "drag_power": 0.0, "way_1_per_m": 9.0},
        {"shape_1": 5.0, "gear_1_x": 0.2, "gear_1_y": -0.2, "heading_1_x": 1.0, "phase_1_rad": 0.5},
        {"mode_gain": 0.8, "mode_rate_rad_per_s": 6.0, "mode_damping": 0.2},
    ],
    ids=lambda learned: "-".join(name for name in learned if name != "shape_1"),
)
def test_powers_leave_the_path_of_what_was_learned_as_it_is(learned):
    values = {one.name: one.neutral for one in effect(UNLISTED).parameters} | learned
    names = tuple(f"{UNLISTED}.{name}" for name in values)
    fitted = Fitted((UNLISTED,), (*PARAMETERS, *names), np.array([*TRUTH, *values.values()]), (), 0.0, 0)
    powers = dict(zip(values, (_power(name, fitted) for name in names), strict=True))
    knobs = 0.03 * np.sin(np.arange(60)[:, None] / [9.0, 13.0])

    def path(factor, *, is_slowed=True):
        base = np.array([TRUTH])
        base[0, :4] *= [factor**-2, factor**-2, factor**-2, factor]
        slowed = {name: value * factor ** (is_slowed * powers[name]) for name, value in learned.items()}
        return rollouts(base, knobs, effects=[{"name": UNLISTED, **slowed}])[0]

    moved = np.abs(path(1.0) - path(1.0)[0]).max()
    apart = np.abs(path(1.5) - path(1.0)).max()
    assert apart < 0.03 * moved
    if any(powers[name] for name in learned):
        assert np.abs(path(1.5, is_slowed=False) - path(1.0)).max() > 3.0 * apart
