from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.fitting.identifiability import informed, intervals, with_intervals
from irt.fitting.information import Information
from irt.fitting.sentences import SYMMETRIES, unidentifiable
from irt.model import Model
from irt.rig import PARAMETERS, RANGES
from irt.segments import segments

VALUES = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])
ENDS = np.array([RANGES[name] for name in PARAMETERS])
WIDTHS = np.ptp(ENDS, axis=1)
ALLOWED = np.array([(-np.inf, np.inf)] * 5)


def information(flat=(), half_width=0.01, values=VALUES, free=(True,) * 5):
    """Return information in which the given directions, (5,) in units of the ranges, alone are flat."""
    free = np.array(free)
    rows = np.array([*flat, *np.eye(5)[free]])
    directions = np.linalg.qr(rows.T)[0].T[: free.sum()]
    widths = np.full(free.sum(), half_width)
    widths[: len(flat)] = np.inf
    ranges = np.stack([np.minimum(ENDS[:, 0], values), np.maximum(ENDS[:, 1], values)], axis=1)
    return Information(
        PARAMETERS, values, WIDTHS, ranges, ALLOWED, free, directions, widths, np.zeros(free.sum())
    )


def along(name, values=VALUES):
    return SYMMETRIES[name] * values / WIDTHS


def test_what_is_known_has_its_own_interval_and_no_sentence():
    known = information(half_width=0.02)
    low, high = intervals(known)
    np.testing.assert_allclose(high - VALUES, 0.02 * WIDTHS)
    np.testing.assert_allclose(VALUES - low, 0.02 * WIDTHS)
    assert unidentifiable(known, low, high) == ()


def test_an_interval_holds_the_linearised_best_fit_too():
    known = information(half_width=0.02)
    offset = np.linalg.solve(known.directions.T, [0.05, 0.0, 0.0, 0.0, 0.0])
    moved = Information(*[*vars(known).values()][:-1], offset)
    low, high = intervals(moved)
    assert high[0] - VALUES[0] == pytest.approx(0.07 * WIDTHS[0])
    assert VALUES[0] - low[0] == pytest.approx(0.02 * WIDTHS[0])


def some_flat(flat, seed, count=24):
    """Random directions of values within (0, 1), of which the first ones are flat."""
    random = np.random.default_rng(seed)
    values = random.uniform(0.2, 0.8, count)
    return Information(
        tuple(f"p{index}" for index in range(count)),
        values,
        np.ones(count),
        np.tile([0.0, 1.0], (count, 1)),
        np.tile([-np.inf, np.inf], (count, 1)),
        np.ones(count, dtype=bool),
        np.linalg.qr(random.standard_normal((count, count)))[0],
        np.where(np.arange(count) < flat, np.inf, 0.01),
        np.zeros(count),
    )


def furthest(info, moves):
    """Return how far (m, n) moves of logarithms go until a value reaches 1, or 1e-4."""
    room = np.where(moves > 0.0, -np.log(info.values), np.log(info.values / 1e-4))
    return (room / np.maximum(np.abs(moves), 1e-12)).min(axis=1, keepdims=True)


@pytest.mark.slow
@settings(deadline=None, max_examples=15)
@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_intervals_hold_what_many_flat_directions_reach(flat, seed):
    """An effect has dozens of parameters, and most of its directions may be flat."""
    info = some_flat(flat, seed)
    low, high = intervals(info)
    moves = np.random.default_rng(seed).standard_normal((20, flat)) @ info.directions[:flat] / info.values
    reached = info.values * np.exp(0.999 * furthest(info, moves) * moves)
    assert (reached >= low - 1e-3).all()
    assert (reached <= high + 1e-3).all()


@pytest.mark.slow
@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_intervals_of_one_flat_direction_end_where_it_does(seed):
    info = some_flat(1, seed)
    moves = np.stack([info.directions[0], -info.directions[0]]) / info.values
    ends = info.values * np.exp(furthest(info, moves) * moves)
    known = np.array([info.margin(axis) for axis in np.eye(len(info.values))])
    low, high = intervals(info)
    np.testing.assert_allclose(low, np.maximum(ends.min(axis=0) - known, 0.0), atol=1e-3)
    np.testing.assert_allclose(high, np.minimum(ends.max(axis=0) + known, 1.0), atol=1e-3)


def test_intervals_stop_where_physics_does():
    low, _ = intervals(information(half_width=0.2, values=VALUES * [1, 1, 0.01, 1, 1]))
    assert low[2] == 0.0


def test_along_the_first_symmetry_intervals_reach_until_a_range_ends():
    """From gear_x = 0.06 the gears can grow by 5/3 as time_scale falls, or shrink until it is 50."""
    flat = information([along("time")], half_width=1e-9)
    low, high = intervals(flat)
    np.testing.assert_allclose(high[:3], VALUES[:3] / 0.6, rtol=1e-6)
    np.testing.assert_allclose([low[3], high[3]], [20.0 * np.sqrt(0.6), 50.0], rtol=1e-6)
    np.testing.assert_allclose(low[:3], VALUES[:3] * (20.0 / 50.0) ** 2, rtol=1e-6)
    np.testing.assert_allclose([low[4], high[4]], [1.05, 1.05], rtol=1e-6)


def test_the_first_symmetry_is_named_with_what_is_known_all_the_same():
    flat = information([along("time")], half_width=1e-4)
    (sentence,) = unidentifiable(flat, *intervals(flat))
    assert "time_scale is divided by its square root" in sentence
    assert "time_scale^2 * gear_x = 24 +- " in sentence
    assert "time_scale^2 * gear_y = 20 +- " in sentence
    assert "t_s" in sentence
    assert "observation_scale" not in sentence


def test_the_second_symmetry_is_named():
    flat = information([along("scale")], half_width=1e-4)
    (sentence,) = unidentifiable(flat, *intervals(flat))
    assert "observation_scale is divided by it" in sentence
    assert "observation_scale * gear_x = 0.063 +- " in sentence
    assert "wall" in sentence


def test_both_symmetries_make_one_sentence():
    flat = information([along("time"), along("scale")], half_width=1e-4)
    (sentence,) = unidentifiable(flat, *intervals(flat))
    assert "time_scale^2 * observation_scale * gear_x = 25.2 +- " in sentence


def test_a_parameter_that_nothing_shows_is_named_alone():
    flat = information([np.eye(5)[1]], half_width=1e-4)
    low, high = intervals(flat)
    assert low[1] == pytest.approx(0.0, abs=1e-4)
    assert high[1] == pytest.approx(0.1)
    assert unidentifiable(flat, low, high) == (
        "These recordings do not identify gear_y: any value from 0 to 0.1 fits equally well.",
    )


def test_two_parameters_that_cannot_be_separated():
    flat = information([[0.6, 0.0, 0.8, 0.0, 0.0]], half_width=1e-4)
    (sentence,) = unidentifiable(flat, *intervals(flat))
    assert "do not separate gear_x and rolling_friction" in sentence
    assert "gear_y" not in sentence


def test_a_symmetry_and_something_else():
    flat = information([along("time"), np.eye(5)[4]], half_width=1e-4)
    sentences = unidentifiable(flat, *intervals(flat))
    assert len(sentences) == 2
    assert "square root" in sentences[0]
    assert "do not identify observation_scale" in sentences[1]


def test_nothing_known():
    flat = information(np.eye(5))
    low, high = intervals(flat)
    assert unidentifiable(flat, low, high) == (
        "These recordings contain next to no information on any parameter; did the marble move?",
    )
    np.testing.assert_allclose(low, ENDS[:, 0], atol=1e-3)
    np.testing.assert_allclose(high, ENDS[:, 1])


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.floats(0.05, 0.95), min_size=5, max_size=5).map(np.array),
    st.integers(1, 4),
    st.integers(0, 2**32 - 1),
)
def test_intervals_hold_the_value_and_stay_within_the_ranges(unit, count, seed):
    values = ENDS[:, 0] + unit * WIDTHS
    flat = np.random.default_rng(seed).standard_normal((count, 5))
    low, high = intervals(information(list(flat), half_width=1e-6, values=values))
    assert (low <= values).all()
    assert (values <= high).all()
    assert (low >= ENDS[:, 0] - 1e-5 * WIDTHS).all()
    assert (high <= ENDS[:, 1] + 1e-5 * WIDTHS).all()


@given(st.floats(1e-4, 0.2), st.integers(0, 2**32 - 1))
def test_a_margin_scales_with_the_function_and_with_what_is_open(half_width, seed):
    known = information(half_width=half_width)
    change = np.random.default_rng(seed).standard_normal(5)
    assert known.margin(change) == pytest.approx(half_width * np.linalg.norm(change))
    assert known.margin(3.0 * change) == pytest.approx(3.0 * known.margin(change))


def test_intervals_work_for_a_model_of_any_origin(planted):
    """Here one that is off: the intervals hold the truth, which is where the linearised best fit lies."""
    rig = planted(3, noise=5e-4, stamped=True)
    off = Model.from_rig(rig, VALUES * [1.01, 0.99, 1.05, 1.0, 1.0], time_step="continuous")
    found = informed(off, segments(rig), 5e-4)
    parameters, sentences = with_intervals(found), unidentifiable(found, *intervals(found))
    for name, truth in (("gear_x", 0.06), ("gear_y", 0.05), ("rolling_friction", 0.0004)):
        assert parameters[name].low <= truth <= parameters[name].high
        assert parameters[name].value == off.parameters[name].value
    assert parameters["time_scale"].low is None
    assert any("observation_scale" in sentence for sentence in sentences)


def test_a_knob_that_never_moves_says_nothing_about_its_gear(planted):
    rig = planted(2, noise=5e-4)
    still = tuple(
        replace(recording, knobs=recording.knobs * [0.0, 1.0], marble=recording.marble * [1.0, 0.0])
        for recording in rig.recordings
    )
    rig = replace(rig, recordings=still)
    model = Model.from_rig(rig, VALUES, time_step="continuous")
    found = informed(model, segments(rig), 5e-4)
    parameters, sentences = with_intervals(found), unidentifiable(found, *intervals(found))
    assert parameters["gear_x"].low == pytest.approx(0.0, abs=1e-3)
    assert parameters["gear_x"].high == pytest.approx(0.1)
    assert any("gear_x" in sentence for sentence in sentences)


def with_an_effect(value, flat):
    """Return information on the five and on a bias from -0.01 to 0.01 that may be unknown."""
    known = information()
    directions = np.eye(6)
    return Information(
        names=(*PARAMETERS, "tilt_bias.bias_x_rad"),
        values=np.append(VALUES, value),
        widths=np.append(WIDTHS, 0.02),
        ranges=np.vstack([known.ranges, [-0.01, 0.01]]),
        allowed=np.vstack([ALLOWED, [-0.5, 0.5]]),
        free=np.ones(6, dtype=bool),
        directions=directions,
        half_width=np.array([0.01] * 5 + [np.inf if flat else 0.01]),
        offset=np.zeros(6),
    )


def test_an_effects_parameter_may_have_either_sign():
    known = with_an_effect(1e-4, flat=False)
    low, high = intervals(known)
    np.testing.assert_allclose([low[5], high[5]], [-1e-4, 3e-4])
    assert unidentifiable(known, low, high) == ()


def test_an_effects_parameter_that_nothing_shows_may_be_anywhere():
    flat = with_an_effect(1e-3, flat=True)
    low, high = intervals(flat)
    np.testing.assert_allclose([low[5], high[5]], [-0.01, 0.01])
    (sentence,) = unidentifiable(flat, low, high)
    assert "do not identify tilt_bias.bias_x_rad: any value from -0.01 to 0.01" in sentence
