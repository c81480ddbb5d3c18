import json

import numpy as np
import pytest
from few_trials import QUICK

from irt.errors import IrtError
from irt.paper import contenders, networks, render, tables
from irt.paper.setting import ROLLOUTS, Setting
from irt.paper.simulated import experiment1

# Both experiments, for few targets, take seconds.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def first(setting):
    return experiment1(setting, QUICK)


def test_every_method_holds_something_after_every_rollout(first):
    for name, held in first.held.items():
        assert held.parameters.shape == (6, ROLLOUTS + 1, 5), name
        assert held.mae.shape == (6, ROLLOUTS + 1), name
        scaled = first.setting.drive.scaled(held.parameters)
        assert -1e-9 <= scaled.min() <= scaled.max() <= 1.0 + 1e-9, name


@pytest.mark.parametrize("name", [name for name in QUICK if name not in ("irt", "irt-paper")])
def test_who_chooses_never_gets_worse(first, name):
    # From the first rollout on: a start may be better than what a method simulates first.
    assert (np.diff(first.held[name].mae[:, 1:], axis=1) <= 1e-12).all()


@pytest.mark.parametrize("name", ["cma-es", "es", "irt+", "irt-paper"])
def test_errors_are_those_of_what_is_held(first, name):
    held, drive = first.held[name], first.setting.drive
    for rollouts in (1, 17, 300):
        observed = drive.simulate(held.parameters[:, rollouts])[0]
        errors = np.abs(observed - first.trials.observed).mean(axis=(1, 2))
        np.testing.assert_allclose(held.mae[:, rollouts], errors, atol=1e-12)


def test_irt_plus_and_the_engine_find_the_targets(first):
    assert first.held["irt+"].mae[:, 20].max() < 0.01
    assert np.median(first.engine.mae) < 1e-4
    assert (first.engine_rollouts > 100).all()


def test_starts_are_the_same_for_all_that_take_one(first):
    for name in ("irt", "irt-paper", "cma-es", "es", "least-squares"):
        np.testing.assert_allclose(
            first.setting.drive.scaled(first.held[name].parameters[:, 0]), first.trials.start
        )


def test_what_is_there_is_not_done_again(first, monkeypatch):
    def fails(*_):
        raise AssertionError

    monkeypatch.setattr(
        contenders, "METHODS", {name: contenders.Method("", fails) for name in contenders.METHODS}
    )
    again = experiment1(first.setting, QUICK)
    np.testing.assert_array_equal(again.held["es"].mae, first.held["es"].mae)


def test_what_is_broken_is_said(setting, tmp_path):
    path = tmp_path / "x.npz"
    path.write_bytes(b"PK no archive")
    with pytest.raises(IrtError, match="delete it and run the same command again"):
        setting.kept(path, dict, of="x")


def test_what_is_of_something_else_is_made_anew(setting, tmp_path):
    path = tmp_path / "x.npz"
    setting.kept(path, lambda: {"a": np.ones(2)}, of="one")
    assert setting.kept(path, lambda: {"a": np.zeros(2)}, of="one")["a"].tolist() == [1.0, 1.0]
    assert setting.kept(path, lambda: {"a": np.zeros(2)}, of="other")["a"].tolist() == [0.0, 0.0]


def test_numbers_are_json_and_agree_with_the_table(first):
    numbers = json.loads(json.dumps(first.as_dict(), allow_nan=False))
    after = numbers["methods"]["irt+"]["after"]["5"]["state_mae"]
    assert after["mean"] == pytest.approx(first.held["irt+"].mae[:, 5].mean())
    lines = list(tables.of_methods(first))
    (row,) = [line for line in lines if line.startswith("| IRT+ |")][:1]
    assert f"({100 * after['median']:.3f}; " in row
    assert numbers["methods"]["irt+"]["pretraining_rollouts"] > 1_000_000


def test_variants_keep_their_results_apart(setting):
    folders = {
        Setting(setting.out, literal=literal, damped=damped).folder("x")
        for literal in (False, True)
        for damped in (False, True)
    }
    assert len(folders) == 4


@pytest.mark.parametrize("name", render.OF_FIRST)
def test_figures_are_small_files(first, tmp_path, name):
    render.OF_FIRST[name](tmp_path, first)
    files = list(tmp_path.iterdir())
    assert files
    for file in files:
        assert file.name.startswith(name)
        assert 5_000 < file.stat().st_size < 150_000


def test_a_neural_posterior_draws_within_the_ranges(setting, monkeypatch, tmp_path):
    pytest.importorskip("sbi", reason="the extra npe is not installed")
    monkeypatch.setattr(networks, "NPE_PAIRS", 400)
    monkeypatch.setattr(networks, "NPE_EPOCHS", 2)
    small = Setting(tmp_path, targets=2, threads=1)
    trials = contenders.Trials(
        small.drive.simulate(small.drive.parameters(np.full((2, 5), 0.4)))[0], np.full((2, 5), 0.5)
    )
    held = contenders.neural_posterior(small, trials, None)
    again = contenders.neural_posterior(small, trials, None)
    np.testing.assert_array_equal(held.mae, again.mae)
    assert (np.diff(held.mae[:, 1:], axis=1) <= 0.0).all()
