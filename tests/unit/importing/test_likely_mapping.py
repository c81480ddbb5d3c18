"""Columns of many names and units are mapped to what they hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from irt.importing.likely_mapping import likely_mapping, suggested_command
from irt.importing.mapping import Expression
from irt.recording import CMD, MARBLE, STAMP, TILT
from irt.rig import Board

Array = NDArray[np.float64]

EDGE_M = Board().edge_x_m
#: Half of the short edge, as the suggestion rounds it [long edges].
HALF_Y = round(0.5 * Board().edge_y_m / EDGE_M, 3)
TIMES = {"t": 1.0, "timestamp_s": 1.0, "Time_ms": 1e3, "stamp_us": 1e6, "ros_time_ns": 1e9}
PLACES = {
    ("ball_x_mm", "ball_y_mm"): 1e3 * EDGE_M,
    ("BallX", "BallY"): EDGE_M,
    ("marble_pos_x_cm", "marble_pos_y_cm"): 1e2 * EDGE_M,
    ("xb", "yb"): EDGE_M,
    ("x", "y"): 1.0,
    ("Position_1", "Position_2"): 1e3 * EDGE_M,
}
TILTS = {
    ("alpha", "beta"): 1.0,
    ("Roll", "Pitch"): np.rad2deg(1.0),
    ("plate_x_mrad", "plate_y_mrad"): 1e3,
    ("tilt_1_deg", "tilt_2_deg"): np.rad2deg(1.0),
    ("theta_x_rad", "theta_y_rad"): 1.0,
}
COMMANDS = (
    ("u1", "u2"),
    ("a0", "a1"),
    ("set_roll", "set_pitch"),
    ("Servo_1", "Servo_2"),
    ("tilt_cmd_x", "tilt_cmd_y"),
)


def evaluated(mapping: dict[str, str], columns: dict[str, Array], targets: tuple[str, ...]) -> Array:
    rows = len(next(iter(columns.values())))
    known = {**columns, "edge_x_m": np.full(rows, EDGE_M)}
    return np.array([Expression.parse(mapping[name]).evaluate(known, rows, "log.csv") for name in targets])


@given(
    time=st.sampled_from(list(TIMES)),
    place=st.sampled_from(list(PLACES)),
    tilt=st.sampled_from(list(TILTS)),
    command=st.sampled_from(COMMANDS),
    from_corner=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_columns_hold_is_found_by_name_and_unit(
    *,
    time: str,
    place: tuple[str, str],
    tilt: tuple[str, str],
    command: tuple[str, str],
    from_corner: bool,
    seed: int,
) -> None:
    random = np.random.default_rng(seed)
    stamps = 1.7e9 + np.arange(200) / 50.0
    marble = random.uniform([-0.45, -HALF_Y + 0.05], [0.45, HALF_Y - 0.05], (200, 2))
    angles, sent = random.normal(0.0, 0.03, (200, 2)), random.normal(0.0, 5.0, (200, 2))
    origin = (0.5, HALF_Y) if from_corner else (0.0, 0.0)
    holding = {
        time: TIMES[time] * stamps,
        place[0]: PLACES[place] * (marble[:, 0] + origin[0]),
        place[1]: PLACES[place] * (marble[:, 1] + origin[1]),
        "ball_vel_x": random.normal(size=200),
        "ball_vel_y": random.normal(size=200),
        tilt[0]: TILTS[tilt] * angles[:, 0],
        tilt[1]: TILTS[tilt] * angles[:, 1],
        command[0]: sent[:, 0],
        command[1]: sent[:, 1],
    }
    columns = {name: holding[name] for name in random.permutation(list(holding)).tolist()}
    mapping = likely_mapping(columns)
    assert evaluated(mapping, columns, (STAMP,))[0] == pytest.approx(stamps, abs=1e-6)
    places, tilts = evaluated(mapping, columns, MARBLE).T, evaluated(mapping, columns, TILT).T
    assert places == pytest.approx(marble, abs=1e-9)
    assert tilts == pytest.approx(angles, abs=1e-9)
    assert [mapping[name] for name in CMD] == list(command)


def test_positions_in_pixels_are_not_scaled() -> None:
    columns = {
        "t": np.arange(3.0),
        "ball_x_px": np.array([3.0, 600.0, 40.0]),
        "ball_y_px": np.array([9.0, 1.0, 5.0]),
    }
    assert likely_mapping(columns) == {STAMP: "t"}
    assert suggested_command(Path("log.csv"), columns) is None


@given(
    st.dictionaries(
        st.from_regex(r"\A[A-Za-z_][A-Za-z0-9_]{0,15}\Z"),
        st.sampled_from([np.array([0.0, np.nan, 2.0]), np.full(3, np.nan)]),
    )
)
def test_any_names_are_mapped_or_left(columns: dict[str, Array]) -> None:
    for text in likely_mapping(columns).values():
        Expression.parse(text)
