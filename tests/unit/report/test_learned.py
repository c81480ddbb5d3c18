"""A learned correction as the page and the terminal show it."""

import re

import numpy as np
import pytest
from matplotlib.contour import QuadContourSet

from irt.catalogue import effect
from irt.diagnosis.basis import SHAPES
from irt.diagnosis.result import UNLISTED, NamedEffect
from irt.engine import SUBSTEP_S, rollouts
from irt.model import Parameter
from irt.report.learned import described, learned_terms, terms_table
from irt.report.learned_plots import learned_pictures

#: Without friction, one row every 4 updates, seen as it is.
LEVEL = np.array([0.05, 0.05, 0.0, 4.0, 1.0])


def correction(**changes):
    """A correction with these parameters, a value or a value with its interval; all others neutral."""
    parameters = {one.name: Parameter(one.neutral) for one in effect(UNLISTED).parameters}
    for name, value in changes.items():
        parameters[name] = Parameter(*value) if isinstance(value, tuple) else Parameter(value)
    return NamedEffect(UNLISTED, "field", parameters, effect(UNLISTED).units, 0.02, 0.01)


def wave(**changes):
    vector = {"wave_2_x_per_m": (100.0, 99.0, 101.0), "phase_2_rad": 0.7}
    return correction(push_2_x_m_per_s2=(0.02, 0.019, 0.021), **vector, **changes)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("place", [(0.1, -0.05), (-0.2, 0.12)])
def test_a_profile_pushes_as_the_engine_does(labyrinth, shape, place):
    one = correction(
        shape_3=float(SHAPES.index(shape)),
        push_3_x_m_per_s2=0.02,
        push_3_y_m_per_s2=-0.03,
        wave_3_x_per_m=9.0,
        wave_3_y_per_m=-4.0,
        phase_3_rad=0.3,
        across_3_rad=-0.2,
    )
    values = {name: parameter.value for name, parameter in one.parameters.items()}
    (path,) = rollouts(
        LEVEL[None], np.zeros((4, 2)), effects=[{"name": UNLISTED, **values}], rig=labyrinth, start=place
    )
    edge = labyrinth.board.edge_x_m
    # Of n updates, each of which moves the marble by the velocity after it.
    updates = 3 * LEVEL[3]
    measured = 2.0 * edge * (path[-1] - path[0]) / (updates * (updates + 1.0) * SUBSTEP_S**2)
    (term,) = learned_terms(one.parameters)
    profile = term.at(edge * np.array([place]))[0]
    pushed = [profile * value.value for value in term.amplitudes.values()]
    np.testing.assert_allclose(measured, pushed, rtol=0.01, atol=1e-6)


def test_a_wave_has_its_wavelength_with_the_interval_and_idle_terms_are_left_out():
    ((row,),) = [terms_table(wave(shape_1=3.0, wave_1_x_per_m=5.0), None).rows]
    shape, over, size, direction, amplitude = row
    assert (shape, over, direction) == ("wave", "position", "0°")
    assert size == "62.8  (62.2 to 63.5) mm"
    assert amplitude == "push along x 20.0  (19.0 to 21.0) mm/s²"


def test_polynomials_have_no_width_and_slanted_waves_no_interval():
    lines = list(described(correction(shape_1=5.0, push_1_y_m_per_s2=0.5, rate_1_per_s=2.0), None))
    assert lines == ["line over time since row 0: push along y 500 mm/s²"]
    (line,) = described(wave(wave_2_y_per_m=100.0), None)
    assert "wavelength 44.43 mm, direction 45°" in line


def test_laws_of_the_speed_and_the_mode_are_described():
    one = correction(drag_strength=0.3, drag_power=0.0, mode_gain=0.5)
    lines = list(described(one, None))
    assert "drag against the motion 300 mm/s² at 0.1 m/s, power 0" in lines[0]
    assert "0.628\N{NO-BREAK SPACE}s" in lines[1]


def test_a_drive_that_yields_is_described_by_its_lag_and_what_it_loses():
    one = correction(
        yield_lag_s=(0.2, 0.1, 0.3),
        yield_x=(0.9, 0.8, 1.0),
        yield_x_s_per_rad=-500.0,
        yield_y_s_per_rad=300.0,
    )
    assert list(described(one, None)) == [
        "drive that yields over tilt and its rate: lag 0.20 (0.10 to 0.30) s, "
        "loses 90 (80 to 100) % about x at rates far above 2\N{NO-BREAK SPACE}mrad/s"
    ]
    (line,) = described(one, 0.1)
    assert "lag 2 rows" in line
    assert "above 0.2\N{NO-BREAK SPACE}mrad/row" in line


def test_a_picture_is_described_by_its_rates():
    one = correction(picture_turn_x=(10.0, 9.0, 11.0), picture_turn_y=0.01, picture_growth_y_per_rad=-2.0)
    assert list(described(one, None)) == [
        "picture over tilt: angle 0.57 (0.52 to 0.63) °/mrad about x",
        "picture over tilt: growth -0.2 %/mrad about y",
    ]


def test_forces_at_the_rim_are_described():
    one = correction(rim_hold_m_per_s2=(0.2, 0.1, 0.3), rim_drag_per_s=3.0)
    (line,) = described(one, None)
    assert line == "rim over contact with the rim: holds back 200 (100 to 300) mm/s², drag 3 1/s"
    assert list(described(one, 0.1)) == [
        "rim over contact with the rim: holds back 2 mm/row², drag 0.3 1/row"
    ]


def test_without_stamps_nothing_is_in_seconds():
    one = correction(push_1_x_m_per_s2=(0.02, 0.01, 0.05), rate_1_per_s=2.0, drag_strength=0.3, mode_gain=0.5)
    lines = "\n".join(described(one, 0.1))
    assert "push along x 0.2 mm/row²" in lines
    assert "wavelength 31.42 rows" in lines
    assert "at 10 mm/row" in lines
    assert "/s" not in lines
    assert not re.search(r" s\b", lines)


def test_each_part_is_drawn_over_what_it_depends_on(tmp_path, labyrinth, diagnosis_of, drawn):
    one = wave(shape_1=1.0, push_1_x_m_per_s2=0.01, rate_1_per_s=3.0, drag_strength=0.1)
    pictures = learned_pictures(tmp_path, one, labyrinth, diagnosis_of("unlisted"), 0.1, stamped=False)
    assert [picture.path.stem for picture in pictures] == [
        "learned-time-push-x",
        "learned-position-push-x",
        "learned-drag",
    ]
    assert all(picture.path.is_file() for picture in pictures)
    assert "[mm/row²]" in pictures[1].caption


def test_a_map_has_the_sign_of_the_push(tmp_path, labyrinth, diagnosis_of, drawn):
    one = correction(shape_1=1.0, push_1_x_m_per_s2=0.02, wave_1_x_per_m=50.0)
    learned_pictures(tmp_path, one, labyrinth, diagnosis_of("unlisted"), 0.1, stamped=True)
    (filled,) = drawn.figure.axes[0].findobj(QuadContourSet)
    np.testing.assert_allclose(filled.levels, np.linspace(-20.0, 20.0, 10), rtol=1e-4)
    right = filled.get_paths()[-1]  # of the most positive level
    assert right.vertices[:, 0].min() > 0.0


@pytest.mark.parametrize("unit", ["mrad/s", "mrad/row"])
def test_what_a_drive_keeps_is_drawn_over_its_rate(tmp_path, labyrinth, diagnosis_of, drawn, unit):
    one = correction(yield_lag_s=0.2, yield_x=0.9, yield_x_s_per_rad=500.0)
    stamped = unit == "mrad/s"
    (picture,) = learned_pictures(tmp_path, one, labyrinth, diagnosis_of("unlisted"), 0.1, stamped=stamped)
    assert picture.path.stem == "learned-drive"
    (axes,) = drawn.figure.axes
    assert f"[{unit}]" in axes.get_xlabel()
    x, y = (line.get_ydata() for line in axes.get_lines())
    assert x[0] == pytest.approx(100.0)
    assert x.min() == pytest.approx(10.0, abs=1.0)
    assert y == pytest.approx(100.0)
