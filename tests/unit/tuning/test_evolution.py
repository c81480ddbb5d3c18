import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.tuning.drive import Drive
from irt.tuning.evolution import STRATEGIES, reflected
from irt.tuning.search import run

DRIVE = Drive.paper()
START = np.array([0.5, 0.5, 0.5, 0.5, 0.5])


@pytest.fixture(scope="module")
def target():
    return DRIVE.simulate(np.array([[0.06, 0.04, 3e-4, 24.0, 1.1]]))[0][0]


@pytest.mark.parametrize("name", STRATEGIES)
def test_it_comes_nearer_and_stays_within_the_ranges(target, name):
    (path,) = run(DRIVE, [[target]], [STRATEGIES[name](DRIVE, START, 0)], 1005)
    assert path.mae.min() < 0.02
    assert path.mae.min() < 0.2 * path.mae[0]
    scaled = DRIVE.scaled(path.parameters)
    assert scaled.min() >= 0.0
    assert scaled.max() <= 1.0


@pytest.mark.parametrize(("name", "first", "then"), [("cma-es", 10, 10), ("es", 5, 100)])
def test_generations_are_as_large_as_the_papers(target, name, first, then):
    sizes = []
    search = STRATEGIES[name](DRIVE, START, 0)

    def counted():
        batch = next(search)
        while True:
            sizes.append(len(batch))
            batch = search.send((yield batch))

    run(DRIVE, [[target]], [counted()], 250)
    assert sizes[0] == first
    assert set(sizes[1:]) == {then}


@pytest.mark.parametrize("name", STRATEGIES)
def test_the_same_seed_searches_alike(target, name):
    one, again, other = (
        run(DRIVE, [[target]], [STRATEGIES[name](DRIVE, START, seed)], 120)[0].mae for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


@given(st.floats(-5.0, 5.0))
def test_reflection_leads_back_inside_and_leaves_what_is_there(value):
    back = float(reflected(np.array([value]))[0])
    assert 0.0 <= back <= 1.0
    if 0.0 <= value <= 1.0:
        assert back == pytest.approx(value)
