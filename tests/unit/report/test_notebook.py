"""Notebook display of results: HTML tables and matplotlib pictures."""

import struct
from html.parser import HTMLParser

import numpy as np
import pytest
from made_up import make_diagnosis, sample_rig
from matplotlib.figure import Figure

import irt
from irt import pictures
from irt.model import Model
from simulated_rigs import STEP_S, TRUTH, drive


class Balanced(HTMLParser):
    """Raises where a tag is closed that is not open, and keeps all text."""

    def __init__(self):
        super().__init__()
        self.open, self.text = [], []

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def text_of(result):
    parser = Balanced()
    parser.feed(result._repr_html_())
    parser.close()
    assert not parser.open
    return " ".join(parser.text)


@pytest.fixture(scope="module")
def results():
    runs = []
    for seed in range(2):
        knobs = drive(90, seed)
        marble = irt.rollouts(TRUTH, knobs, time_step="continuous")[0]
        t = STEP_S * np.arange(90)
        runs.append(irt.Recording.from_arrays(commands=knobs, marble=marble, t=t, name=f"<{seed}>"))
    rig = irt.Rig.from_recordings(runs)
    fit = irt.tune(rig, starts=1)
    effects = (irt.Effect("delay", {"delay_s": 0.1}),)
    return {
        "model": Model.from_rig(rig, TRUTH[0], effects=effects),
        "fit": fit,
        "evaluation": irt.evaluate(fit.model, rig, 1.0),
        "check": irt.check(rig),
        "diagnosis": make_diagnosis(sample_rig(), "missing"),
        "suggestion": irt.Suggestion(
            commands=runs[0].knobs,
            start=np.zeros(2),
            stamps=runs[0].stamps,
            family="steps",
            separation=(),
            information=0.0,
            random_information=0.0,
            doubt=0.0,
            gain=1.0,
            random_gain=0.5,
            remaining={},
            at_wall=0.0,
            tried=3,
            sentences=("Play this & that.",),
        ),
    }


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("model", ["gear_x", "0.07", "delay", "delay_s 0.1"]),
        ("fit", ["least-squares", "gear_y", "time_scale"]),
        ("evaluation", ["<0>", "all runs", "windows of 1 s"]),
        ("check", ["<1>", "rows a second"]),
        ("diagnosis", ["missing", "backlash"]),
        ("suggestion", ["Play this & that."]),
    ],
)
def test_a_result_is_a_table(results, name, shown):
    text = text_of(results[name])
    assert [one for one in shown if one not in text] == []


@pytest.mark.parametrize("name", ["model", "fit", "evaluation", "check", "diagnosis", "suggestion"])
def test_a_result_is_a_picture(results, name, tmp_path):
    figure = results[name].plot()
    assert isinstance(figure, Figure)
    picture = figure._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert min(struct.unpack(">II", picture[16:24])) > 100
    figure.savefig(tmp_path / "it.svg")


def test_an_axis_of_errors_within_one_power_of_ten_has_numbers():
    figure = pictures.curves(
        [pictures.Line("", np.array([4.0, 2.6, 1.8]), pictures.AFTER)], "iteration", "error"
    )
    figure.canvas.draw()
    (axes,) = figure.axes
    low, high = axes.get_ylim()
    numbers = [tick.get_text() for tick in axes.get_yticklabels() if low <= tick.get_position()[1] <= high]
    assert len(numbers) >= 2
    assert "" not in numbers


def test_all_that_results_are_is_at_the_top():
    for name in ("FitResult", "Evaluation", "Diagnosis", "Check", "Suggestion", "Model", "Recording", "Rig"):
        assert isinstance(getattr(irt, name), type)
