"""The filter of recordings with a measured tilt."""

import numpy as np
import pytest

from irt.fitting.problem import Problem
from irt.model import Effect
from irt.segments import segments
from tilted_rigs import VALUES, rig_of, tilted_recordings

#: As taken by `Problem.filter`: tracker, pushes, rebounds, then white and lasting noise of the tilt.
NOISE = np.array([1e-3, 1e-5, 0.1, 1e-6, 1e-3, 0.2, 0.1, 0.0, 0.01, 0.0, 1e-3, 2e-3, 0.2, 0.1])


@pytest.fixture(scope="module")
def filtered():
    rig = rig_of(tilted_recordings([{"name": "delay", "delay_s": 0.1}], runs=2, rows=80))

    def with_effects(**effects):
        named = [Effect(name, {}) for name in effects]
        problem = Problem.of(rig, segments(rig, whole=True), effects=named, time_scale=VALUES[3])
        values = np.array([[*VALUES, *effects.values()]])
        return problem.filter(values, NOISE[None])[0]

    return with_effects


def test_with_an_old_picture_the_marble_is_as_late_as_with_a_late_command_and_the_tilt_is_not(filtered):
    late, old, neither = filtered(delay=0.1), filtered(latency=0.1), filtered()
    for one, other in zip(late.predicted, old.predicted, strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(neither.tilt, old.tilt, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (late.log_likelihood[:, 2:] > old.log_likelihood[:, 2:] + 20.0).all()


def test_the_parts_of_a_delay_add_up(filtered):
    whole, parts = filtered(delay=0.1), filtered(delay=0.04, latency=0.06)
    for one, other in zip(whole.predicted, parts.predicted, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    for one, other in zip(filtered(delay=0.04).tilt, parts.tilt, strict=True):
        np.testing.assert_array_equal(one, other)
