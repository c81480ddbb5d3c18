from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Polygon, Rectangle
from matplotlib.text import Text

from irt.fitting.robust import mean_absolute
from irt.model import Model
from irt.recording import Recording
from irt.report import plots, style
from irt.residual import Errors, Evaluation, RunEvaluation


def texts(figure):
    return [text.get_text() for text in figure.findobj(Text)]


def lost_rows(recording):
    return np.flatnonzero(~recording.seen).tolist()


def lines(axes, colour):
    """The (x, y) data of the lines of one colour."""
    return [np.array(line.get_data()).T for line in axes.lines if to_hex(line.get_color()) == colour]


def shaded(axes):
    """The intervals shaded from top to bottom."""
    boxes = [patch for patch in axes.patches if to_hex(patch.get_facecolor()) == style.FAINT]
    assert all(isinstance(box, Polygon | Rectangle) for box in boxes)
    extents = [box.get_path().transformed(box.get_patch_transform()).get_extents() for box in boxes]
    return [(extent.x0, extent.x1) for extent in extents]


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_every_picture_is_written(tmp_path, suffix, recording, predictions, result):
    path = tmp_path / f"picture.{suffix}"
    for draw in (
        lambda: plots.plot_fit(path, recording, predictions),
        lambda: plots.plot_paths(path, [(recording, prediction) for prediction in predictions]),
        lambda: plots.plot_history(path, result),
        lambda: plots.plot_parameters(path, result),
        lambda: plots.plot_loss(path, [0.2, 0.1], [0.3, 0.2]),
    ):
        path.unlink(missing_ok=True)
        draw()
        data = path.read_bytes()
        if suffix == "svg":
            assert ElementTree.fromstring(data).tag.endswith("svg")
        else:
            assert data.startswith(b"\x89PNG")


def test_fit_shows_the_recording_with_gaps_and_the_predictions(tmp_path, recording, predictions, drawn):
    plots.plot_fit(tmp_path / "fit.svg", recording, predictions)
    for axis, axes in enumerate(drawn.figure.axes):
        (dots,) = lines(axes, style.RECORDED)
        np.testing.assert_array_equal(dots[:, 1], recording.marble[:, axis])
        assert np.flatnonzero(np.isnan(dots[:, 1])).tolist() == lost_rows(recording)
        for prediction in predictions:
            (line,) = lines(axes, prediction.colour)
            np.testing.assert_array_equal(line[:, 1], prediction.marble[:, axis])
        assert shaded(axes) == [(6.5, 9.5), (19.5, 20.5)]
    assert {"untuned", "tuned", "recorded", "timestep", "x  [edges]", "y  [edges]"} <= set(
        texts(drawn.figure)
    )


def test_fit_of_a_stamped_recording_runs_over_seconds_from_zero(tmp_path, recording, predictions, drawn):
    rows = len(recording.knobs)
    stamped = replace(recording, stamps=100.0 + 0.05 * np.arange(rows))
    plots.plot_fit(tmp_path / "fit.svg", stamped, predictions)
    assert drawn.figure.axes[0].get_xlim() == pytest.approx((0.0, 0.05 * (rows - 1)))
    assert "time  [s]" in texts(drawn.figure)


def test_fits_with_a_limit_can_be_compared(tmp_path, recording, predictions, drawn):
    for prediction in predictions:
        plots.plot_fit(tmp_path / "fit.svg", recording, [prediction], limit=0.7)
        assert [axes.get_ylim() for axes in drawn.figure.axes] == [(-0.7, 0.7)] * 2


def test_fit_labels_a_line_that_ends_in_a_gap(tmp_path, recording, predictions, drawn):
    marble = predictions[0].marble.copy()
    marble[-3:] = np.nan
    gappy = plots.Prediction("gappy", marble, predictions[0].model)
    plots.plot_fit(tmp_path / "fit.svg", recording, [gappy])
    heights = [text.get_position()[1] for text in drawn.figure.axes[0].texts if text.get_text() == "gappy"]
    assert np.isfinite(heights).all()
    assert len(heights) == 1


def test_lines_break_where_a_prediction_begins_anew(tmp_path, recording, predictions, drawn):
    windows = replace(predictions[1], window_rows=np.array([12, 30]))
    plots.plot_fit(tmp_path / "fit.svg", recording, [windows])
    pieces = lines(drawn.figure.axes[0], style.TUNED)
    assert [(piece[0, 0], piece[-1, 0]) for piece in pieces] == [(0, 11), (12, 29), (30, 39)]
    plots.plot_paths(tmp_path / "paths.svg", [(recording, windows)])
    assert [len(piece) for piece in lines(drawn.figure.axes[0], style.TUNED)] == [12, 18, 10]


def test_paths_show_rim_and_reach_at_the_models_scale(tmp_path, recording, predictions, drawn):
    plots.plot_paths(tmp_path / "paths.svg", [(recording, prediction) for prediction in predictions])
    for axes, prediction in zip(drawn.figure.axes, predictions, strict=True):
        rim, reach = (patch for patch in axes.patches if isinstance(patch, Rectangle))
        scale, board = prediction.model.values[4], prediction.model.board
        assert rim.get_width() == pytest.approx(scale)
        assert rim.get_height() == pytest.approx(scale * board.edge_y_m / board.edge_x_m)
        diameter = scale * 2 * prediction.model.marble.radius_m / board.edge_x_m
        assert rim.get_width() - reach.get_width() == pytest.approx(diameter)
        assert rim.get_height() - reach.get_height() == pytest.approx(diameter)
        (path,) = lines(axes, prediction.colour)
        np.testing.assert_array_equal(path, prediction.marble)
        assert {prediction.label, "start", "• recorded"} <= {text.get_text() for text in axes.findobj(Text)}


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_paths_stand_two_to_a_row(tmp_path, recording, predictions, drawn, count):
    plots.plot_paths(tmp_path / "paths.svg", [(recording, predictions[0])] * count)
    spec = drawn.figure.axes[0].get_subplotspec().get_gridspec()
    assert (spec.nrows, spec.ncols) == {1: (1, 1), 2: (1, 2), 3: (2, 2), 4: (2, 2)}[count]
    assert sum(axes.axison for axes in drawn.figure.axes) == count


def test_history_marks_the_best_iteration_of_the_winner(tmp_path, result, drawn):
    plots.plot_history(tmp_path / "history.svg", result, noise=0.001)
    (axes,) = drawn.figure.axes
    winner, mark = lines(axes, style.TUNED)
    np.testing.assert_allclose(winner[:, 1], [20.0, 1.0, 2.0])
    np.testing.assert_allclose(mark, [[1, 1.0]])
    (other,) = lines(axes, style.MUTED)
    np.testing.assert_allclose(other[:, 1], [30.0, 5.0])
    (floor,) = lines(axes, style.INK)
    np.testing.assert_allclose(floor[:, 1], 0.1 * np.sqrt(2 / np.pi))


def test_history_of_one_start_names_no_winner(tmp_path, result, drawn):
    single = replace(result, estimates=result.estimates[:1])
    plots.plot_history(tmp_path / "history.svg", single)
    assert "best start" not in texts(drawn.figure)


def test_parameters_run_over_their_ranges_with_intervals(tmp_path, result, drawn):
    plots.plot_parameters(tmp_path / "parameters.svg", result)
    for axes, name in zip(drawn.figure.axes, result.model.ranges, strict=True):
        assert axes.get_ylim() == pytest.approx(result.model.ranges[name])
        assert axes.get_title(loc="left") == name.replace("_", " ")
        (band,) = axes.patches
        extent = band.get_path().transformed(band.get_patch_transform()).get_extents()
        value = result.model.parameters[name].value
        assert (extent.y0, extent.y1) == pytest.approx((0.98 * value, 1.02 * value))


def test_parameter_outside_its_range_stays_in_the_picture(tmp_path, result, rig, drawn):
    outside = Model.from_rig(rig, result.model.values * [4, 1, 1, 1, 1])
    plots.plot_parameters(tmp_path / "p.svg", replace(result, model=outside))
    assert drawn.figure.axes[0].get_ylim() == pytest.approx((0.0, 0.16))


def test_loss_names_both_curves(tmp_path, drawn):
    plots.plot_loss(tmp_path / "loss.svg", [0.2, 0.1], [0.3, 0.15])
    (axes,) = drawn.figure.axes
    np.testing.assert_allclose(lines(axes, style.MUTED)[0], [[1, 0.2], [2, 0.1]])
    np.testing.assert_allclose(lines(axes, style.TUNED)[0], [[1, 0.3], [2, 0.15]])
    assert {"training", "held out"} <= set(texts(drawn.figure))


def evaluation_of(recording: Recording, offset: float) -> Evaluation:
    """Off by `offset` in x alone; windows begin in rows 4 and 20 and end in row 35."""
    free = recording.marble + np.array([offset, 0.0])
    windowed = free.copy()
    windowed[:4] = windowed[36:] = np.nan
    errors = Errors(offset / 2, offset, offset, 1, 0)
    run = RunEvaluation(recording.name, errors, free, errors, windowed, np.array([4, 20]))
    return Evaluation(2.0, (run,), errors, errors)


def test_evaluation_shows_errors_and_breaks_between_windows(tmp_path, recording, drawn):
    plots.plot_evaluation(tmp_path / "e.svg", evaluation_of(recording, 0.04), [recording], noise=0.001)
    (axes,) = drawn.figure.axes
    (free,) = lines(axes, style.TUNED)
    seen = ~np.isnan(free[:, 1])
    np.testing.assert_allclose(free[seen, 1], 2.0)
    assert np.flatnonzero(~seen).tolist() == lost_rows(recording)
    pieces = [piece[~np.isnan(piece[:, 1]), 0] for piece in lines(axes, style.SECOND)]
    shown = [(piece[0], piece[-1]) for piece in pieces if len(piece)]
    assert shown == [(4, 19), (21, 35)]  # row 20 is lost
    assert {"free run", "windows of\n2 s", "tracker noise", "run-1"} <= set(texts(drawn.figure))


def test_mean_absolute_of_noise():
    draws = np.random.default_rng(0).normal(0.0, 0.3, 100_000)
    assert mean_absolute(0.3) == pytest.approx(np.abs(draws).mean(), rel=0.01)
