"""`irt tune` as a user runs it."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from irt.cli.demo import data
from irt.engine import paper_drive, rollouts
from irt.methods import METHODS
from irt.model import load_model
from irt.residual import evaluate
from irt.rig import PARAMETERS, load_rig
from irt.tuning import cache
from irt.tuning import pretrain as training

TRUTH = np.array([[0.06, 0.04, 3e-4, 20.0, 1.1]])


@pytest.fixture(autouse=True)
def cache_folder(tmp_path, monkeypatch):
    """Keep the user's own cache out of the tests."""
    monkeypatch.setenv("IRT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def quick(monkeypatch):
    """Train for a second only."""

    def short(options):
        return replace(options["recipe"], pairs=60, epochs=12, batch=20)

    train = training.pretrain
    monkeypatch.setattr(
        training,
        "pretrain",
        lambda drive, path, **options: train(drive, path, **{**options, "recipe": short(options)}),
    )


@pytest.fixture
def paper_rig(write_rig):
    marble = rollouts(TRUTH, paper_drive())[0]
    noise = 0.001 * np.random.default_rng(0).standard_normal(marble.shape)
    return write_rig({"run-1": (paper_drive(), marble + noise), "run-2": (paper_drive(), marble - noise)})


@pytest.fixture
def other_rig(write_rig, wave):
    return write_rig({"run": (wave, rollouts(TRUTH, wave)[0])}, folder="other")


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS[:-1])
def test_it_leaves_model_numbers_and_pictures(irt, paper_rig, tmp_path, method):
    out = tmp_path / "results" / "deep"
    done = irt("tune", paper_rig, "--method", method, "--out", out, "--starts", "3")
    assert (done.status, done.err) == (0, "")
    model = load_model(out / "model.toml")
    rig = load_rig(paper_rig)
    assert evaluate(model, rig.recordings).free_run.mae < 0.01
    numbers = json.loads((out / "fit.json").read_text())
    assert numbers["method"] == method
    for name in PARAMETERS:
        fitted, kept = numbers["parameters"][name], model.parameters[name]
        assert (fitted["value"], fitted["low"], fitted["high"]) == (kept.value, kept.low, kept.high)
        assert re.search(rf"^{name} +[0-9.]+  \([0-9.]+ to [0-9.]+\)", done.out, re.MULTILINE)
    assert numbers["after"]["overall"]["free_run"]["mae"] == evaluate(model, rig.recordings).free_run.mae
    assert len(numbers["starts"]) == 3
    for picture in ("fit-untuned", "fit-tuned", f"history-{method}", f"parameters-{method}"):
        assert (out / f"{picture}.svg").is_file()
    assert f"wrote {out / 'model.toml'}, {out / 'fit.json'} and {out / 'report.html'}" in done.out


@pytest.mark.slow
def test_under_the_papers_drive_it_works_at_once(irt, paper_rig, tmp_path, cache_folder):
    done = irt("tune", paper_rig, "--method", "irt", "--out", tmp_path / "out")
    assert "training" not in done.out
    assert "The network is the shipped one for the paper's drive" in done.out
    assert not cache_folder.exists()
    before, after = re.search(r"free run +([0-9.]+) -> ([0-9.]+)", done.out).groups()
    assert float(after) < 1.0 < float(before)
    sentences = json.loads((tmp_path / "out" / "fit.json").read_text())["unidentifiable"]
    assert sentences
    assert all(f"- {sentence}" in done.out for sentence in sentences)


@pytest.mark.slow
def test_another_drive_gets_a_network_once_and_is_announced(irt, other_rig, tmp_path, cache_folder, quick):
    first = irt("tune", other_rig, "--method", "irt", "--out", tmp_path / "a")
    assert first.out.startswith("There is no network for this rig's drive yet: training one on 10000 ")
    kept = list(cache_folder.glob("*"))
    assert [path.suffix for path in kept] == [".safetensors"]
    assert f"It is kept in {kept[0]}." in first.out
    second = irt("tune", other_rig, "--method", "irt", "--out", tmp_path / "b")
    assert not second.out.startswith("There is no network")
    assert (tmp_path / "a" / "model.toml").read_bytes() == (tmp_path / "b" / "model.toml").read_bytes()


@pytest.mark.slow
def test_a_network_named_is_used(irt, other_rig, tmp_path, cache_folder):
    network = tmp_path / "net.safetensors"
    irt("pretrain", "--pairs", "50", "--epochs", "4", "--rig", other_rig, "--out", network)
    done = irt("tune", other_rig, "--method", "irt", "--network", network, "--out", tmp_path / "out")
    assert done.status == 0
    assert f"The network is {network}: trained on 50 simulated pairs" in done.out
    assert not cache_folder.exists()


def test_a_network_of_another_drive_takes_one_line(irt, other_rig, tmp_path):
    done = irt("tune", other_rig, "--method", "irt", "--network", cache.SHIPPED, "--out", tmp_path / "out")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert "trained for another drive" in done.err


def test_a_network_cut_short_takes_one_line(irt, paper_rig, tmp_path):
    network = tmp_path / "net.safetensors"
    network.write_bytes(cache.SHIPPED.read_bytes()[:5000])
    done = irt("tune", paper_rig, "--method", "irt", "--network", network, "--out", tmp_path / "out")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert done.err.startswith(f"irt: {network}: cut short")


@pytest.mark.parametrize(
    ("method", "option", "whose"),
    [
        ("least-squares", "--iterations", "irt"),
        ("least-squares", "--network", "irt+ or irt or direct"),
        ("irt", "--rollouts", "irt+ or cma-es or es"),
        ("direct", "--starts", "least-squares or irt+ or irt or cma-es or es"),
    ],
)
def test_options_belong_to_methods(irt, paper_rig, method, option, whose):
    done = irt("tune", paper_rig, "--method", method, option, "3")
    assert done.status == 1
    assert done.err == f"irt: {option} belongs to --method {whose}; leave it out\n"


@pytest.mark.slow
@pytest.mark.parametrize("method", ["irt+", "cma-es", "es"])
def test_methods_take_no_more_rollouts_than_they_are_given(irt, paper_rig, tmp_path, method):
    words = ("--method", method, "--rollouts", "12", "--starts", "2", "--out", tmp_path / "out")
    assert irt("tune", paper_rig, *words).status == 0
    numbers = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert [len(history) for history in numbers["starts"]] == [12, 12]
    assert numbers["rollouts"] == 2 * 12 * 2


@pytest.mark.slow
def test_direct_prediction_asks_a_network_of_its_own_once(irt, paper_rig, tmp_path, cache_folder, quick):
    first = irt("tune", paper_rig, "--method", "direct", "--out", tmp_path / "a")
    assert first.out.startswith("There is no network for this rig's drive yet")
    assert [path.name[:7] for path in cache_folder.glob("*")] == ["direct-"]
    second = irt("tune", paper_rig, "--method", "direct", "--out", tmp_path / "b")
    assert not second.out.startswith("There is no network")
    numbers = json.loads((tmp_path / "b" / "fit.json").read_text())
    assert [len(history) for history in numbers["starts"]] == [1]


def test_a_network_that_differences_came_from_predicts_nothing(irt, paper_rig, tmp_path):
    words = ("--method", "direct", "--network", cache.SHIPPED, "--out", tmp_path / "out")
    done = irt("tune", paper_rig, *words)
    assert done.status == 1
    assert "trained to estimate difference, not parameters" in done.err


@pytest.mark.parametrize(("method", "shipped"), [("irt+", cache.SHIPPED), ("irt", cache.SHIPPED_STEPS)])
def test_a_network_of_another_method_takes_one_line(irt, paper_rig, tmp_path, method, shipped):
    done = irt("tune", paper_rig, "--method", method, "--network", shipped, "--out", tmp_path / "out")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert "make one with 'irt pretrain" in done.err


@pytest.mark.slow
def test_results_go_beside_where_it_was_started(irt, paper_rig, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    irt("tune", paper_rig, "--method", "irt", "--starts", "1", "--iterations", "3")
    assert (tmp_path / "irt-tune-rig" / "model.toml").is_file()
    starts = json.loads((tmp_path / "irt-tune-rig" / "fit.json").read_text())["starts"]
    assert [len(history) for history in starts] == [4]


@pytest.mark.slow
def test_a_stopped_training_goes_on_with_the_same_command(irt, other_rig, tmp_path, monkeypatch, quick):
    run_epoch = training._Training.run_epoch

    def interrupted(self):
        if self.epoch == 6:
            raise KeyboardInterrupt
        run_epoch(self)

    with monkeypatch.context() as patch:
        patch.setattr(training._Training, "run_epoch", interrupted)
        done = irt("tune", other_rig, "--method", "irt", "--out", tmp_path / "out")
    assert done.status == 130
    assert "irt: the same command resumes the training" in done.err
    assert irt("tune", other_rig, "--method", "irt", "--out", tmp_path / "out").status == 0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_model(irt, tmp_path):
    for name, seed, threads in (("a", "4", "1"), ("b", "4", "2"), ("c", "5", "1")):
        words = ("--method", "irt", "--seed", seed, "--threads", threads, "--starts", "2")
        words += ("--iterations", "5", "--out", tmp_path / name)
        assert irt("tune", data("labyrinth"), *words).status == 0
    a, b, c = ((tmp_path / name / "model.toml").read_bytes() for name in "abc")
    assert a == b
    assert a != c
