import numpy as np
import pytest

from irt.engine import rollouts
from irt.fitting.fit import Iteration
from irt.model import Parameter
from irt.rig import RANGES, load_rig
from irt.tuning.outcome import spread, widened
from irt.tuning.residual_tuning import irt


def steps(*errors):
    return [Iteration(np.full(5, 10.0 * i), mae) for i, mae in enumerate(errors)]


def test_spread_is_over_the_starts_that_did_not_fail():
    assert spread(steps(0.01, 0.012, 0.5)) == pytest.approx(np.full((5, 5), np.var([0.0, 10.0], ddof=1)))


def test_one_start_has_no_spread():
    assert not spread(steps(0.01, 0.5)).any()
    assert not spread(steps(0.01)).any()


def test_intervals_add_as_independent_errors():
    wide = widened(Parameter(20.0, 17.0, 24.0), 4.0, (0.0, 50.0))
    assert (wide.low, wide.high) == pytest.approx((15.0, 20.0 + 32**0.5))
    assert wide.value == 20.0


def test_intervals_stay_within_the_ranges():
    wide = widened(Parameter(0.0, 0.0, 0.02), 0.3, RANGES["gear_x"])
    assert (wide.low, wide.high) == (0.0, 0.1)


def test_what_was_not_estimated_has_no_interval():
    assert widened(Parameter(12.0), 3.0, (0.0, 50.0)) == Parameter(12.0)


@pytest.mark.parametrize(
    ("option", "message"), [({"starts": 0}, "starts: expected at least 1"), ({"seed": -1}, "seed: expected")]
)
def test_options_are_checked(write_rig, wave, option, message):
    marble = rollouts([[0.05, 0.05, 1e-4, 20.0, 1.0]], wave)[0]
    rig = load_rig(write_rig({"run": (wave, marble)}))
    with pytest.raises(ValueError, match=message):
        irt(rig, **option)
