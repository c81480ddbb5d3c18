from dataclasses import replace

import numpy as np
import pytest

from irt.engine import rollouts
from irt.errors import IrtError
from irt.model import Model
from irt.recording import Recording
from irt.report import style
from irt.report.tuning_report import (
    Contender,
    compare,
    lead,
    untuned,
    write_tuning_report,
)
from irt.report.words import percent
from irt.residual import evaluate
from irt.rig import PARAMETERS


@pytest.fixture
def simulated(rig, result, tmp_path):
    """The rig with recordings that the tuned model explains down to noise of 0.001 board edges."""
    rng = np.random.default_rng(0)
    phase = 2 * np.pi * np.arange(60) / 60
    runs = []
    drives = {"first": [np.sin(phase), np.cos(phase)], "<second>": [np.cos(phase), -np.sin(phase)]}
    for name, drive in drives.items():
        knobs = 0.05 * np.stack(drive, axis=1)
        (marble,) = rollouts(result.model.values[None], knobs, rig=rig)
        runs.append(Recording(name, tmp_path / name, knobs, marble + rng.normal(0, 1e-3, marble.shape)))
    return replace(rig, recordings=tuple(runs))


@pytest.fixture
def contender(simulated, result):
    def make(name, factor):
        model = Model.from_rig(simulated, result.model.values * [factor, 1, 1, 1, 1])
        return Contender(name, model, evaluate(model, simulated.recordings), style.TUNED)

    return make


def test_untuned_means_the_middle_of_the_ranges(rig):
    model = untuned(replace(rig, ranges={**rig.ranges, "gear_x": (0.02, 0.04)}))
    assert model.parameters["gear_x"].value == pytest.approx(0.03)
    for name in PARAMETERS[1:]:
        assert model.parameters[name].value == pytest.approx(sum(rig.ranges[name]) / 2)


def test_lead_says_when_the_model_explains_nearly_everything(contender):
    before, after = contender("untuned", 1.5), contender("IRT", 1.0)
    assert lead([before, after], [], 1e-3) == (
        f"Tuning by IRT reduced the mean error on 2 recordings: {percent(before.mae)} of the board's edge "
        f"untuned, {percent(after.mae)} tuned. Tracker noise alone gives {percent(8e-4)}: the model explains "
        "nearly all that can be explained."
    )


def test_lead_says_when_physics_may_be_missing(contender):
    before, after, worse = contender("untuned", 1.5), contender("IRT", 1.0), contender("IRT", 1.2)
    text = lead([before, after], [before, worse], 1e-3)
    held_out = f"on 2 held-out recordings: {percent(before.mae)} of the board's edge untuned, "
    assert f"{held_out}{percent(worse.mae)} tuned. " in text
    assert "physics missing in the model" in text


def test_lead_admits_that_tuning_did_not_help(contender):
    text = lead([contender("untuned", 1.0), contender("IRT", 1.2)], [], 1e-3)
    assert text.startswith("Tuning by IRT did not reduce the mean error")


def test_comparison_names_the_better_one_or_a_draw(contender):
    good, bad = contender("least squares", 1.0), contender("IRT", 1.2)
    for order in ((good, bad), (bad, good)):
        assert compare(*order).startswith("On these recordings least squares is better: ")
    assert "are equally good" in compare(good, contender("IRT", 1.0))


@pytest.mark.slow
def test_page_holds_the_errors_that_evaluation_finds(tmp_path, simulated, result):
    second = replace(result, method="least-squares", notes=("a note",), estimates=result.estimates[:1])
    path = write_tuning_report(
        tmp_path / "out",
        simulated,
        [result, second],
        heldout=simulated,
        title="A <title>",
        settings={"seed": "7"},
    )
    page = path.read_text(encoding="utf-8")
    evaluation = evaluate(result.model, simulated.recordings)
    for run in evaluation.runs:
        assert f"<td>{percent(run.free_run.mae)}</td>" in page
    for text in (
        "A &lt;title&gt;",
        "&lt;second&gt;",
        "gears &amp; time: &lt;one&gt; number",
        "a note",
        "<dd>7</dd>",
    ):
        assert text in page
    assert "<li>IRT: gears" not in page  # both methods say it, so nobody in particular does
    assert "<li>least squares: a note</li>" in page
    assert "from 2 starts" in page
    assert "from 1 start, runs begin at their fitted states;" in page
    assert page.count("<figure>") == len(list((tmp_path / "out").glob("*.svg"))) == 2 + 2 + 2 + 4
    assert "nan" not in page.split("</style>")[1].lower()


def test_page_of_a_single_fit_needs_no_runs_held_out(tmp_path, simulated, result):
    page = write_tuning_report(tmp_path, simulated, [result], title="t", settings={}).read_text(
        encoding="utf-8"
    )
    assert "held-out" not in page
    assert page.count("<figure>") == 2 + 2 + 2


def test_a_marble_in_motion_is_judged_in_windows(tmp_path, simulated, result):
    moving = replace(simulated, start="moving")
    fitted = replace(result, model=replace(result.model, start="moving"))
    page = write_tuning_report(tmp_path, moving, [fitted], title="t", settings={}).read_text(encoding="utf-8")
    # Without stamps nothing is stated in seconds but the time of computing.
    assert "Time scale unknown." in page
    assert "in windows of 30 rows, each from the state estimated on the rows before it" in page
    windowed = evaluate(fitted.model, moving.recordings).windowed
    assert windowed is not None
    assert f"{percent(windowed.mae)} tuned" in page


def test_unwritable_folder_is_named(tmp_path, simulated, result):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(IrtError, match="file"):
        write_tuning_report(tmp_path / "file", simulated, [result], title="t", settings={})
