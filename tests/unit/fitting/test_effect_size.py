"""Which parameters of an effect are its size."""

import numpy as np
import pytest

from irt.catalogue import effect, hypothetical
from irt.fitting.effect_size import sizes_of, strong_values, try_path


@pytest.mark.parametrize("name", [one.name for one in hypothetical() if not one.of_rims])
def test_an_effect_of_no_size_does_nothing(name):
    sizes = {one.name: one.neutral for one in sizes_of(name)}
    assert set(sizes) <= {one.name for one in effect(name).required}
    without = try_path([{"name": name, **strong_values(name), **sizes}])
    np.testing.assert_array_equal(without, try_path([]))


@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("perspective", ["slope_x", "slope_y"]),
        ("camera_offset", ["x_edges", "y_edges"]),
        ("backlash", ["width_x_rad", "width_y_rad"]),
        ("stribeck", ["strength"]),
        ("bump", ["height_m"]),
    ],
)
def test_the_distance_of_a_camera_and_the_width_of_a_bump_are_no_sizes(name, sizes):
    assert [one.name for one in sizes_of(name)] == sizes


def test_forces_at_the_rim_are_sizes_of_a_learned_correction():
    """The run that tries parameters never meets the rim."""
    sizes = {one.name for one in sizes_of("unlisted")}
    assert sizes >= {"rim_hold_m_per_s2", "rim_brake_m_per_s2", "rim_drag_per_s", "push_1_x_m_per_s2"}
    assert sizes.isdisjoint({"wave_1_x_per_m", "phase_1_rad", "drag_power"})
