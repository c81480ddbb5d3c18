import numpy as np
import pytest

from irt.tuning import library as module
from irt.tuning.drive import Drive
from irt.tuning.library import Library


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    monkeypatch.setattr(module, "PATHS", 500)
    monkeypatch.setattr(module, "_AT_ONCE", 200)


@pytest.mark.parametrize("which", ["paper_drive", "stamped_drive"])
def test_the_nearest_path_is_the_nearest_of_all(which, stamped_drive):
    drive = Drive.paper() if which == "paper_drive" else stamped_drive
    library = Library(drive, 1)
    parameters, paths = library._simulated
    assert len(parameters) == len(paths) == 500
    target = drive.simulate(drive.parameters(np.full((1, 5), 0.6)), 1)
    nearest, distance = library.nearest(target)
    distances = np.abs(paths - drive.inputs(target)).mean(axis=1)
    assert distance == pytest.approx(distances.min(), rel=1e-4)
    np.testing.assert_array_equal(nearest[0], parameters[distances.argmin()])


def test_a_path_of_its_own_is_found_exactly():
    drive = Drive.paper()
    library = Library(drive, 1)
    parameters, _ = library._simulated
    nearest, distance = library.nearest(drive.simulate(parameters[321:322]))
    np.testing.assert_array_equal(nearest, parameters[321:322])
    assert distance < 1e-6
