import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from few_trials import QUICK

from irt.engine import paper_drive
from irt.errors import IrtError
from irt.paper import laboratory, page, render, standin, tables
from irt.paper.recorded import judge
from irt.paper.simulated import experiment1
from irt.paper.standin import Diagnosed, Row, experiment2
from irt.recording import load_recording

# Both experiments, for few targets, take seconds.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def second(setting):
    return experiment2(setting, QUICK)


def test_a_row_has_minimum_final_and_best_so_far(second):
    held = second.random["irt-paper"]
    row = Row.of("irt-paper", held)
    assert row.minimum[0] == pytest.approx(np.median(held.mae.min(axis=1)))
    assert row.final[0] == pytest.approx(np.median(held.mae[:, -1]))
    assert row.minimum[0] <= row.early[0]
    assert row.minimum[1] <= row.minimum[0] <= row.minimum[2]


def test_rigs_are_met_in_spite_of_what_is_missing(second):
    row = next(row for row in second.rows() if row.name == "irt+")
    assert row.early[0] < 0.03
    assert row.failures == 0


def test_from_the_middle_everyone_begins_there(second):
    start = second.setting.drive.scaled(second.middle["cma-es"].parameters[:, 0])
    np.testing.assert_allclose(start, 0.5)


def test_an_oracle_that_is_given_the_effects_fits_all_but_what_is_drawn_by_chance(second):
    folder = standin._folder(second.setting, 1)
    model = standin._oracle(second.setting, folder)
    assert [one.name for one in model.effects] == ["lag"]
    # The noise of the recordings has a mean absolute error of 0.0008.
    assert standin._mae(model, standin._target(folder)) < 0.0012


def test_the_table_has_the_papers_numbers_beside_ours(second):
    lines = list(tables.table1(second))
    assert any(line.startswith("| IRT, as in the paper | 4.02 % | 5 | ") for line in lines)
    assert any(line.startswith("| CMA-ES | 6.68 % | 30 | ") for line in lines)
    assert len(lines) == 2 + len(QUICK)


def test_no_pybullet_takes_one_line(setting, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(IrtError, match=r"labsim-irt\[prove\]"):
        experiment2(replace(setting, out=tmp_path), QUICK)


@pytest.mark.parametrize("name", render.OF_SECOND)
def test_figures_are_small_files(second, tmp_path, name):
    render.OF_SECOND[name](tmp_path, second)
    assert 5_000 < (tmp_path / f"{name}.png").stat().st_size < 150_000


def test_the_page_judges_every_claim_and_promise(setting, second, tmp_path):
    first = experiment1(setting, QUICK)
    results = page.Results(first, second, {"other": first}, [])
    page.write_page(tmp_path / "paper.md", "`irt reproduce`", results)
    text = (tmp_path / "paper.md").read_text(encoding="utf-8")
    judged = text[: text.index("## What this project promises")]
    verdicts = [line.split(" | ")[2] for line in judged.splitlines() if "**" in line]
    assert len(verdicts) >= 12
    assert set(verdicts) <= {"**reproduced**", "**not reproduced**", "**not decidable from the text**"}
    for figure in ("fig3", "fig4", "fig5", "fig6", "fig7", "fig8", "symmetry"):
        assert f"(paper/{figure}.png)" in text
    assert "IRT+: trials that diverge | none | 0 | kept" in text
    assert "| other | 6 | " in text


def test_a_floor_that_is_missed_is_shown(setting, second):
    first = experiment1(setting, QUICK)
    worse = {**first.held, "irt+": first.held["es"]}
    promised = {one.what: one.kept for one in page.floors(replace(first, held=worse), second)}
    assert not promised["IRT+: mean state MAE after 5 rollouts"]
    poor = [Diagnosed(("lag",), "missing", 0.02, 0.02, 0.015, 0.016, 0.01, 0.01)]
    *_, last = page.floors(first, replace(second, diagnosed=poor))
    assert not last.kept


def test_the_laboratory_records_the_papers_drive(tmp_path, monkeypatch):
    pytest.importorskip("pybullet", reason="the extra prove is not installed")
    monkeypatch.setattr(laboratory, "_RUNS", ("paper-1",))
    truth = laboratory.record(2, 7, tmp_path / "a", whole=True)
    assert laboratory.record(2, 7, tmp_path / "b", whole=False) == truth
    assert [one["name"] for one in truth["effects"]] == list(laboratory.EFFECTS_DRAWN)
    one, again = (load_recording(tmp_path / name / "paper-1.csv") for name in "ab")
    np.testing.assert_array_equal(one.marble, again.marble)
    np.testing.assert_allclose(one.knobs, paper_drive(), atol=1e-6)
    other = load_recording(tmp_path / "a" / "heldout" / "paper-3.csv")
    assert np.abs(other.marble - one.marble).mean() > truth["sigma"] / 2
    assert not (tmp_path / "b" / "heldout").exists()
    json.dumps(truth)


def test_a_real_rig_needs_two_recordings(setting, write_rig, wave):
    with pytest.raises(IrtError, match="expected at least two recordings"):
        judge(setting, write_rig({"run": (wave, 0.0 * wave)}))
