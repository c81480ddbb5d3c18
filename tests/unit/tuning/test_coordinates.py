from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.engine import rollouts
from irt.rig import Marble
from irt.tuning.coordinates import Coordinates
from irt.tuning.drive import Drive

PAPER = Coordinates(Drive.paper())
SCALED = st.lists(st.floats(0.02, 1.0), min_size=5, max_size=5).map(lambda values: np.array([values]))


@given(SCALED)
def test_there_and_back(scaled):
    parameters = PAPER.drive.parameters(scaled)
    back = PAPER.parameters(PAPER.of(parameters))
    parameters[:, 3] = np.maximum(np.rint(parameters[:, 3]), 1.0)
    np.testing.assert_allclose(back, parameters, rtol=1e-9, atol=1e-12)


@given(SCALED, st.lists(st.floats(-2.0, 2.0), min_size=5, max_size=5))
def test_wherever_a_step_leads_it_stays_within_the_ranges(scaled, step):
    moved = PAPER.parameters(PAPER.of(PAPER.drive.parameters(scaled)) + np.array([step]))
    scaled = PAPER.drive.scaled(moved)
    assert (scaled >= -1e-12).all()
    assert (scaled <= 1.0 + 1e-12).all()


def test_another_time_scale_keeps_what_a_path_shows():
    parameters = np.array([[0.03, 0.02, 2e-4, 40.0, 1.0]])
    at = PAPER.of(parameters)
    slower = PAPER.at_time_scale(at, np.array([30.0]))
    np.testing.assert_allclose(slower[:, :3], parameters[:, :3] * (40 / 30) ** 2)
    np.testing.assert_allclose(PAPER.of(slower)[:, :4], at[:, :4])
    before, after = (PAPER.drive.simulate(each)[0] for each in (parameters, slower))
    assert np.abs(before - after).mean() < 0.002


def test_where_a_gear_would_leave_its_range_the_time_scale_gives_way():
    at = PAPER.of(np.array([[0.09, 0.05, 2e-4, 50.0, 1.0]]))
    at[0, 4] = np.log1p(20.0)
    found = PAPER.parameters(at)
    assert found[0, 3] == pytest.approx(np.ceil(50.0 * np.sqrt(0.9)))
    np.testing.assert_allclose(PAPER.of(found)[:, :4], at[:, :4])


def test_a_stamped_time_scale_stays(stamped_drive):
    coordinates = Coordinates(stamped_drive)
    parameters = np.array([[0.05, 0.04, 3e-4, 12.0, 1.1]])
    np.testing.assert_allclose(coordinates.parameters(coordinates.of(parameters) + np.eye(5)[4]), parameters)


def test_all_but_the_time_scale_shows():
    assert PAPER.shown.tolist() == [0, 1, 2, 3]


@given(SCALED)
def test_the_middle_of_what_is_open_keeps_what_a_path_shows(scaled):
    at = PAPER.of(PAPER.drive.parameters(scaled))
    central = PAPER.parameters(PAPER.central(at))
    np.testing.assert_allclose(PAPER.of(central)[0, :3], at[0, :3], rtol=1e-6, atol=1e-9)


def test_the_middle_of_what_is_open_is_nearer_than_a_guess():
    """Over targets drawn from the ranges no other choice that sees the products alone is nearer."""
    truth = PAPER.drive.parameters(np.random.default_rng(4).random((2000, 5)))
    at = PAPER.of(truth)
    central = PAPER.parameters(PAPER.central(at))
    for column, others in ((3, (15.0, 25.0, 35.0)), (4, (0.9, 1.0, 1.1))):
        error = np.abs(central[:, column] - truth[:, column]).mean()
        assert all(error < np.abs(other - truth[:, column]).mean() for other in others)


def test_damping_shows_the_time_scale():
    damped = Coordinates(replace(PAPER.drive, marble=Marble(damping_per_s=0.04)))
    at = damped.of(np.array([[0.03, 0.02, 2e-4, 40.0, 1.15]]))
    moved = damped.central(at)
    assert moved[0, 4] == at[0, 4]
    # At one time scale three gears and frictions with a given product are 1/scale^3 as dense.
    median = ((0.8**-2 + 1.2**-2) / 2.0) ** -0.5
    assert damped.parameters(moved)[0, 4] == pytest.approx(median, abs=0.005)


def test_products_that_are_equal_are_one_path_off_the_rim():
    wave = 0.02 * np.sin(np.arange(60) / 5.0)[:, None] * np.ones(2)
    one = np.array([[0.05, 0.04, 2e-4, 20.0, 1.0]])
    other = np.array([[0.05 / 1.1, 0.04 / 1.1, 2e-4 / 1.1, 20.0, 1.1]])
    np.testing.assert_allclose(PAPER.of(one)[:, :3], PAPER.of(other)[:, :3])
    np.testing.assert_allclose(rollouts(one, wave), rollouts(other, wave), atol=1e-9)
