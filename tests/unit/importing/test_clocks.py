from __future__ import annotations

import numpy as np
import pytest

from irt.importing.clocks import clock_offset, steady_offset


def test_messages_are_only_ever_late() -> None:
    rng = np.random.default_rng(0)
    sent = np.arange(3000) / 60.0
    received = sent + 0.25 + rng.exponential(0.004, sent.size) + (rng.random(sent.size) < 0.05) * 0.1
    offset, error = clock_offset(sent, received)
    assert offset == pytest.approx(0.25, abs=0.001)
    assert error < 0.001


def test_clocks_read_at_one_moment() -> None:
    rng = np.random.default_rng(0)
    first = np.arange(500) / 30.0
    second = first - 2.0 + rng.normal(0.0, 0.001, first.size)
    second[::50] += 1.0
    offset, error = steady_offset(first, second)
    assert abs(offset + 2.0) < 4.0 * error < 0.001
