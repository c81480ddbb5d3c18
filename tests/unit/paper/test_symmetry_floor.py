from dataclasses import replace

import numpy as np
import pytest

from irt.paper.errors import share_of_the_way
from irt.paper.setting import Setting
from irt.paper.symmetry import _alike, floor, symmetry
from irt.tuning.drive import Drive

DRIVE = Drive.paper()


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    setting = Setting(tmp_path_factory.mktemp("out"), threads=1)
    return symmetry(setting, np.array([0.7, 0.85, 1.0]))


def test_off_the_rim_and_without_damping_nothing_changes(found):
    assert found.change["no rim, no damping"].max() < 1e-3
    assert found.change["no rim, no damping"][-1].max() == 0.0


def test_damping_brings_a_physical_time(found):
    """At the furthest of the factors, which stands first."""
    change = {name: quartiles[0, 1] for name, quartiles in found.change.items()}
    assert change["rim, no damping"] < change["rim, damping 0.04/s"] < change["rim, damping 0.4/s"]


def test_parameters_change_all_the_same(found):
    assert found.parameter_error[0] > 0.05
    assert found.parameter_error[-1] == 0.0


def test_where_the_rim_shows_the_scale_combinations_have_no_floor():
    at_rim, within = (
        floor(DRIVE, np.array([[*gears, 3e-4, steps, 0.95]]), 0)
        for gears, steps in (((0.08, 0.06), 40.0), ((0.01, 0.008), 12.0))
    )
    assert at_rim.combinations == pytest.approx(0.0, abs=1e-9)
    assert within.combinations > 0.005
    assert min(at_rim.parameters, within.parameters) > 0.02


def test_a_path_that_nearly_meets_the_rim_shows_the_least_scale():
    """The same path with a smaller scale would have met it: so fewer parameters are alike."""
    truth = np.array([[0.012, 0.008, 1e-4, 21.0, 1.18]])
    way = float(share_of_the_way(DRIVE, DRIVE.simulate(truth)[0])[0])
    assert 0.8 < way < 0.99 * 1.18
    alike, _ = _alike(DRIVE, truth[0], way, np.random.default_rng(0))
    assert way <= alike[:, 4].min() < way + 0.05


def test_a_range_that_is_closed_leaves_no_choice():
    ranges = {**DRIVE.ranges, "time_scale": (25.0, 25.0), "observation_scale": (0.94, 0.96)}
    drive = replace(DRIVE, ranges=ranges)
    found = floor(drive, np.array([[0.05, 0.03, 3e-4, 25.0, 0.95]]), 0)
    assert found.parameters == pytest.approx(0.0, abs=1e-9)
