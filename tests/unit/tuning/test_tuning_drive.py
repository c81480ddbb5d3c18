from dataclasses import replace

import numpy as np
import pytest

from irt.engine import paper_drive, rollouts
from irt.rig import PARAMETERS, RANGES, load_rig
from irt.tuning import drive as drive_module
from irt.tuning.cache import need
from irt.tuning.drive import Drive, Run, is_paper_drive

SOME = np.array([[0.04, 0.06, 3e-4, 16.0, 1.05], [0.08, 0.02, 8e-4, 31.0, 0.9]])


def test_runs_of_any_length_are_simulated_as_one_by_one(small_drive):
    observed = small_drive.simulate(SOME)
    for run, found in zip(small_drive.runs, observed, strict=True):
        np.testing.assert_array_equal(found, rollouts(SOME, run.knobs, start=run.start))


def test_start_velocity_is_a_way_from_row_to_row(wave):
    """Without stamps or friction a marble on a level board rolls the same way a row at any time scale."""
    run = Run(0 * wave, None, np.zeros(2), np.array([0.06, 0.0]))
    rig = Drive.paper()
    moving = replace(rig, runs=(run,), start="moving")
    parameters = np.array([[0.0, 0.0, 0.0, 25.0, 1.0], [0.0, 0.0, 0.0, 10.0, 1.0]])
    middle, shorter = moving.simulate(parameters)[0]
    np.testing.assert_allclose(middle, shorter, atol=1e-12)
    assert middle[1, 0] == pytest.approx(0.06 * 25 / 240)


def test_stamps_determine_the_time_scale(stamped_drive):
    scaled = np.array([[0.5, 0.5, 0.5, 0.9, 0.5]])
    parameters = stamped_drive.parameters(scaled)
    assert parameters[0, 3] == 12.0
    assert stamped_drive.open.tolist() == [True, True, True, False, True]
    other = parameters.copy()
    other[0, 3] = 40.0
    np.testing.assert_array_equal(stamped_drive.simulate(parameters)[0], stamped_drive.simulate(other)[0])


def test_parameters_go_from_end_to_end_of_the_ranges(small_drive):
    ends = small_drive.parameters(np.array([np.zeros(5), np.ones(5)]))
    np.testing.assert_array_equal(ends.T, [RANGES[name] for name in PARAMETERS])


def test_a_range_of_one_value_is_not_open(small_drive):
    fixed = replace(small_drive, ranges={**RANGES, "rolling_friction": (2e-4, 2e-4)})
    assert not fixed.open[2]
    assert fixed.parameters(np.full((1, 5), 0.7))[0, 2] == 2e-4


def test_inputs_are_means_of_rows(small_drive):
    observed = small_drive.simulate(SOME)
    inputs = small_drive.inputs(observed)
    assert inputs.shape == (2, small_drive.input_count) == (2, 2 * (8 + 5))
    np.testing.assert_allclose(inputs[:, :2], observed[0][:, :5].mean(axis=1))
    np.testing.assert_allclose(inputs[:, -2:], observed[1][:, 20:25].mean(axis=1))


def test_rows_left_over_make_an_input_of_their_own(small_drive):
    by_three = replace(small_drive, rows_per_input=3)
    observed = by_three.simulate(SOME)
    inputs = by_three.inputs(observed)
    assert inputs.shape == (2, by_three.input_count) == (2, 2 * (14 + 9))
    np.testing.assert_allclose(inputs[:, 26:28], observed[0][:, 39])


def test_the_papers_network_sees_every_sample():
    drive = Drive.paper()
    observed = drive.simulate(SOME)
    np.testing.assert_array_equal(drive.inputs(observed), observed[0].reshape(2, 200))
    np.testing.assert_array_equal(drive.runs[0].knobs, paper_drive())


def test_a_wrong_start_state_is_taken_out_where_marbles_move(stamped_drive):
    observed = stamped_drive.simulate(SOME)
    line = np.array([0.02, -0.01]) + np.arange(40)[:, None] * np.array([1e-3, -2e-3])
    np.testing.assert_allclose(
        stamped_drive.inputs([observed[0] + line]), stamped_drive.inputs(observed), atol=1e-12
    )
    at_rest = replace(stamped_drive, start="rest")
    assert np.abs(at_rest.inputs([observed[0] + line]) - at_rest.inputs(observed)).max() > 0.01


@pytest.mark.parametrize(
    "change",
    [
        {"engine": "rapier"},
        {"start": "moving"},
        {"rows_per_input": 4},
        {"time_scale": 12.0},
        {"ranges": {**RANGES, "gear_x": (0.0, 0.2)}},
    ],
    ids=lambda change: next(iter(change)),
)
def test_each_change_of_a_drive_changes_its_digest(small_drive, change):
    assert replace(small_drive, **change).digest != small_drive.digest


def test_every_run_counts_in_the_digest(small_drive):
    first, second = small_drive.runs
    for runs in (
        (second, first),
        (first,),
        (first, replace(second, knobs=second.knobs + 1e-6)),
        (first, replace(second, start=second.start + 1e-6)),
        (first, replace(second, start_velocity=second.start_velocity + 1e-6)),
        (first, replace(second, durations=np.full(25, 0.05))),
    ):
        assert replace(small_drive, runs=runs).digest != small_drive.digest


def test_the_last_bits_of_a_sine_do_not_make_another_drive(small_drive):
    first, second = small_drive.runs
    nudged = replace(first, knobs=np.nextafter(first.knobs, 1.0))
    assert replace(small_drive, runs=(nudged, second)).digest == small_drive.digest


def seen(rows: int = 100, knobs: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    knobs = paper_drive(rows) if knobs is None else knobs
    return np.round(knobs, 6), rollouts(SOME[:1], knobs)[0] + 0.001


@pytest.mark.parametrize(
    ("recording", "toml", "expected"),
    [
        (seen(), None, True),
        (seen(), "[marble]\ndamping_per_s = 0.04\n", True),
        (seen(), "[marble]\ndamping_per_s = 0.5\n", False),
        (seen(), "[board]\nwall_restitution = 0.5\n", False),
        (seen(), '[recordings]\nstart = "moving"\n', False),
        (seen(), "[parameters]\ngear_x = { range = [0.0, 0.2] }\n", False),
        (seen(99, paper_drive(100)[:99]), None, False),
        (seen(knobs=paper_drive(100, 0.12)), None, False),
        (seen(knobs=paper_drive(literal=True)), None, False),
        ((*seen(), np.arange(100) / 10), None, False),
        ((seen()[0], seen()[1] + 0.1), None, False),
    ],
)
def test_the_papers_drive_is_known_when_seen(write_rig, recording, toml, expected):
    rig = load_rig(write_rig({"run": recording}, toml))
    assert is_paper_drive(rig) is expected
    assert need(rig).joint is not (expected or is_paper_drive(rig, literal=True))


def test_one_other_recording_makes_another_drive(write_rig):
    rig = load_rig(write_rig({"a": seen(), "b": seen(knobs=paper_drive(100, 0.12))}))
    assert not is_paper_drive(rig)
    assert len(need(rig).network_drive.runs) == 2


def test_the_literal_drive_has_a_network_of_its_own(write_rig):
    rig = load_rig(write_rig({"run": seen(knobs=paper_drive(literal=True))}))
    assert need(rig).network_drive.digest == Drive.paper(literal=True).digest


def test_long_recordings_are_thinned(write_rig):
    knobs = np.tile(paper_drive(), (20, 1))
    drive = need(load_rig(write_rig({"run": seen(knobs=knobs)}))).network_drive
    assert drive.rows_per_input == 10
    assert drive.input_count == drive_module.INPUTS


def test_thinning_leaves_enough_of_short_runs(write_rig):
    knobs, marble = seen(6, paper_drive()[:6])
    drive = need(load_rig(write_rig({f"run-{i}": (knobs, marble) for i in range(100)}))).network_drive
    assert drive.rows_per_input == 2
