"""Errors of the corners that a tracker finds: the picture's scale, and values that depend on it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.engine import SUBSTEP_S, rollouts
from irt.fitting.least_squares import least_squares
from irt.fitting.picture_error import scale_error, with_scale_error
from irt.model import Parameter
from irt.recording import Recording
from irt.rig import RANGES, Board, Marble, Rig

TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])
NOISE = 0.001
RIG = SimpleNamespace(board=Board(edge_x_m=0.3, edge_y_m=0.198997), marble=Marble())


def test_the_scale_is_as_uncertain_as_that_of_the_best_similarity_to_four_corners():
    corners = 0.5 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (1.0, 0.198997 / 0.3)
    found = corners + NOISE * np.random.default_rng(1).standard_normal((4000, 4, 2))
    # Of a similarity, a turned and stretched copy, the scale is the real part of a complex factor.
    place, seen_at = (each[..., 0] + 1j * each[..., 1] for each in (corners, found))
    factors = (place.conj() * seen_at).sum(axis=-1) / (place.conj() * place).sum()
    assert scale_error(RIG, NOISE) == pytest.approx(np.std(factors.real), rel=0.05)


values = st.floats(-2.0, 2.0).filter(bool)


@given(values, st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 0.2))
def test_an_interval_grows_by_the_error_and_keeps_its_sign(value, below, above, noise):
    one = Parameter(value, value - below, value + above)
    given_names = {"gear_x": one, "time_scale": one, "gear_y": Parameter(value)}
    found = with_scale_error(given_names, RIG, noise)
    assert found["time_scale"] == one
    assert found["gear_y"] == Parameter(value)
    wide = found["gear_x"]
    assert wide.low <= max(one.low, 0.0 if one.low >= 0.0 else one.low) <= wide.high
    assert wide.low <= one.low
    assert wide.high >= one.high
    assert (wide.low >= 0.0) == (one.low >= 0.0)
    assert (wide.high <= 0.0) == (one.high <= 0.0)
    if one.low < 0.0 < one.high:
        half = 1.959964 * scale_error(RIG, noise) * abs(value)
        assert wide.high - value == pytest.approx(np.hypot(above, half), rel=1e-6, abs=1e-12)


def test_tuned_intervals_hold_the_truth_where_the_corners_were_found_too_far_out():
    """Pictures larger by 1.5 standard deviations of the error, and a rim that shows it."""
    larger = 1.0 + 1.5 * scale_error(RIG, NOISE)
    recordings = []
    for run in range(6):
        phase = np.arange(60)[:, None] * [0.11, 0.17] + run
        knobs = 0.5 * np.sin(phase)
        (marble,) = rollouts([TRUTH], knobs, start=[0.1, -0.1])
        marble = larger * marble + NOISE * np.random.default_rng(run).standard_normal(marble.shape)
        stamps = TRUTH[3] * SUBSTEP_S * np.arange(len(knobs))
        recordings.append(Recording(f"run-{run}", Path(f"run-{run}.csv"), knobs, marble, stamps))
    rig = Rig(Path("rig"), Board(), Marble(), "rest", dict(RANGES), tuple(recordings))
    found = least_squares(rig, starts=2).model.parameters["observation_scale"]
    assert found.value == pytest.approx(larger * TRUTH[4], rel=0.3 * (larger - 1.0))
    assert found.low < TRUTH[4] < found.high
