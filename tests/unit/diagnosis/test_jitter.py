"""Delays that differ, and what only looks like them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.catalogue import effect
from irt.diagnosis import run
from irt.diagnosis.case import Case
from irt.diagnosis.jitter import kicks, matters, spread, with_clock
from irt.diagnosis.latent import Leftover
from irt.diagnosis.search import Search
from irt.diagnosis.stretches import Arrivals, stretches
from irt.engine import rollouts
from irt.model import Parameter


def searched(case):
    search = Search(case, lambda _: None)
    search.keep(case.fit())
    return search


def price(search):
    return search.evidence().price(2, 1)


@pytest.mark.slow
def test_delays_that_differ_are_sized(plant):
    case = plant([{"name": "delay_jitter", "sd_s": 0.12}], runs=8, rows=120)
    search = searched(case)
    mean = search.with_effect("delay")
    told = kicks(case, mean, price(search))
    assert told is not None
    size = spread(case, mean, told)
    # In rows: from rest, gears and a clock that are both off move the marble as the right ones do.
    truth = 0.12 / (15.0 / 240.0) * case.row_s(mean)
    assert 0.5 * truth < size.value < 2.0 * truth
    assert size.low < truth < size.high
    assert matters(case, mean)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planted", "chance"),
    [
        ({"name": "delay_jitter", "sd_s": 0.12}, True),
        ({"name": "slew_limit", "rate_rad_per_s": 0.1}, False),
        ({"name": "clock_drift", "drift": 0.2}, False),
    ],
    ids=lambda one: one["name"] if isinstance(one, dict) else "",
)
def test_beside_a_lag_delays_that_differ_have_to_beat_what_repeats(plant, planted, chance):
    """A lag rounds kicks, so that a push in each row explains them as well as they do themselves."""
    search = searched(plant([planted], runs=8, rows=120))
    told = kicks(search.case, search.with_effect("lag"), price(search), is_rounded=True)
    assert (told is not None) is chance


@pytest.mark.slow
def test_a_knob_that_cannot_follow_does_the_same_whenever_it_is_told_to(plant):
    case = plant([{"name": "slew_limit", "rate_rad_per_s": 0.1}], runs=6, rows=120)
    search = searched(case)
    mean = search.with_effect("delay")
    assert Leftover(case, mean).sources(0, nulls=0)[0].variable == "command history"
    assert kicks(case, mean, price(search)) is None


@pytest.mark.parametrize("late", [-1, 1, 2])
def test_a_late_command_moves_the_marble_as_the_engine_says(plant, late):
    case = plant(runs=1)
    (run,) = case.rig.recordings
    values = [0.06, 0.05, 1e-6, 15.0, 1.03]
    fitted = replace(case.fit(), values=np.array(values), noise=1e-3)
    rows, _, _ = stretches(case, fitted, 24, weak=False, most=400)
    time, arrivals = rows.time[rows.stretch == 0], rows.arrivals[0]
    checked = 0
    for column, row in enumerate(arrivals.at.round().astype(int)):
        if row < 3 or row + late >= len(run.knobs):
            continue
        # The step of this row alone comes sooner or later.
        steps = np.diff(run.knobs, axis=0, prepend=0.0)
        steps[row + late] += steps[row]
        steps[row] = 0.0
        both = rollouts([values] * 2, [run.knobs, steps.cumsum(axis=0)], start=run.marble[0])
        alone = Arrivals(arrivals.at[[column]], 0.0, arrivals.push[[column]])
        moved = alone.moved(time, np.full((1, 1), late))[:, 0].reshape(2, -1).T
        expected = (both[1] - both[0])[time.astype(int)]
        within = 0.05 * abs(late) * np.abs(arrivals.push[column]).max()
        np.testing.assert_allclose(moved, expected, atol=within)
        checked += 1
    assert checked > 10


@pytest.mark.parametrize(("noises", "believed"), [(1.1, False), (1.4, True)])
def test_delays_that_differ_have_to_leave_more_than_the_tracker_does(noises, believed):
    """Its own memory, on a board that hardly moves, looks like kicks."""
    assert matters(SimpleNamespace(noise=1e-3), SimpleNamespace(noise=noises * 1e-3)) is believed


@pytest.mark.slow
def test_a_picture_that_turns_with_the_tilt_is_the_cameras(plant):
    case = plant(runs=6, rows=120)
    turned = []
    for one in case.rig.recordings:
        place = (one.marble[:, 0] + 1j * one.marble[:, 1]) * np.exp(0.9j * one.knobs[:, 0])
        turned.append(replace(one, marble=np.stack([place.real, place.imag], axis=1)))
    case = Case.of(replace(case.rig, recordings=tuple(turned)))
    search = searched(case)
    mean = search.with_effect("delay")
    likeliest = Leftover(case, mean, longest=60).sources(0)[0]
    assert (likeliest.variable, likeliest.stage) == ("command", "camera")
    assert kicks(case, mean, price(search)) is None


@pytest.mark.parametrize(
    ("effects", "asked"),
    [
        (["clock_drift", "delay"], [("clock_drift", "delay")]),
        (["clock_drift"], [("delay",), ("clock_drift", "delay")]),
        ([], [("delay",)]),
    ],
)
def test_delays_that_differ_are_looked_for_beside_what_else_is_missing(plant, monkeypatch, effects, asked):
    """What one delay leaves of a clock that drifts looks like them, until the drift is in the model."""
    search = searched(plant(runs=2, rows=40))
    for names in (effects[:1], effects):
        search.keep(search.case.refine(names, neutral(search, names))[0])
    seen = []
    monkeypatch.setattr(run, "kicks", lambda case, one, price, **_: seen.append(one.effects))
    assert run._jittering(search, search.fits[frozenset(effects)], lambda _: None) is None
    assert seen == asked


def neutral(search, names):
    """Return the base model's values, and of effects those without effect, (1, n)."""
    values = [one.neutral for name in names for one in effect(name).parameters if not one.optional]
    return np.array([[*search.base.values, *values]])


@given(
    st.floats(0.01, 0.3), st.floats(0.1, 1.0), st.floats(1.0, 3.0), st.floats(0.2, 1.0), st.floats(1.0, 4.0)
)
def test_a_spread_is_known_no_better_than_the_clock(size, low, high, slow, fast):
    told = with_clock(Parameter(size, low * size, high * size), Parameter(15.0, 15.0 * slow, 15.0 * fast))
    assert told.value == size
    assert told.low == pytest.approx(low * slow * size)
    assert told.high == pytest.approx(high * fast * size)


def test_a_spread_has_no_interval_where_the_clock_has_none():
    told = with_clock(Parameter(0.1, 0.05, 0.2), Parameter(15.0, None, None))
    assert (told.value, told.low, told.high) == (0.1, None, None)


def test_of_commands_that_differ_in_delay_one_that_is_overtaken_comes_with_the_later_one():
    """Sent a hundredth of a row apart, the first comes at the sooner time of both."""
    time, push = np.arange(120.0), np.array([[1.0, -2.0], [3.0, 0.5]])
    draws = Arrivals(np.array([60.0, 60.01]), 40.0, push).jittered(time, 5.0)
    # Far behind both the rate is minus what each is late times its push: along x 1 and 3, along y -2 and 0.5.
    x, y = draws[119] - draws[118], draws[239] - draws[238]
    first, second = np.linalg.solve([[-1.0, -3.0], [2.0, -0.5]], np.array([x, y]))
    assert (first <= second + 0.011).all()
    same = np.isclose(first, second, atol=0.011)
    assert 0.3 < same.mean() < 0.7
    assert abs(0.5 * (first + second).mean()) < 1e-6


def test_no_command_comes_before_it_is_sent():
    time, push = np.arange(60.0), np.ones((1, 2))
    draws = Arrivals(np.array([20.0]), 0.0, push).jittered(time, 3.0)
    late = -(draws[59] - draws[58])
    # Half of the delays are none: of a normal variable cut at zero.
    assert np.isclose(late, late.min()).mean() == pytest.approx(0.5, abs=0.1)
    assert late.std() == pytest.approx(0.58 * 3.0, rel=0.15)


def test_where_no_command_arrives_none_is_late():
    nothing = Arrivals(np.zeros(0), 0.0, np.zeros((0, 2)))
    assert not nothing.jittered(np.arange(5.0), 1.0).any()
