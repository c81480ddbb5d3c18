"""Facts of runs, planted and recovered."""

from dataclasses import replace

import numpy as np
import pytest

from irt.checking import check
from irt.checking.advice import next_recording
from simulated_rigs import STEP_S
from tilted_rigs import rig_of, tilted_recordings


def first_run(rig, **arrays):
    """Return the facts of the first run of a rig with other arrays."""
    run = replace(rig.recordings[0], **arrays)
    return check(replace(rig, recordings=(run, *rig.recordings[1:]))).runs[0]


def test_rate_jitter_and_pauses_come_back(make_rig):
    rig = make_rig(rows=300)
    random = np.random.default_rng(5)
    steps = STEP_S * (1.0 + 0.05 * random.standard_normal(299))
    steps[[50, 200]] = 5.0 * STEP_S
    facts = first_run(rig, stamps=np.concatenate([[0.0], np.cumsum(steps)]))
    assert facts.rate_hz == pytest.approx(1.0 / STEP_S, rel=0.02)
    assert facts.jitter_s == pytest.approx(0.05 * STEP_S, rel=0.15)
    assert facts.pauses == 2
    assert facts.seconds == pytest.approx(steps.sum())


def test_gaps_come_back(make_rig):
    rig = make_rig()
    marble = rig.recordings[0].marble.copy()
    marble[20:32] = np.nan
    marble[60] = np.nan
    facts = first_run(rig, marble=marble)
    assert (facts.lost, facts.longest_gap) == (pytest.approx(13 / 120), 12)


def test_clipped_commands_come_back_and_steps_are_none(make_rig):
    rig = make_rig(runs=1)
    knobs = np.clip(rig.recordings[0].knobs, -0.04, 0.04)
    facts = first_run(rig, knobs=knobs)
    share = np.mean(np.abs(knobs) == 0.04, axis=0)
    assert facts.clipped == pytest.approx(tuple(share), abs=0.05)
    assert first_run(rig, knobs=0.05 * np.sign(knobs)).clipped == (0.0, 0.0)


def test_a_run_of_steps_is_not_clipped_beside_others(make_rig):
    """`irt drive` makes such runs: their commands stay at what is the extreme of all runs."""
    rig = make_rig(runs=2)
    assert first_run(rig, knobs=0.2 * np.sign(rig.recordings[0].knobs)).clipped == (0.0, 0.0)


def test_rest_and_rim_shares_come_back(make_rig):
    rig = make_rig(runs=1)
    random = np.random.default_rng(6)
    rests = np.vstack([rig.recordings[0].marble[:60], rig.recordings[0].marble[59] + np.zeros((60, 2))])
    rests[60:] += 0.001 * random.standard_normal((60, 2))
    assert first_run(rig, marble=rests).at_rest == pytest.approx(0.5, abs=0.15)
    rim = np.clip(3.0 * rig.recordings[0].marble, [-0.475, -0.394], [0.475, 0.394])
    share = np.mean((np.abs(rim) >= [0.475, 0.394]).any(axis=1))
    assert share > 0.2
    assert first_run(rig, marble=rim).at_rim == pytest.approx(share, abs=0.1)


def test_repeated_commands_are_noted(make_rig):
    rig = make_rig(runs=2)
    twice = replace(rig.recordings[1], knobs=rig.recordings[0].knobs)
    found = check(replace(rig, recordings=(rig.recordings[0], twice)))
    assert (found.runs[0].repeats, found.runs[1].repeats) == (None, "run-1")


@pytest.mark.parametrize(
    ("runs", "said"),
    [(1, "Record 2 more runs"), (2, "Record 1 more run with"), (3, "tune and diagnose these")],
)
def test_runs_are_asked_for_until_some_can_be_held_out(make_rig, runs, said):
    rig = make_rig(runs=runs)
    assert said in next_recording(rig, check(rig).runs, (), None)


@pytest.mark.parametrize(("steps_rad", "is_held"), [(0.03, True), (0.002, False)])
def test_a_marble_that_a_tilt_does_not_move_lies_in_a_hole(steps_rad, is_held):
    """A friction within its range may hold it at small tilts."""
    still, *others = tilted_recordings(runs=3)
    share = steps_rad / 0.03
    held = replace(
        still,
        marble=0.1 + 5e-4 * np.random.default_rng(1).standard_normal(still.marble.shape),
        knobs=share * still.knobs,
        tilt=share * still.tilt,
    )
    found = check(rig_of([held, *others])).findings
    said = [one for one in found if "the marble rests in most rows" in one.what]
    assert [(one.where, one.severity) for one in said] == [("run-1", "note")]
    assert ("leave its marble cells empty" in said[0].advice) is is_held
