"""An error budget in words and as bars."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from irt.diagnosis.result import Remains, RunProof, Share
from irt.report import style
from irt.report.budget_plots import plot_budget
from irt.report.error_budget import bars, remainder, squares_explained


@pytest.fixture
def diagnosis(diagnosis_of):
    """A budget of two effects, the larger first, at two horizons."""
    shares = {
        "tilt_bias": (0.4, 0.9),
        "lag": (0.3, 0.08),
        "tracker": (0.2, 0.01),
        "not repeatable": (0.1, 0.01),
    }
    return replace(
        diagnosis_of("missing"),
        budget=tuple(
            Share(what, both[index], horizon)
            for index, horizon in enumerate((1.0, None))
            for what, both in shares.items()
        ),
        remains=Remains(0.01, "contact", repeats=False, floor_of_the_log=0.002),
    )


def test_whole_runs_come_first_and_the_parts_keep_their_order(diagnosis):
    whole, second = bars(diagnosis)
    assert (whole.title, second.title) == ("whole runs", "1 s ahead")
    assert [part.name for part in whole.parts] == ["tilt bias", "lag", "tracker noise", "does not repeat"]
    assert [part.share for part in second.parts] == [0.4, 0.3, 0.2, 0.1]
    assert [part.kind for part in whole.parts] == ["effect", "effect", "tracker", "rest"]


def test_the_share_of_the_squared_error_is_that_of_the_bar_of_whole_runs(diagnosis):
    assert "98\N{NO-BREAK SPACE}%" in squares_explained(diagnosis)
    assert squares_explained(replace(diagnosis, budget=())) == ""


def test_without_stamps_horizons_are_in_rows(diagnosis):
    assert [bar.title for bar in bars(diagnosis, row_s=0.05)] == ["whole runs", "20 rows ahead"]


@pytest.mark.parametrize(
    ("stage", "repeats", "name"),
    [("board", False, "does not repeat"), ("board", True, "not explained"), (None, False, "not explained")],
)
def test_only_what_a_random_push_explains_is_said_not_to_repeat(diagnosis, stage, repeats, name):
    remains = Remains(0.3, stage, repeats, 0.002)
    assert bars(replace(diagnosis, remains=remains))[0].parts[-1].name == name


def test_bars_are_as_long_as_their_shares_and_the_rest_is_distinct_without_colour(tmp_path, diagnosis, drawn):
    plot_budget(tmp_path / "budget.svg", bars(diagnosis))
    patches = [one for one in drawn.figure.axes[0].patches if isinstance(one, Rectangle)]
    # Two bars, then the key.
    lengths = [one.get_width() for one in patches]
    assert lengths[:8] == pytest.approx([0.9, 0.08, 0.01, 0.01, 0.4, 0.3, 0.2, 0.1])
    assert [one.get_x() for one in patches[4:8]] == pytest.approx([0.0, 0.4, 0.7, 0.9])
    assert [bool(one.get_hatch()) for one in patches] == [False, False, False, True] * 3
    words = [one.get_text().replace("\N{NO-BREAK SPACE}", " ") for one in drawn.figure.findobj(Text)]
    assert "tilt bias 90 %" in words
    # Every share stands in the key, however narrow its part.
    assert words.count("1 %") == 2
    assert {"8 %", "10 %", "whole runs", "1 s ahead"} <= set(words)


def test_the_same_parts_have_the_same_colour_in_each_bar(tmp_path, diagnosis, drawn):
    plot_budget(tmp_path / "budget.svg", bars(diagnosis))
    looks = [one.get_facecolor() for one in drawn.figure.axes[0].patches]
    assert looks[:4] == looks[4:8] == looks[8:]
    assert len(set(looks[:4])) == 4
    svg = (tmp_path / "budget.svg").read_text()
    # A page turns colours into its own: all are of the palette.
    assert all(own in svg for own in (style.TUNED, style.SECOND, style.RECORDED, style.UNTUNED))


@pytest.mark.parametrize(
    ("remains", "said", "unsaid"),
    [
        (Remains(0.3, "contact", False, 0.002), "It arises at the rim", "on the board"),
        (
            Remains(0.3, "board", True, 0.002),
            "a better model could still explain it",
            "No dependence on anything",
        ),
        (Remains(0.3, None, False, 0.002), "something that only the held-out run shows", "It arises"),
        (Remains(0.001, "board", False, 0.002), "Less than 1 %", "It arises"),
    ],
)
def test_what_remains_in_sentences(diagnosis, remains, said, unsaid):
    text = " ".join(remainder(replace(diagnosis, remains=remains)))
    assert said in text
    assert unsaid not in text
    assert "would have an error of 0.20" in text


def test_a_run_with_most_of_the_error_is_named(diagnosis):
    remains = Remains(0.3, None, False, 0.002)

    def runs(*errors):
        seen = np.zeros((10, 2))
        seen[3] = np.nan
        model = diagnosis.model
        return tuple(
            RunProof(f"run-{number}", np.arange(10.0), seen, seen, seen + error, error, error, model, model)
            for number, error in enumerate(errors)
        )

    text = " ".join(remainder(replace(diagnosis, remains=remains, runs=runs(0.01, 0.02, 0.01))))
    assert "Most of the error is in run-1: look at that run." in text
    text = " ".join(remainder(replace(diagnosis, remains=remains, runs=runs(0.01, 0.01, 0.01))))
    assert "Most of the error" not in text


def test_nothing_remains_to_be_said_where_nothing_was_held_out(diagnosis):
    assert list(remainder(replace(diagnosis, remains=None))) == []
    assert bars(replace(diagnosis, budget=())) == []
