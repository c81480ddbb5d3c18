"""How far a marble has rolled, from noisy positions with gaps and slips."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.path_length import rolled


def there_and_back(rows=160):
    """Return a path along an ellipse, and its length up to each row."""
    fine = np.linspace(0.0, 3.0 * np.pi, 50 * (rows - 1) + 1)
    path = np.stack([0.3 * np.sin(fine), 0.2 * np.cos(0.7 * fine)], axis=1)
    length = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    return path[::50], length[::50]


@pytest.mark.parametrize("noise", [0.0, 5e-4, 2e-3])
def test_it_follows_a_path_through_noise(noise):
    path, length = there_and_back()
    seen = path + noise * np.random.default_rng(0).standard_normal(path.shape)
    # Within a few standard deviations anywhere, and 1 % of the way in the end.
    assert np.abs(rolled(seen)[1] - length).max() < 4.0 * noise + 0.01 * length[-1]


def test_a_marble_at_rest_goes_nowhere():
    random = np.random.default_rng(1)
    still = [0.1, -0.2] + 1e-3 * random.standard_normal((1000, 2))
    assert rolled(still)[1][-1] < 0.02


def test_slips_of_the_tracker_are_no_way():
    path, length = there_and_back()
    seen = path + 5e-4 * np.random.default_rng(2).standard_normal(path.shape)
    seen[[30, 77, 120]] += [[0.4, 0.0], [0.0, -0.3], [0.2, 0.2]]
    seen[50:54] = np.nan
    assert np.abs(rolled(seen)[1] - length).max() < 0.02 * length[-1]


@given(
    st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)), min_size=1, max_size=30),
    st.sets(st.integers(0, 29)),
)
def test_it_never_falls_and_takes_any_gap(places, lost):
    marble = np.array(places)
    marble[[row for row in lost if row < len(marble)]] = np.nan
    _, way = rolled(marble)
    assert way.shape == (len(marble),)
    assert np.isfinite(way).all()
    assert way[0] == 0.0
    assert (np.diff(way) >= 0.0).all()
