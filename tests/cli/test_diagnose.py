"""`irt diagnose` as a user runs it."""

import json
import re
import shutil
from contextlib import contextmanager

import numpy as np
import pytest

from irt.engine import rollouts
from irt.model import load_model
from irt.residual import evaluate
from irt.rig import PARAMETERS, load_rig

TRUTH = [[0.06, 0.05, 4e-4, 15.0, 1.03]]
PARALLAX = {"name": "parallax", "height_m_per_rad": 0.5}
TWO = (PARALLAX, {"name": "viscous_drag", "rate_per_s": 0.5})


@pytest.fixture
def lab(write_rig):
    """Return what writes a rig of four runs with these effects."""

    def write(*effects, runs=4, rows=60):
        random = np.random.default_rng(5)
        recordings = {}
        for index in range(runs):
            time = np.arange(rows)[:, None, None] / rows
            waves = np.sin(2 * np.pi * (time * random.uniform(0.7, 4.0, (2, 3)) + random.random((2, 3))))
            knobs = (waves * random.uniform(0.01, 0.05, (2, 3))).sum(axis=2)
            marble = rollouts(TRUTH, knobs, effects=effects)[0]
            recordings[f"run-{index}"] = knobs, marble + 1e-3 * random.standard_normal(marble.shape)
        return write_rig(recordings)

    return write


@pytest.fixture
def press(monkeypatch):
    """Return what presses Ctrl-C, in a block, after so many steps of the bar."""

    @contextmanager
    def pressing(after=0):
        @contextmanager
        def bar():
            def stop(done, *_):
                if done > after:
                    raise KeyboardInterrupt

            yield stop

        with monkeypatch.context() as patch:
            patch.setattr("irt.cli.progress.progress_bar", bar)
            yield

    return pressing


@pytest.mark.slow
def test_it_leaves_model_numbers_and_page(irt, lab, tmp_path):
    rig, out = lab(PARALLAX), tmp_path / "results" / "deep"
    done = irt("diagnose", rig, "--out", out)
    assert (done.status, done.err) == (0, "")
    answer = json.loads((out / "diagnosis.json").read_text())
    assert answer["verdict"] == "missing"
    assert set(answer) >= {"summary", "where", "effects", "fit", "parameters", "unidentifiable", "suggestion"}
    (effect,) = answer["effects"]
    assert effect["name"] == "parallax"
    assert effect["stage"] == "sensing"
    height = effect["parameters"]["height_m_per_rad"]
    assert height["low"] <= height["value"] <= height["high"]
    assert height["unit"] == "m/rad"
    assert effect["probability"] > 0.9
    assert answer["inclusion"]["parallax"] > 0.9
    for horizon in (1.0, None):
        shares = {one["what"]: one["share"] for one in answer["budget"] if one["horizon_s"] == horizon}
        assert sum(shares.values()) == pytest.approx(1.0)
        assert shares["parallax"] > 0.5
    assert answer["remains"]["floor_of_the_log"] < effect["heldout_mae_without"]
    assert effect["heldout_mae_with"] < 0.5 * effect["heldout_mae_without"]
    assert set(answer["fit"]) == {
        "noise",
        "base_mae",
        "final_mae",
        "base_heldout_mae",
        "final_heldout_mae",
        "nested_heldout_mae",
    }
    assert set(answer["parameters"]) == set(PARAMETERS)
    for place in answer["where"]:
        assert place["kind"] in {"stage", "time", "region", "regime", "run"}
        assert 0.0 <= place["strength"] <= 1.0
        assert 0.0 < place["p_value"] <= 0.05
    first, *_ = answer["plausible"]
    assert sum(one["probability"] for one in answer["plausible"]) == pytest.approx(1.0)
    assert [one.name for one in load_model(out / first["model"]).effects] == ["parallax"]
    model = load_model(out / "model.toml")
    assert evaluate(model, load_rig(rig).recordings).free_run.mae == answer["fit"]["final_mae"]
    assert [one.probability for one in model.posterior] == [one["probability"] for one in answer["plausible"]]
    heights = [one.effects[0].parameters["height_m_per_rad"] for one in model.sample(200) if one.effects]
    low, high = np.quantile(heights, [0.025, 0.975])
    assert high - low == pytest.approx(height["high"] - height["low"], rel=0.3)
    assert low <= height["value"] <= high
    assert "parallax" in (out / "report.html").read_text()
    assert answer["summary"] in done.out
    assert re.search(r"parallax: .* probable that parallax", done.out)
    assert "error budget: squared error on held-out runs, whole runs" in done.out
    assert "Even a perfect simulator would have an error of" in done.out
    assert f"wrote {out / 'model.toml'}, {out / 'diagnosis.json'} and {out / 'report.html'}" in done.out


@pytest.mark.slow
def test_sessions_of_one_rig_are_one_diagnosis(irt, lab, tmp_path):
    """Two days whose delays differ: the delay is named, and so is the difference."""
    days = []
    for day, delay_s in ((1, 0.1), (2, 0.18)):
        days.append(lab({"name": "delay", "delay_s": delay_s}).rename(tmp_path / f"day-{day}"))
    out = tmp_path / "out"
    done = irt("diagnose", *days, "--same-rig", "--out", out)
    assert done.status == 0, done.err
    answer = json.loads((out / "diagnosis.json").read_text())
    (effect,) = answer["effects"]
    assert effect["name"] in {"delay", "latency"}
    assert [one["parameter"] for one in answer["sessions"]] == [
        f"{effect['name']}.{next(iter(effect['parameters']))}"
    ]
    first, second = (answer["sessions"][0]["values"][day] for day in ("day-1", "day-2"))
    assert second - first == pytest.approx(0.08, abs=0.04)
    assert "Between sessions" in done.out
    assert "day-1/run-0" in (out / "report.html").read_text()


def test_sessions_that_are_none_are_one_line(irt, lab, tmp_path):
    rig = lab(runs=2)
    for words, message in (
        ((rig,), "--same-rig: name the folders of two sessions or more"),
        ((rig, rig), "two sessions have the name"),
        ((rig, tmp_path / "none"), "no such folder"),
        ((rig, rig, "--cluster", "auto"), "--cluster: sessions of one rig are one diagnosis"),
    ):
        done = irt("diagnose", *words, "--same-rig")
        assert done.status == 1
        assert message in done.err
        assert len(done.err.splitlines()) == 1


@pytest.mark.slow
def test_without_stamps_nothing_is_in_seconds(irt, lab, tmp_path):
    done = irt("diagnose", lab({"name": "delay", "delay_s": 0.2}, runs=3), "--out", tmp_path / "out")
    assert done.status == 0
    assert "time scale unknown" in done.out
    assert re.search(r"[Dd]elay \(delay [\d.]+ rows\)|[Ll]atency \(latency [\d.]+ rows\)", done.out)
    assert re.search(r"\d ?(s|ms)\b|seconds|/s", done.out) is None, done.out
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert answer["time_base"] == "unknown: no stamps"


@pytest.mark.slow
def test_the_same_seed_says_the_same_for_any_number_of_threads_and_after_an_interruption(
    irt, lab, tmp_path, press
):
    rig = lab(PARALLAX, runs=2, rows=40)
    words = ("diagnose", rig, "--seed", "7", "--threads")
    assert irt(*words, "1", "--out", tmp_path / "1").status == 0
    with press(after=8):
        stopped = irt(*words, "2", "--out", tmp_path / "2")
    assert stopped.status == 130
    assert "the same command resumes the diagnosis" in stopped.err
    state = tmp_path / "2" / "unfinished.jsonl"
    assert len(state.read_text().splitlines()) > 5
    again = irt(*words, "2", "--out", tmp_path / "2")
    assert f"note: resumes an interrupted diagnosis from {state}\n" in again.out
    assert not state.exists()
    answers = [json.loads((tmp_path / threads / "diagnosis.json").read_text()) for threads in ("1", "2")]
    for answer in answers:
        del answer["settings"]["seconds"]
    assert answers[0] == answers[1]


@pytest.mark.slow
def test_one_recording_is_not_proved(irt, lab, tmp_path):
    done = irt("diagnose", lab(*TWO, runs=1, rows=200), "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert "the improvement is not validated" in done.out
    assert "squared error" not in done.out
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert answer["verdict"] == "missing"
    assert answer["fit"]["final_heldout_mae"] is None
    assert answer["fit"]["final_mae"] < 0.5 * answer["fit"]["base_mae"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Not validated: there were no held-out runs." in page
    for sentence in ("fitted to the other runs", "On held-out runs", "the held-out error is"):
        assert sentence not in page


def test_a_marble_that_never_moves_is_one_clear_line(irt, write_rig, wave, tmp_path):
    still = np.zeros((40, 2)) + [0.1, -0.05] + 1e-3 * np.random.default_rng(0).standard_normal((40, 2))
    rig = write_rig({f"run-{i}": (wave, still) for i in range(3)})
    done = irt("diagnose", rig, "--out", tmp_path / "out")
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "the marble never moves" in done.err


def test_commands_that_never_change_are_one_clear_line(irt, write_rig, tmp_path):
    rig = write_rig({f"run-{index}": (np.zeros((40, 2)), np.full((40, 2), 0.1)) for index in range(3)})
    done = irt("diagnose", rig, "--out", tmp_path / "out")
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "no command ever changes" in done.err


def test_what_an_interruption_left_of_another_seed_is_not_used(irt, lab, tmp_path, press):
    words = ("diagnose", lab(PARALLAX, runs=2, rows=40), "--out", tmp_path / "out", "--seed")
    with press():
        assert irt(*words, "0").status == 130
        (state,) = (tmp_path / "out").iterdir()
        done = irt(*words, "1")
    assert (done.status, list((tmp_path / "out").iterdir())) == (130, [state])
    assert f"note: {state} is of another seed: the diagnosis starts over\n" in done.out


def test_no_rig_is_one_clear_line(irt, tmp_path):
    done = irt("diagnose", tmp_path / "none")
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "no such folder" in done.err


@pytest.fixture
def several(write_rig):
    """Return two small rigs of which nothing is missing."""
    random = np.random.default_rng(3)
    folders = []
    for name in ("monday", "tuesday"):
        runs = {}
        for index in range(2):
            knobs = 0.05 * np.sin(2 * np.pi * np.arange(40)[:, None] / random.uniform(15.0, 40.0, 2))
            marble = rollouts(TRUTH, knobs)[0]
            runs[f"run-{index}"] = knobs, marble + 1e-3 * random.standard_normal(marble.shape)
        folders.append(write_rig(runs, folder=name))
    return folders


@pytest.mark.slow
def test_several_rigs_get_a_folder_and_a_line_each_and_what_is_done_stays(irt, several, tmp_path):
    out = tmp_path / "out"
    words = ("diagnose", *several, "--out", out, "--jobs", "2")
    done = irt(*words)
    assert (done.status, done.err) == (0, "")
    for name in ("monday", "tuesday"):
        answer = json.loads((out / name / "diagnosis.json").read_text())
        assert answer["verdict"] == "sufficient"
        assert any(line.startswith(name) and "sufficient" in line for line in done.out.splitlines())
        assert f"{name}: no missing physics detected" in (out / name / "report.html").read_text()
        assert str(several[0].parent / name) in answer["settings"]["rig"]
    alone = irt("diagnose", several[0], "--out", tmp_path / "alone", "--threads", "1")
    assert alone.status == 0
    assert (tmp_path / "alone/model.toml").read_bytes() == (out / "monday/model.toml").read_bytes()
    before = {path: path.stat().st_mtime_ns for path in out.glob("*day/diagnosis.json")}
    (several[1] / "run-1.csv").unlink()
    assert irt(*words).status == 0
    changed = {path.parent.name for path, time in before.items() if path.stat().st_mtime_ns != time}
    assert changed == {"tuesday"}
    assert json.loads((out / "tuesday/diagnosis.json").read_text())["settings"]["recordings"] == 1


def test_rigs_of_one_name_would_share_a_folder(irt, several, tmp_path):
    twin = tmp_path / "other" / "monday"
    shutil.copytree(several[0], twin)
    done = irt("diagnose", several[0], twin)
    assert done.status == 1
    assert "have the same name" in done.err


def test_a_broken_file_is_known_before_the_first_diagnosis(irt, several, tmp_path):
    (several[1] / "run-0.csv").write_text("step\n")
    done = irt("diagnose", *several, "--out", tmp_path / "out")
    assert done.status == 1
    assert f"{several[1] / 'run-0.csv'}" in done.err
    assert not (tmp_path / "out").exists()
