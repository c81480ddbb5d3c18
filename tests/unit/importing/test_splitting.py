"""Runs end where measurements do; what was cleaned away is counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from irt.errors import IrtError
from irt.importing.log import Log
from irt.importing.splitting import Cleaned, clean

RATE = 50.0


def log(rows: int = 1000, seed: int = 0) -> Log:
    rng = np.random.default_rng(seed)
    stamps = np.arange(rows) / RATE
    marble = np.column_stack([0.3 * np.sin(stamps), 0.2 * np.cos(1.3 * stamps)])
    marble += 0.002 * rng.standard_normal(marble.shape)
    tilt = 0.03 * np.column_stack([np.sin(1.3 * stamps), np.cos(stamps)])
    return Log(
        name="log",
        path=Path("log.csv"),
        stamps=stamps,
        marble=marble,
        tilt=tilt + 0.001 * rng.standard_normal(tilt.shape),
        command_stamps=stamps.copy(),
        commands=rng.standard_normal((rows, 2)),
        episodes=np.zeros(rows),
    )


def spans(cleaned: Cleaned) -> list[tuple[int, int]]:
    return [(run.first, run.end) for run in cleaned.runs]


def test_a_whole_log_is_one_run() -> None:
    assert spans(clean(log())) == [(0, 1000)]


def test_held_places_jumps_and_lost_rows_become_gaps_inside_a_run() -> None:
    one = log()
    assert one.tilt is not None
    one.marble[100:110] = one.marble[99]
    one.marble[200:205] = np.nan
    one.tilt[300:308] += 0.15
    cleaned = clean(one)
    assert spans(cleaned) == [(0, 1000)]
    assert (cleaned.counts.held, cleaned.counts.lost, cleaned.counts.jumps) == (10, 5, 8)
    assert np.isnan(cleaned.log.marble[100:110]).all()
    assert cleaned.log.tilt is not None
    assert np.isnan(cleaned.log.tilt[300:308]).all()


def test_garbage_at_the_start_is_dropped() -> None:
    one = log()
    assert one.tilt is not None
    one.marble[:4], one.tilt[:4] = 0.0, 0.0
    cleaned = clean(one)
    assert cleaned.counts.garbage == 4
    assert len(cleaned.log.stamps) == 996


def test_runs_are_split_at_gaps_episodes_losses_and_a_marble_put_elsewhere() -> None:
    one = log()
    one.stamps[200:] += 1.0
    one.episodes[400:] = 1.0
    one.marble[600:660] = np.nan
    one.marble[800:, 0] -= 0.4
    cleaned = clean(one)
    assert spans(cleaned) == [(0, 200), (200, 400), (400, 600), (660, 800), (800, 1000)]
    counts = cleaned.counts
    assert (counts.gaps, counts.episodes, counts.losses, counts.short_runs) == (1, 2, 1, 0)


def test_short_runs_are_dropped_and_counted() -> None:
    one = log()
    one.episodes[:20] = 1.0
    cleaned = clean(one)
    assert spans(cleaned) == [(20, 1000)]
    assert (cleaned.counts.short_runs, cleaned.counts.short_rows) == (1, 20)


def test_rows_before_the_first_command_are_dropped() -> None:
    one = log()
    one.commands[:150] = np.nan
    cleaned = clean(one)
    assert spans(cleaned) == [(150, 1000)]
    assert cleaned.counts.before_commands == 150


def test_commands_of_another_time() -> None:
    one = log()
    one.command_stamps[:] += 1e6
    with pytest.raises(IrtError, match="commands and states do not overlap in time: commands from 1000000"):
        clean(one)
    one.command_stamps[:] -= 2e6
    with pytest.raises(IrtError, match="do not overlap in time"):
        clean(one)


def test_a_log_of_tilt_alone_is_kept_whole() -> None:
    one = log()
    one.marble[:] = np.nan
    assert spans(clean(one)) == [(0, 1000)]
