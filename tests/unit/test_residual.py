from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.errors import IrtError
from irt.model import Effect, Model
from irt.recording import Recording
from irt.residual import evaluate, free_run_error, predict, windowed_error
from irt.rig import RANGES, Board, Marble, Rig, load_rig
from irt.segments import segments

VALUES = (0.07, 0.06, 0.0005, 24.0, 1.0)
OTHER = (0.05, 0.07, 0.0003, 24.0, 1.0)
MOVING = (0.02, -0.03, 0.1, -0.05)


def rig_of(*recordings: Recording, start="rest") -> Rig:
    return Rig(Path("rig"), Board(), Marble(), start, dict(RANGES), recordings)


def model(values=VALUES, start="rest", time_step="rounded") -> Model:
    return Model.from_rig(rig_of(start=start), values, time_step=time_step)


def record(knobs, state=(0.1, -0.05, 0.0, 0.0), stamps=None, *, lost=(), name="run", effects=()) -> Recording:
    """A recording that the engine made from planted values."""
    durations = None if stamps is None else np.append(np.diff(stamps), stamps[-1] - stamps[-2])
    start = {"start": state[:2], "start_velocity": state[2:]}
    marble = rollouts([VALUES], knobs, **start, durations=durations, effects=effects)[0]
    marble[list(lost)] = np.nan
    return Recording(name, Path(f"{name}.csv"), knobs, marble, stamps)


@pytest.fixture
def uneven() -> np.ndarray:
    """Stamps of 40 rows, about 0.1 s apart."""
    return np.cumsum(np.random.default_rng(5).uniform(0.08, 0.12, 40))


class TestSegments:
    def test_at_rest_each_recording_is_one(self, wave) -> None:
        one, two = record(wave, name="one"), record(wave[:20], lost=[3], name="two")
        found = segments(rig_of(one, two))
        assert [(part.recording, part.first_row, len(part.knobs)) for part in found] == [
            ("one", 0, 40),
            ("two", 0, 20),
        ]
        np.testing.assert_array_equal(found[0].knobs, one.knobs)
        np.testing.assert_array_equal(found[1].observed, two.marble)
        np.testing.assert_array_equal(found[1].start, two.marble[0])
        np.testing.assert_array_equal(found[1].start_velocity, [0.0, 0.0])
        assert found[0].durations is None

    def test_in_motion_they_are_windows(self, wave, uneven) -> None:
        run = record(wave, MOVING, uneven)
        found = segments(rig_of(run, start="moving"), seconds=1.0)
        assert [part.first_row for part in found] == [4, 14, 24, 34]
        for part in found:
            rows = slice(part.first_row, part.first_row + 10)
            np.testing.assert_array_equal(part.observed, run.marble[rows])
            np.testing.assert_array_equal(part.durations, run.durations[rows])

    def test_windows_last_two_and_a_half_seconds_by_default(self, wave, uneven) -> None:
        found = segments(rig_of(record(wave, MOVING, uneven), start="moving"))
        assert [len(part.knobs) for part in found] == [25, 11]

    def test_without_stamps_the_range_gives_the_time(self, wave) -> None:
        # The middle of the paper's range, 25 updates of 1/240 s, makes 1 s of 10 rows.
        found = segments(rig_of(record(wave, MOVING), start="moving"), seconds=1.04)
        assert [part.first_row for part in found] == [4, 14, 24, 34]

    def test_start_states_are_near_the_truth(self, wave, uneven) -> None:
        run = record(wave, MOVING, uneven)
        found = segments(rig_of(run, start="moving"), seconds=1.0)
        velocity = (run.marble[5] - run.marble[3]) / (uneven[5] - uneven[3])
        np.testing.assert_allclose(found[0].start, run.marble[4], atol=0.003)
        np.testing.assert_allclose(found[0].start_velocity, velocity, atol=0.03)
        for part in found:
            np.testing.assert_allclose(part.start, part.observed[0], atol=0.003)

    def test_a_window_may_begin_where_the_marble_is_lost(self, wave, uneven) -> None:
        run = record(wave, MOVING, uneven)
        gappy = record(wave, MOVING, uneven, lost=[14, 15])
        start = segments(rig_of(gappy, start="moving"), seconds=1.0)[1].start
        np.testing.assert_allclose(start, run.marble[14], atol=0.01)

    def test_windows_that_say_nothing_are_left_out(self, wave, uneven) -> None:
        lost = [*range(16, 23), *range(36, 40)]
        found = segments(rig_of(record(wave, MOVING, uneven, lost=lost), start="moving"), seconds=1.0)
        assert [part.first_row for part in found] == [4, 24]

    def test_rows_under_unknown_commands_are_left_out(self, wave) -> None:
        # Half a second, but no more than a tenth of the recording.
        for step_s, left_out in ((0.02, 4), (0.2, 2), (1.0, 1)):
            run = record(wave, MOVING, step_s * np.arange(40))
            (found,) = segments(rig_of(run, start="moving"), whole=True)
            assert (found.first_row, len(found.knobs)) == (left_out, 40 - left_out)
            (found,) = segments(rig_of(run), whole=True)
            assert (found.first_row, len(found.knobs)) == (0, 40)

    def test_a_rig_at_rest_can_be_cut_too(self, wave) -> None:
        found = segments(rig_of(record(wave)), seconds=1.0)
        np.testing.assert_array_equal(found[0].start_velocity, [0.0, 0.0])
        assert found[1].start_velocity.any()

    @pytest.mark.parametrize("seconds", [0.0, -1.0, np.nan, np.inf])
    def test_a_window_has_a_length(self, wave, seconds) -> None:
        with pytest.raises(IrtError, match="a window must be longer than 0 s"):
            segments(rig_of(record(wave)), seconds)


def test_predict_keeps_the_order_of_segments_of_many_kinds(wave, uneven) -> None:
    runs = [
        record(wave),
        record(wave[:20], MOVING),
        record(wave, stamps=uneven),
        record(wave, (0, 0.1, 0, 0)),
    ]
    parts = [segments(rig_of(run))[0] for run in runs]
    together = predict(model(OTHER), parts)
    for part, run, predicted in zip(parts, runs, together, strict=True):
        np.testing.assert_array_equal(predicted, predict(model(OTHER), [part])[0])
        expected = rollouts([OTHER], run.knobs, start=run.marble[0], durations=run.durations)[0]
        np.testing.assert_array_equal(predicted, expected)


class TestFreeRun:
    def test_the_truth_is_without_error(self, wave, uneven) -> None:
        assert free_run_error(model(), record(wave)) == 0.0
        assert free_run_error(model(), record(wave, stamps=uneven)) == 0.0

    def test_is_the_mean_over_rows_and_axes(self, wave) -> None:
        run = record(wave, lost=[7, 8])
        predicted = rollouts([OTHER], wave, start=run.marble[0])[0]
        difference = np.delete(predicted - run.marble, [7, 8], axis=0)
        result = evaluate(model(OTHER), [run])
        assert free_run_error(model(OTHER), run) == pytest.approx(np.abs(difference).mean())
        assert result.free_run.mae == free_run_error(model(OTHER), run)
        assert result.free_run.rmse == pytest.approx(np.sqrt((difference**2).mean()))
        assert result.free_run.max == np.abs(difference).max()
        assert (result.free_run.rows, result.free_run.lost) == (38, 2)
        np.testing.assert_array_equal(result.runs[0].free_prediction, predicted)

    def test_stamps_are_the_time_base(self, wave, uneven) -> None:
        wrong = (*VALUES[:3], 3.0, VALUES[4])
        assert free_run_error(model(wrong), record(wave, stamps=uneven)) == 0.0
        assert free_run_error(model(wrong), record(wave)) > 0.001

    def test_the_time_step_is_the_model_s(self, wave) -> None:
        run = record(wave)
        assert free_run_error(model((*VALUES[:3], 24.3, 1.0)), run) == 0.0
        assert free_run_error(model((*VALUES[:3], 24.3, 1.0), time_step="continuous"), run) > 1e-4

    def test_in_motion_the_first_rows_give_the_velocity(self, wave, uneven) -> None:
        for stamps in (None, uneven):
            run = record(wave, MOVING, stamps)
            assert free_run_error(model(start="moving"), run) < 1e-6
            assert free_run_error(model(start="rest"), run) > 0.01

    def test_in_motion_with_lost_rows_later_ones_give_it(self, wave) -> None:
        run = record(wave, MOVING, lost=[1, 2, 4])
        assert free_run_error(model(start="moving"), run) < 1e-6

    def test_in_motion_seen_only_once_it_is_taken_to_rest(self, wave) -> None:
        run = record(wave, MOVING, lost=range(1, 40))
        result = evaluate(model(start="moving"), [run])
        assert (result.free_run.rows, result.free_run.lost) == (1, 39)
        assert result.free_run.mae < 1e-6


class TestWindows:
    def test_follow_one_another(self, wave) -> None:
        result = evaluate(model(), [record(wave)], window_s=1.0)  # 10 rows of 24 updates
        run = result.runs[0]
        np.testing.assert_array_equal(run.window_rows, [4, 14, 24])
        predicted = ~np.isnan(run.windowed_prediction[:, 0])
        np.testing.assert_array_equal(np.flatnonzero(predicted), np.arange(4, 34))
        assert run.windowed is not None
        assert (run.windowed.rows, run.windowed.lost) == (30, 0)

    def test_the_truth_is_without_error(self, wave, uneven) -> None:
        for stamps in (None, uneven):
            errors = evaluate(model(), [record(wave, MOVING, stamps)], window_s=1.0).windowed
            assert errors is not None
            assert errors.max < 1e-5

    @pytest.mark.parametrize("stamped", [False, True])
    def test_effects_are_simulated_with_their_past(self, wave, uneven, stamped) -> None:
        slow = replace(model(), effects=(Effect("lag", {"time_constant_s": 0.5}),))
        stamps = uneven if stamped else None
        run = record(wave, stamps=stamps, effects=[{"name": "lag", "time_constant_s": 0.5}])
        errors = evaluate(slow, [run], window_s=1.0).windowed
        assert errors is not None
        assert errors.max < 1e-5

    def test_never_see_what_they_predict(self, wave) -> None:
        run = record(wave, MOVING)
        before = evaluate(model(OTHER), [run], window_s=1.0).runs[0].windowed_prediction
        marble = run.marble.copy()
        marble[14:] += 0.05
        changed = Recording("run", run.path, run.knobs, marble)
        after = evaluate(model(OTHER), [changed], window_s=1.0).runs[0].windowed_prediction
        np.testing.assert_array_equal(before[:24], after[:24])
        assert np.abs(before[24:34] - after[24:34]).max() > 0.04

    def test_begin_where_three_of_four_rows_were_seen(self, wave) -> None:
        lost = [2, 13, 16, 17]
        result = evaluate(model(), [record(wave, MOVING, lost=lost)], window_s=0.4)
        run = result.runs[0]
        # Of rows 16 to 19 two are lost: the window after them begins a row later, where one is.
        np.testing.assert_array_equal(run.window_rows, [4, 8, 12, 16, 21, 25, 29, 33])
        assert run.windowed is not None
        assert (run.windowed.rows, run.windowed.lost) == (29, 3)
        assert run.windowed.max < 1e-5

    @pytest.mark.parametrize(("rate_hz", "lead"), [(10, 4), (30, 4), (60, 8), (120, 16)])
    def test_of_a_faster_camera_begin_after_as_much_time_as_at_thirty_hertz(self, rate_hz, lead) -> None:
        stamps = np.arange(2 * rate_hz) / rate_hz
        knobs = 0.05 * np.stack([np.sin(3.0 * stamps), np.cos(2.0 * stamps)], axis=1)
        run = record(knobs, MOVING, stamps)
        (found,) = evaluate(model(), [run], window_s=1.0).runs
        np.testing.assert_array_equal(found.window_rows, [lead])
        assert found.windowed is not None
        assert found.windowed.rows == rate_hz
        assert found.windowed.max < 1e-5

    def test_of_a_faster_camera_err_less_by_its_noise(self) -> None:
        """The velocity at a window's start is no less certain for more rows a second."""
        errors = []
        for rate_hz in (30, 120):
            stamps = np.arange(8 * rate_hz) / rate_hz
            knobs = 0.02 * np.stack([np.sin(3.0 * stamps), np.cos(2.0 * stamps)], axis=1)
            run = record(knobs, stamps=stamps)
            marble = run.marble + np.random.default_rng(3).normal(0.0, 1e-3, run.marble.shape)
            noisy = Recording("run", run.path, knobs, marble, stamps)
            errors.append(windowed_error(model(), noisy, 1.0))
        assert errors[1] < errors[0]

    def test_too_long_for_a_recording(self, wave) -> None:
        short, long = record(wave[:12], name="short"), record(wave, name="long")
        result = evaluate(model(), [short, long], window_s=1.0)
        assert result.runs[0].windowed is None
        assert np.isnan(result.runs[0].windowed_prediction).all()
        assert result.windowed == result.runs[1].windowed
        with pytest.raises(IrtError, match="short: no window of 1 s fits; choose a shorter one"):
            windowed_error(model(), short, 1.0)
        assert windowed_error(model(), short, 0.5) < 1e-6

    def test_no_time_passes_no_window(self, wave) -> None:
        still = (*VALUES[:3], 0.2, 1.0)
        assert evaluate(model(still), [record(wave)]).windowed is None

    def test_a_longer_window_is_harder(self, wave) -> None:
        run = record(wave, MOVING)
        errors = [windowed_error(model(OTHER), run, seconds) for seconds in (0.5, 1.0, 3.0)]
        assert errors == sorted(errors)
        assert errors[0] < 0.5 * errors[2]


def test_all_runs_together_are_pooled_by_rows(wave) -> None:
    runs = [record(wave, name="a"), record(wave[:20], MOVING, name="b")]
    result = evaluate(model(OTHER), runs, window_s=1.0)
    a, b = result.runs
    assert [run.recording for run in result.runs] == ["a", "b"]
    assert result.free_run.mae == pytest.approx((40 * a.free_run.mae + 20 * b.free_run.mae) / 60)
    assert result.free_run.max == max(a.free_run.max, b.free_run.max)
    assert result.windowed is not None
    assert a.windowed is not None
    assert b.windowed is not None
    assert result.windowed.rows == a.windowed.rows + b.windowed.rows == 40
    assert result.windowed.mae == pytest.approx((30 * a.windowed.mae + 10 * b.windowed.mae) / 40)


def test_as_dict_is_json(wave) -> None:
    result = evaluate(model(OTHER), [record(wave[:8], name="a"), record(wave, name="b")], window_s=1.0)
    read = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert read["unit"] == "board edges"
    # Without stamps: rows of 24 updates, ten of which are a second of simulated time.
    assert (read["window_s"], read["window_rows"]) == (None, 10)
    assert [run["recording"] for run in read["runs"]] == ["a", "b"]
    assert read["runs"][0]["windowed"] is None
    assert read["overall"]["free_run"]["mae"] == result.free_run.mae
    assert set(read["overall"]["windowed"]) == {"mae", "rmse", "max", "rows", "lost"}


def test_nothing_to_evaluate() -> None:
    with pytest.raises(IrtError, match="recordings: expected at least one"):
        evaluate(model(), [])


def test_ball_table_by_the_figures_beside_it(shared: Path) -> None:
    """A plain regression's gears, judged on 2 s windows of runs 5 and 6, come near the README's quick fit."""
    rig = load_rig(shared / "real" / "ball-table")
    # 5.4 and 5.9 m/s^2 per rad over 5/7 g; the README's quick fit reached 0.048.
    fitted = Model.from_rig(rig, [5.4 / 7.007, 5.9 / 7.007, 0.001, 48.0, 1.0])
    result = evaluate(fitted, rig.recordings[4:], window_s=2.0)
    assert result.windowed is not None
    assert result.windowed.mae == pytest.approx(0.048, abs=0.004)
    assert result.free_run.mae > 3 * result.windowed.mae


class TestLean:
    """Each run has a lean of its own, which the model knows the size of."""

    LEANS = (0.002, -0.0015, 0.0025)

    def runs(self) -> list[Recording]:
        rng = np.random.default_rng(3)
        found = []
        for number, lean in enumerate(self.LEANS):
            knobs = np.repeat(rng.normal(0.0, 0.05, (20, 2)), 5, axis=0)
            effects = [{"name": "lean", "lean_x_rad": lean, "lean_y_rad": -0.5 * lean}]
            stamps = 0.05 * np.arange(len(knobs))
            run = record(knobs, stamps=stamps, effects=effects, name=f"run-{number}")
            noise = rng.normal(0.0, 2e-4, run.marble.shape)
            found.append(replace(run, marble=run.marble + noise))
        return found

    @staticmethod
    def leaning(size: float) -> Model:
        return replace(model(start="moving"), effects=(Effect("lean", {"size_rad": size}),))

    def test_later_windows_are_predicted_with_what_earlier_ones_show(self) -> None:
        runs = self.runs()
        blind, aware = (evaluate(self.leaning(size), runs, window_s=1.0) for size in (0.0, 0.002))
        assert aware.windowed.mae < 0.6 * blind.windowed.mae
        for before, after in zip(blind.runs, aware.runs, strict=True):
            first = slice(after.window_rows[0], after.window_rows[1])
            np.testing.assert_array_equal(before.windowed_prediction[first], after.windowed_prediction[first])

    def test_rows_to_come_are_not_looked_at(self) -> None:
        (run, *_) = self.runs()
        changed = run.marble.copy()
        changed[60:] += 0.05
        before, after = (
            evaluate(self.leaning(0.002), [one], window_s=1.0).runs[0].windowed_prediction
            for one in (run, replace(run, marble=changed))
        )
        np.testing.assert_array_equal(before[:56], after[:56])
