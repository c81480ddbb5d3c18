"""Runs through the rendered camera: what is hidden in the sensing is in the picture, for a tracker to see."""

from __future__ import annotations

import dataclasses
import io
import json
from collections.abc import Mapping

import numpy as np
import pytest
from scipy.optimize import least_squares

from irt.proof.pybullet_world import camera
from irt.proof.pybullet_world.__main__ import serve
from irt.proof.pybullet_world.effects import EFFECTS
from irt.proof.pybullet_world.out_of_catalogue import BEYOND
from irt.proof.pybullet_world.physics import EDGE_X_M, EDGE_Y_M, RADIUS_M, Array, acts
from irt.proof.pybullet_world.played import Played
from irt.proof.pybullet_world.record import record
from irt.proof.pybullet_world.spec import Spec
from irt.tracking import positions
from irt.tracking.corners import find_corners

pytest.importorskip("pybullet", reason="PyBullet has wheels up to Python 3.11 only: pip install pybullet")

SENSING = {
    "camera_rotation": {"angle_rad": 0.1},
    "camera_offset": {"x_edges": 0.05, "y_edges": -0.03},
    "perspective": {"slope_x": 0.08, "slope_y": -0.05},
    "lens_distortion": {"k_per_edge2": -0.2},
    "parallax": {"height_m_per_rad": 0.5},
}


def spec_with(*effects: Mapping[str, object]) -> Spec:
    return Spec("rig-000", 11, 0.07, 0.06, 5e-4, 16.0, 1.04, effects, sigma=0.001, through_camera=True)


def some(played: Played, every: int) -> Played:
    return Played(*(each[::every] for each in vars(played).values()))


@pytest.mark.parametrize("name", SENSING)
def test_picture_shows_what_the_formula_says(name: str) -> None:
    """Ten degrees aslant, a camera also sees the board 1.5 % shorter, which the world's formula has not."""
    spec = spec_with({"name": name, **SENSING[name]})
    played = spec.play(0)
    plain = dataclasses.replace(spec, effects=())
    shift = camera.perfect(spec, played) - camera.perfect(plain, played)
    formula = played.seen - played.places / EDGE_X_M * spec.observation_scale
    assert np.abs(formula).max() > 0.01
    assert np.abs(shift - formula).max() < (0.3 if name == "perspective" else 0.05) * np.abs(formula).max()


@pytest.mark.parametrize("slopes", [(0.2, -0.2), (0.28, 0.05), (-0.1, 0.25)])
def test_a_tilted_camera_is_the_catalogues_and_does_not_rotate(slopes: tuple[float, float]) -> None:
    """Foreshortened along the tilt, and not rotated: no other effect of the catalogue is in the picture.

    The camera was tilted by up to three degrees when it was calibrated, so the values are only about those of
    the tilt; with another tilt and a rotation the picture could not be described.
    """
    spec = spec_with({"name": "perspective", "slope_x": slopes[0], "slope_y": slopes[1]})
    played = [spec.play(run) for run in range(4)]
    plain = dataclasses.replace(spec, effects=())
    places = np.concatenate([camera.perfect(plain, one) for one in played])
    found = np.concatenate([camera.perfect(spec, one) for one in played])
    distance = camera.DISTANCE_M / EDGE_X_M * spec.observation_scale

    def missed(values: Array) -> Array:
        return np.asarray(through_a_tilted_camera(places, values) - found).ravel()

    best = least_squares(missed, [*slopes, distance])
    np.testing.assert_allclose(best.x, [*slopes, distance], atol=0.15 * np.abs([*slopes, distance]).max())
    assert np.abs(best.fun).max() < 0.08 * np.abs(found - places).max()


def through_a_tilted_camera(places: Array, values: Array) -> Array:
    """Return what the catalogue's `perspective` shows of places (n, 2) [board edges]."""
    slopes, square = values[:2], values[2] ** 2
    along = places @ slopes
    shorter = square / (1.0 + np.sqrt(1.0 - square * (slopes @ slopes))) * along[:, None] * slopes
    return np.asarray((places - shorter) / (1.0 + along)[:, None])


def test_board_that_yaws_turns_in_the_picture() -> None:
    spec = dataclasses.replace(spec_with(), out_of_catalogue={"name": "yaw", "from_x": 30.0, "from_y": -20.0})
    played = spec.play(0)
    plain = dataclasses.replace(spec, out_of_catalogue=None)
    shift = camera.perfect(spec, played) - camera.perfect(plain, played)
    formula = played.seen - played.places / EDGE_X_M * spec.observation_scale
    assert np.abs(formula).max() > 0.01
    assert np.abs(shift - formula).max() < 0.15 * np.abs(formula).max()


def test_every_sensing_physics_is_in_the_picture() -> None:
    """What overrides `see` acts on numbers: the camera has to know it by name."""
    known = {*SENSING, "yaw"}
    assert {
        one.name for one in (*EFFECTS, *BEYOND) if acts(one.draw(np.random.default_rng(1), 0.5), "see")
    } == known


@pytest.mark.slow
def test_tracker_sees_the_marble_to_a_third_of_a_millimetre() -> None:
    spec = spec_with({"name": "perspective", **SENSING["perspective"]})
    played = some(spec.play(0), 4)
    edges = (spec.observation_scale, spec.observation_scale * EDGE_Y_M / EDGE_X_M)
    seen = positions(
        camera.calibration(spec),
        camera.empty(spec),
        camera.pictures(spec, 0, played),
        edges,
        spec.observation_scale * RADIUS_M / EDGE_X_M,
    )
    missed_mm = (seen - camera.perfect(spec, played)) * EDGE_X_M * 1000
    assert np.abs(missed_mm).max() < 1.0
    assert 0.1 < np.std(missed_mm) < 0.33


def test_corners_of_the_calibration_are_those_of_the_board() -> None:
    spec = spec_with()
    found = find_corners(camera.calibration(spec))[[3, 2, 1, 0]]
    np.testing.assert_allclose(found, camera.mounted(spec).look(camera.CORNERS_M), atol=0.15)


def test_pictures_repeat_to_the_bit() -> None:
    spec = spec_with({"name": "lens_distortion", **SENSING["lens_distortion"]})
    played = some(spec.play(1), 40)
    for one, again in zip(camera.pictures(spec, 1, played), camera.pictures(spec, 1, played), strict=True):
        np.testing.assert_array_equal(one, again)
        assert one.shape == (camera.HEIGHT, camera.WIDTH, 3)


@pytest.mark.slow
def test_rig_through_the_camera_is_what_the_tracker_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a tracker that counts pictures instead of reading them: rendering all takes most of a minute."""
    monkeypatch.setattr(camera, "pictures", lambda spec, run, played: played.places)

    def watch(calibration, empty, pictures, edges, radius):
        assert calibration.shape == empty.shape
        assert radius == pytest.approx(1.04 * RADIUS_M / EDGE_X_M)
        return np.array(pictures) / EDGE_X_M * edges[0]

    spec = spec_with()
    recorded = record(spec, watch)
    label = recorded.label()
    assert label["through_camera"]
    assert label["noise"] == "tracker"
    assert label["truth"]["observation_scale"] == 1.04
    # A marble on a tilted board is not quite above where it would be on a level one.
    assert label["sigma"] < 2e-4
    with pytest.raises(ValueError, match="say what reads its pictures"):
        record(spec)


def test_unknown_tracker_is_an_answer() -> None:
    answers = io.StringIO()
    request = {"index": 1, "kind": "none", "folder": "nowhere", "seed": 1, "tracker": "irt.nothing:positions"}
    serve([json.dumps({"make": request})], answers)
    assert json.loads(answers.getvalue())["error"].startswith(
        "ValueError: no tracker 'irt.nothing:positions'"
    )
