from dataclasses import replace

import numpy as np
import pytest
from made_up import TRUE, sample_rig
from matplotlib.collections import QuadMesh
from matplotlib.text import Text

from irt.diagnosis.result import Candidate, RunProof
from irt.model import Model
from irt.report import diagnosis_plots as plots
from irt.report import style
from irt.report.diagnosis_plots import Side

BEFORE, AFTER = Side("before", style.UNTUNED, "base"), Side("after", style.TUNED, "final")
EDGES = [np.linspace(-0.5, 0.5, 3), np.linspace(-0.4, 0.4, 3)]


def texts(figure):
    return [text.get_text() for text in figure.findobj(Text)]


@pytest.fixture
def proof():
    """Forty rows along the lower edge; before is off by 0.02 and 0.04, after by a tenth of that."""
    observed = np.stack([np.linspace(-0.4, 0.4, 40), np.full(40, -0.2)], axis=1)
    observed[5] = np.nan
    off = np.array([0.02, 0.04])
    model = Model.from_rig(sample_rig(), TRUE)
    paths = observed, observed + off, observed + 0.1 * off
    return RunProof("<run>", 0.1 * np.arange(40), *paths, 0.03, 0.003, model, model)


def candidate(gain, *effects, outcome=""):
    return Candidate(effects, {}, gain, 5.0, 0.0, outcome)


def test_two_simulators_are_compared_only_where_there_are_two(diagnosis_of):
    assert plots.sides(diagnosis_of("missing")) == (BEFORE, AFTER)
    assert plots.sides(diagnosis_of("unlisted")) == (BEFORE, AFTER)
    (alone,) = plots.sides(diagnosis_of("sufficient"))
    assert alone.label == "simulated"


def test_cells_hold_the_error_in_units_of_the_noise(proof):
    means = plots.cell_means([proof], AFTER, EDGES, 0.001)
    assert means.mask.tolist() == [[False, True], [False, True]]
    assert means[:, 0].data == pytest.approx(np.sqrt((2.0**2 + 4.0**2) / 2) * np.ones(2))


def test_map_has_one_scale_for_all_that_is_compared(tmp_path, proof, diagnosis_of, drawn):
    model = diagnosis_of("missing").model
    norms = []
    for side in (BEFORE, AFTER):
        plots.plot_map(tmp_path / "map.svg", [proof], model, side, 0.001)
        (cells,) = drawn.figure.axes[0].findobj(QuadMesh)
        norms.append((cells.norm.boundaries.tolist(), cells.cmap.colors))
    assert norms[0] == norms[1]


def test_error_over_time_is_the_mean_of_both_axes(proof):
    times, errors = plots.binned_error(proof, BEFORE)
    assert len(times) == len(errors) == 13
    assert times[0] == pytest.approx(np.mean(proof.times[:4]))
    assert errors == pytest.approx(3.0)
    assert plots.highest_error([proof], [AFTER, BEFORE]) == pytest.approx(3.0)


def test_errors_of_a_run_without_a_marble_leave_a_gap(tmp_path, proof, drawn):
    lost = replace(proof, observed=np.full((40, 2), np.nan), recording="lost")
    plots.plot_errors(tmp_path / "errors.svg", [proof, lost], [BEFORE, AFTER], 0.001, top=5.0)
    assert {"<run>", "lost", "before", "after", "noise"} <= set(texts(drawn.figure))
    assert plots.highest_error([lost], [BEFORE]) == 0.0


def test_run_over_time_has_a_band_of_noise_below_each_axis(tmp_path, proof, drawn):
    plots.plot_over_time(tmp_path / "time.svg", proof, BEFORE, 0.001, limit=0.5)
    panels = drawn.figure.axes
    assert [panel.get_ylim() for panel in panels[::2]] == [(-0.5, 0.5)] * 2
    for panel, off in zip(panels[1::2], (2.0, 4.0), strict=True):
        (band,) = panel.patches
        assert band.get_extents().transformed(panel.transData.inverted()).y1 == pytest.approx(0.196)
        assert np.nanmax(panel.lines[0].get_ydata()) == pytest.approx(off)


@pytest.mark.parametrize(("stamped", "unit"), [(True, "m/s²"), (False, "mm/row²")])
def test_push_over_time_has_a_band_for_each_simulator(tmp_path, diagnosis_of, drawn, stamped, unit):
    push, rows_s = diagnosis_of("missing").pushes[0], (0.5, 0.7)
    plots.plot_push(tmp_path / "push.svg", push, [BEFORE, AFTER], rows_s, stamped=stamped)
    # Without stamps each simulator has a time scale of its own.
    scales = [1.0 if stamped else 1000.0 * row_s**2 for row_s in rows_s]
    for axis, axes in enumerate(drawn.figure.axes):
        assert unit in axes.get_ylabel()
        assert len(axes.collections) == 2
        before, after = axes.get_lines()[1:]
        assert before.get_ydata() == pytest.approx(scales[0] * push.base[:, axis], nan_ok=True)
        assert after.get_ydata() == pytest.approx(scales[1] * push.final[:, axis], nan_ok=True)


def test_board_shows_what_was_recorded_and_every_prediction(tmp_path, proof, diagnosis_of, drawn):
    plots.plot_board(tmp_path / "board.svg", proof, diagnosis_of("missing").model, [BEFORE, AFTER])
    assert {"before", "after", "• recorded", "start"} <= set(texts(drawn.figure))


def test_ranking_marks_the_answer_and_its_ties(tmp_path, drawn):
    tried = [
        candidate(905.0, "delay", outcome="as good as backlash"),
        candidate(900.0, "backlash", outcome="named"),
        candidate(2.0, "lag", "bump", outcome="a very long outcome " * 9),
        candidate(1.0, *(["spring_hysteresis"] * 6), outcome="a very long outcome " * 9),
        candidate(4.8, "parallax", outcome="no better"),
    ]
    answer, ties = frozenset({"backlash"}), {frozenset({"delay"})}
    plots.plot_ranking(tmp_path / "ranking.svg", tried, answer, ties, span=(-3.0, 900.0))
    bars = drawn.figure.axes[0].patches
    assert [bar.get_width() for bar in bars] == pytest.approx([900.0, 895.0, -3.0, -4.0, -0.2])
    tie, named, rest, *_ = (bar.get_facecolor() for bar in bars)
    assert tie != named != rest != tie
    words = texts(drawn.figure)
    assert {"delay", "backlash", "lag + bump", "named   +895", "no better   +0"} <= set(words)
    # Where a name leaves no room for an outcome there is the number alone.
    assert "\N{MINUS SIGN}4" in words
    assert max(len(word) for word in words) < 70


def test_long_runs_are_thinned_to_what_can_be_seen():
    rows = plots.thinned(100_000, 300)
    assert (rows[0], rows[-1], len(rows)) == (0, 99_999, 300)
    assert plots.thinned(3, 300).tolist() == [0, 1, 2]
