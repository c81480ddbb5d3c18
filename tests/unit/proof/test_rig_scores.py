"""What an answer is worth, on labels and answers made by hand."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.model import Effect, Model, save_model
from irt.proof.plan import group_of
from irt.proof.score import Errors, intervals, matched, naming, score_rig
from irt.recording import Recording, load_recording
from irt.rig import RANGES, Board, Marble, Rig

VALUES = (0.06, 0.05, 4e-4, 15.0, 1.0)
BIAS = {"name": "tilt_bias", "bias_x_rad": 0.002, "bias_y_rad": -0.001}
SIGMA = 1e-3


def diagnosis(verdict: str, *effects: str, **ties: list[str]) -> dict:
    named = [{"name": name, "confusable_with": ties.get(name, []), "parameters": {}} for name in effects]
    return {"verdict": verdict, "effects": named, "parameters": {}}


@pytest.mark.parametrize(
    ("kind", "answer", "exact", "found"),
    [
        ("delay", diagnosis("missing", "delay"), True, True),
        ("delay", diagnosis("missing", "lag", lag=["delay"]), False, True),
        ("delay", diagnosis("missing", "delay", delay=["lag"]), True, True),
        ("delay", diagnosis("missing", "lag"), False, False),
        ("delay", diagnosis("missing", "delay", "bump"), False, False),
        ("delay", diagnosis("sufficient"), False, False),
        ("delay", diagnosis("unlisted", "unlisted"), False, False),
        (["delay", "bump"], diagnosis("missing", "bump", "delay"), True, True),
        (["delay", "bump"], diagnosis("missing", "lag", "bump", lag=["delay"]), False, True),
        (["delay", "lag"], diagnosis("missing", "delay", "bump", delay=["lag"]), False, False),
        (
            ["delay", "lag"],
            diagnosis("missing", "delay", "latency", delay=["lag"], latency=["delay"]),
            False,
            True,
        ),
        (["delay", "bump"], diagnosis("missing", "delay"), False, False),
        (["delay", "bump", "lag"], diagnosis("missing", "lag", "delay", "bump"), True, True),
        (["delay", "bump", "lag"], diagnosis("missing", "lag", "delay"), False, False),
        ("unlisted_magnus", diagnosis("unlisted", "unlisted"), True, True),
        ("unlisted_magnus", diagnosis("missing", "side_force"), False, False),
        ("unlisted_magnus", diagnosis("sufficient"), False, False),
        ("none", diagnosis("sufficient"), True, True),
        ("none", diagnosis("missing", "delay"), False, False),
        ("outliers", diagnosis("unlisted", "unlisted"), False, False),
    ],
)
def test_names(kind, answer: dict, exact: bool, found: bool) -> None:
    group, kinds = group_of({"kind": kind})
    score = naming(group, kinds, answer)
    assert (score["exact"], score["found"]) == (exact, found)
    assert score["false_alarm"] == (kind in ("none", "outliers") and not found)


def test_the_size_of_a_tie_counts_the_name_itself() -> None:
    answer = diagnosis("missing", "delay", "bump", delay=["lag", "latency"])
    assert naming("pair", ("delay", "bump"), answer)["tie_size"] == 2.0
    assert naming("none", (), diagnosis("sufficient"))["tie_size"] is None


def test_a_name_stands_for_one_effect() -> None:
    assert matched(["delay", "lag"], {"delay": ["lag"]}) == {"delay": "delay"}
    assert matched(["lag", "delay"], {"x": ["lag", "delay"], "lag": []}) == {"lag": "lag", "delay": "x"}


@pytest.mark.parametrize(
    ("kind", "group"), [(["a"], "single"), (["a", "b", "c"], "triple"), (["a", "b", "c", "d"], "several")]
)
def test_labels_of_several_effects(kind: list[str], group: str) -> None:
    assert group_of({"kind": kind}) == (group, tuple(kind))


def test_intervals_of_what_is_known() -> None:
    interval = {"value": 1.0, "low": 0.5, "high": 1.5}
    truth = {
        "gear_x": 1.4,
        "gear_y": 1.6,
        "time_scale": 9.0,
        "rolling_friction": None,
        "effects": [{"name": "delay", "delay_s": 0.5}, {"name": "bump", "height_m": 0.4}],
    }
    answer = {
        "parameters": {
            "gear_x": interval,
            "gear_y": interval,
            "rolling_friction": interval,
            "time_scale": {"value": 1.0, "low": 0.5, "high": None},
        },
        "effects": [
            {"name": "delay", "parameters": {"delay_s": interval}},
            {"name": "bump", "parameters": {"height_m": interval, "width_m": interval}},
            {"name": "lag", "parameters": {"time_constant_s": interval}},
        ],
    }
    assert intervals(answer, truth) == {
        "gear_x": "yes",
        "gear_y": "no",
        "time_scale": "open",
        "delay.delay_s": "yes",
        "bump.height_m": "no",
    }


@pytest.mark.parametrize(
    ("name", "truth", "held"),
    [("grain_rad", 0.1, "yes"), ("phase_rad", 0.1, "no"), ("phase_rad", 3.1, "yes"), ("ratio", 0.1, "no")],
)
def test_an_angle_says_the_same_after_a_turn(name: str, truth: float, held: str) -> None:
    interval = {"value": 3.2, "low": 3.0, "high": 3.4}
    answer = {"parameters": {}, "effects": [{"name": "x", "parameters": {name: interval}}]}
    assert intervals(answer, {"effects": [{"name": "x", name: truth}]}) == {f"x.{name}": held}


def test_the_gap_between_base_and_oracle() -> None:
    errors = Errors(base=0.011, final=0.002, oracle=0.001, signal=9.0)
    assert errors.closed() == pytest.approx(0.9)
    assert errors.closed(0.011) == 0.0
    assert errors.closed(0.021) == pytest.approx(-1.0)
    assert Errors(base=0.00105, final=0.001, oracle=0.001, signal=0.3).closed() is None


@pytest.fixture
def opened(tmp_path: Path):
    """Return what writes the label and the answer of a rig whose board is not level."""
    knobs = 0.05 * np.sin(2 * np.pi * np.arange(60)[:, None] / np.array([20.0, 13.0]))
    clean = rollouts([VALUES], knobs, effects=[BIAS], time_step="continuous")[0]
    seen = clean + SIGMA * np.random.default_rng(0).standard_normal(clean.shape)
    seen[0] += 0.02
    rig = Rig(tmp_path, Board(), Marble(), "rest", dict(RANGES), ())
    answer, folder = tmp_path / "answer", tmp_path / "opened"
    answer.mkdir()
    folder.mkdir()
    (folder / "test-1.csv").write_text(Recording("test-1", folder, knobs, seen).to_csv())
    label = {
        "kind": "tilt_bias",
        "truth": {"gear_x": 0.06, "effects": [BIAS]},
        "sigma": SIGMA,
        "noise": "heavy",
        "drive": "controller",
        "through_camera": True,
        "tests": {"test-1": {"csv": "", "clean": clean.tolist()}},
    }
    (folder / "label.json").write_text(json.dumps(label))
    save_model(answer / "base.toml", Model.from_rig(rig, VALUES, time_step="continuous"))
    parameters = {key: value for key, value in BIAS.items() if key != "name"}
    right = Model.from_rig(rig, VALUES, effects=[Effect("tilt_bias", parameters)], time_step="continuous")
    save_model(answer / "model.toml", right)
    (answer / "diagnosis.json").write_text(json.dumps(diagnosis("missing", "tilt_bias")))
    (answer / "seconds.json").write_text('{"seconds": 2.5}')
    return answer, folder, clean, seen


def test_errors_on_runs_held_out(opened) -> None:
    """The right model errs as the true path does, although the tracker saw row 0 far off."""
    answer, folder, clean, seen = opened
    score = score_rig("rig-0001", answer, folder)
    assert score.errors is not None
    assert score.errors.oracle == pytest.approx(np.abs(clean - seen)[1:].sum() / seen.size)
    assert score.errors.final == pytest.approx(score.errors.oracle, rel=1e-6)
    assert score.closed == pytest.approx(1.0)
    base = rollouts([VALUES], np.zeros((1, 2)), time_step="continuous")
    assert base.shape == (1, 1, 2)
    assert score.errors.signal == pytest.approx(score.errors.base / SIGMA, rel=0.1)
    assert score.errors.signal > 5.0
    assert score.budget is None
    said = json.loads((answer / "diagnosis.json").read_text())
    shares = {"tilt_bias": 0.9, "tracker": 0.06, "not repeatable": 0.04}
    said["budget"] = [{"what": what, "share": share, "horizon_s": None} for what, share in shares.items()]
    said["budget"].append({"what": "tracker", "share": 0.5, "horizon_s": 1.0})
    said["inclusion"] = {"tilt_bias": 0.99, "lag": 0.01}
    (answer / "diagnosis.json").write_text(json.dumps(said))
    again = score_rig("rig-0001", answer, folder)
    assert (again.inclusion, again.budget.effects, again.budget.tracker) == (said["inclusion"], 0.9, 0.06)
    path = rollouts([VALUES], load_recording(folder / "test-1.csv").knobs, time_step="continuous")[0]
    begun = np.vstack([clean[:1], seen[1:]])
    share = ((begun - clean) ** 2).mean() / ((begun - path) ** 2).mean()
    assert again.budget.true_tracker == pytest.approx(share, rel=1e-3)
    assert again.budget.true_effects == pytest.approx(1.0 - share, rel=1e-3)
    assert (score.noise, score.drive) == ("heavy", "controller")
    assert (score.through_camera, score.seconds) == (True, 2.5)
    assert json.dumps(score.as_dict(), allow_nan=False)


def test_a_failed_diagnosis_is_scored_as_wrong(opened) -> None:
    answer, folder, *_ = opened
    (answer / "failed.json").write_text('{"error": "no marble"}')
    score = score_rig("rig-0001", answer, folder)
    assert (score.verdict, score.found, score.reason) == ("failed", False, "no marble")
    assert score.closed is None
    assert math.isnan(score.seconds)
    assert score.as_dict()["seconds"] is None


def test_delays_that_differ_by_chance_have_no_gap(score) -> None:
    assert score(kinds=("delay_jitter",)).closed is None
    assert score("none").closed is None
    assert score().closed == pytest.approx(0.0189 / 0.019)
