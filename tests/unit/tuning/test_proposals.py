import numpy as np
import pytest

from irt.tuning.drive import Drive
from irt.tuning.search import Path, compare, run

DRIVE = Drive.paper()
TRUTH = np.array([[0.06, 0.04, 3e-4, 20.0, 1.1]])


@pytest.fixture(scope="module")
def target():
    return DRIVE.simulate(TRUTH)[0][0]


def asks(batches, received):
    for batch in batches:
        received.append((yield batch))


def proposals(count):
    return DRIVE.parameters(np.random.default_rng(count).random((count, 5)))


def test_it_receives_the_simulation_of_each_proposal(target):
    received = []
    batch = np.vstack([proposals(2), TRUTH])
    (path,) = run(DRIVE, [[target]], [asks([batch], received)], 10)
    (seen,) = received
    expected = np.abs(target - DRIVE.simulate(batch)[0]).mean(axis=(1, 2))
    np.testing.assert_allclose(seen.mae, expected)
    assert seen.mae[2] == 0.0
    np.testing.assert_array_equal(path.mae, seen.mae)
    np.testing.assert_array_equal(path.parameters, batch)
    assert len(seen[1:]) == 2


@pytest.mark.parametrize("rollouts", [1, 3, 4, 7, 11])
def test_no_rollout_counts_beyond_what_is_given(target, rollouts):
    received = []
    search = asks([proposals(3), proposals(1), proposals(5), proposals(2)], received)
    (path,) = run(DRIVE, [[target]], [search], rollouts)
    assert len(path.mae) == rollouts
    # A cut batch is never returned: a search may rely on a complete answer.
    assert sum(map(len, received)) <= rollouts


def test_searches_of_different_length_do_not_mind_each_other(target):
    batches = [proposals(3), proposals(4)]
    alone = run(DRIVE, [[target]], [asks(batches, [])], 20)[0]
    together = run(
        DRIVE,
        [[target]] * 3,
        [asks([proposals(2)], []), asks(batches, []), asks([proposals(9)], [])],
        20,
    )
    np.testing.assert_array_equal(together[1].mae, alone.mae)
    assert [len(path.mae) for path in together] == [2, 7, 9]


def test_what_is_held_is_the_best_so_far():
    path = Path(np.arange(20.0).reshape(4, 5), np.array([0.3, 0.4, 0.1, 0.2]))
    assert path.best.mae.tolist() == [0.3, 0.3, 0.1, 0.1]
    assert path.best.parameters[:, 0].tolist() == [0.0, 0.0, 10.0, 10.0]
    assert path.padded(6).mae.tolist() == [0.3, 0.4, 0.1, 0.2, 0.2, 0.2]
    assert path.padded(2).mae.tolist() == [0.3, 0.4]


def test_lost_rows_do_not_count(target):
    holed = target.copy()
    holed[10:20] = np.nan
    seen = compare(DRIVE, proposals(2), [holed])
    kept = np.isfinite(holed[:, 0])
    expected = np.abs(target[kept] - DRIVE.simulate(seen.parameters)[0][:, kept]).mean(axis=(1, 2))
    np.testing.assert_allclose(seen.mae, expected)
    assert np.isfinite(seen.missing[0]).all()
