"""What other methods answer where the right answer is known."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from irt.catalogue import effect
from irt.engine import rollouts
from irt.model import Model
from irt.proof import contest
from irt.proof.baselines import alone, gaussian, neural, sindy, single, sysid, whiteness
from irt.proof.baselines.entry import Entry, Task
from irt.proof.run import commands_alone
from irt.recording import Recording, load_recording
from irt.rig import RANGES, Board, Marble, Rig

VALUES = (0.06, 0.05, 1e-4, 15.0, 1.0)
NOISE = 2e-4


def runs(effects: list[dict], count: int, seed: int, rows: int = 80) -> list[Recording]:
    random = np.random.default_rng(seed)
    found = []
    for index in range(count):
        time = np.arange(rows)[:, None, None] / rows
        waves = np.sin(2 * np.pi * (time * random.uniform(0.7, 4.0, (2, 3)) + random.random((2, 3))))
        knobs = (waves * random.uniform(0.01, 0.03, (2, 3))).sum(axis=2)
        marble = rollouts([VALUES], knobs, effects=effects, time_step="continuous")[0]
        marble = marble + NOISE * random.standard_normal(marble.shape)
        found.append(Recording(f"run-{index}", Path(f"run-{index}.csv"), knobs, marble))
    return found


def task(*effects: dict, count: int = 6, rows: int = 80) -> tuple[Task, list[Recording]]:
    """Return a task whose base model is right but for the effects, and the tests as they went."""
    recordings = tuple(runs(list(effects), count, 1, rows))
    rig = Rig(Path("rig"), Board(), Marble(), "rest", dict(RANGES), recordings)
    tests = runs(list(effects), 2, 2, rows)
    base = Model.from_rig(rig, VALUES, time_step="continuous")
    blank = []
    for test in tests:
        marble = np.full_like(test.marble, np.nan)
        marble[0] = test.marble[0]
        blank.append(Recording(test.name, test.path, test.knobs, marble))
    return Task(rig, base, tuple(blank)), tests


def error(entry: Entry, tests: list[Recording]) -> float:
    return float(np.mean([np.abs(entry.predictions[test.name] - test.marble).mean() for test in tests]))


@pytest.fixture(scope="module")
def warped() -> tuple[Task, list[Recording]]:
    parameters = effect("board_warp").parameters
    return task({"name": "board_warp", **{one.name: 0.3 * one.high for one in parameters}})


def test_a_gaussian_process_learns_a_bowl(warped) -> None:
    given, tests = warped
    assert error(gaussian.enter(given), tests) < 0.7 * error(alone.enter(given), tests)


@pytest.mark.slow
def test_a_gaussian_process_leaves_a_right_model_alone() -> None:
    given, tests = task()
    assert error(gaussian.enter(given), tests) < 3.0 * error(alone.enter(given), tests)


def test_the_base_alone_names_nothing(warped) -> None:
    entry = alone.enter(warped[0])
    assert (entry.detected, entry.named) == (False, ())


def test_pysindy_finds_the_drag() -> None:
    pytest.importorskip("pysindy", reason="the extra prove is not installed")
    given, _ = task({"name": "viscous_drag", "rate_per_s": 1.5})
    entry = sindy.enter(given)
    assert (entry.detected, entry.named) == (True, ("viscous_drag",))
    assert {name: path.shape for name, path in entry.predictions.items()} == {
        "run-0": (80, 2),
        "run-1": (80, 2),
    }


def test_pysindy_that_is_not_there_says_so(monkeypatch: pytest.MonkeyPatch, warped) -> None:
    monkeypatch.setitem(sys.modules, "pysindy", None)
    assert sindy.enter(warped[0]).missing == "pysindy is not installed"


@pytest.mark.slow
def test_a_network_learns_a_bowl(warped) -> None:
    given, tests = warped
    entry = neural.enter(given)
    assert (entry.detected, entry.named) == (None, None)
    assert error(entry, tests) < 0.7 * error(alone.enter(given), tests)


@pytest.mark.slow
def test_a_network_leaves_a_right_model_alone() -> None:
    given, tests = task(count=4, rows=50)
    assert error(neural.enter(given), tests) < 1.5 * error(alone.enter(given), tests)


def test_the_gradient_through_a_rollout_is_that_of_differences(warped) -> None:
    """As far as the direction of friction, which follows the marble, is left out."""
    given, _ = warped
    batch = neural.Batch.windows(given, given.rig.recordings[:2])
    assert batch is not None
    random = np.random.default_rng(0)
    network = neural.Network.started(batch.inputs(), batch.acceleration, random)
    weights = network.weights + 0.03 * random.standard_normal(network.weights.shape)
    along, step = random.standard_normal(weights.shape), 1e-5
    ahead, behind = (
        batch.error(network.with_weights(weights + sign * step * along), 0.01) for sign in (1.0, -1.0)
    )
    _, slopes = batch.gradient(network.with_weights(weights), 0.01)
    assert slopes @ along == pytest.approx((ahead - behind) / (2.0 * step), rel=0.1)


@pytest.mark.slow
def test_sysid_recovers_a_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    if not sysid.is_there():
        pytest.skip("the extra prove is not installed")
    given, tests = task({"name": "delay", "delay_s": 0.1}, count=4, rows=60)
    found = sysid.fitted(given)
    values = dict(zip((one.name for one in sysid.QUANTITIES), found, strict=True))
    assert values["delay_s"] + values["lag_s"] == pytest.approx(0.1, rel=0.1)
    # Off the rim only the product of gain and scale shows.
    assert values["gain_x"] * values["scale"] == pytest.approx(VALUES[0] * VALUES[4], rel=0.05)
    monkeypatch.setattr(sysid, "fitted", lambda _: found)
    assert error(sysid.enter(given), tests) < 0.3 * error(alone.enter(given), tests)


def test_commands_late_by_half_a_row_are_means_over_steps() -> None:
    commands = np.array([[1.0, 0.0], [3.0, 2.0], [3.0, 2.0]])
    times, late = sysid.delayed(np.array([0.0, 0.2, 0.4]), commands, 0.05, 0.1)
    assert times == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    # A step is about its time: the first is half before row 0, and half of it is over before the command.
    assert late == pytest.approx(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [3.0, 2.0], [3.0, 2.0]]))


def test_sysid_that_is_not_there_says_so(monkeypatch: pytest.MonkeyPatch, warped) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.sysid", None)
    assert sysid.enter(warped[0]).missing == "mujoco.sysid is not installed"


def test_residual_tests_distinguish_noise_from_a_bowl(warped) -> None:
    assert whiteness.enter(warped[0]).detected is True
    random = np.random.default_rng(0)
    knobs = [random.standard_normal((100, 2)) for _ in range(4)]
    noise = [random.standard_normal((100, 2)) for _ in range(4)]
    assert whiteness.white(noise) > 0.05
    assert whiteness.unrelated(noise, knobs) > 0.05
    late = [one + 0.5 * np.roll(knob, 3, axis=0) for one, knob in zip(noise, knobs, strict=True)]
    assert whiteness.unrelated(late, knobs) < 1e-6
    assert whiteness.white([np.cumsum(one, axis=0) for one in noise]) < 1e-6


def test_the_textbook_levels_hold() -> None:
    random = np.random.default_rng(1)
    knobs = [np.cumsum(random.standard_normal((60, 2)), axis=0) for _ in range(4)]
    values = [
        (whiteness.white(noise), whiteness.unrelated(noise, knobs))
        for noise in (random.standard_normal((4, 60, 2)) for _ in range(200))
    ]
    share = (np.array([(a, b) for a, b in values]) < 0.05).mean(axis=0)
    assert ((share > 0.005) & (share < 0.12)).all()


def test_the_best_single_effect_is_the_one_that_fits_best(monkeypatch: pytest.MonkeyPatch) -> None:
    given, tests = task({"name": "viscous_drag", "rate_per_s": 1.5})
    few = [effect(name) for name in ("viscous_drag", "tilt_bias", "parallax")]
    monkeypatch.setattr(single, "hypothetical", lambda: few)
    entry = single.enter(given)
    assert (entry.detected, entry.named) == (True, ("viscous_drag",))
    assert error(entry, tests) < 3.0 * NOISE


def test_methods_see_commands_and_a_start(tmp_path: Path) -> None:
    test = runs([], 1, 3, rows=20)[0]
    for start, rows in (("rest", 1), ("moving", 4)):
        path = tmp_path / f"{start}.csv"
        path.write_text(commands_alone(test, start))
        left = load_recording(path)
        assert np.flatnonzero(left.seen).tolist() == list(range(rows))
        assert np.array_equal(left.knobs, test.knobs)


def test_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, places) -> None:
    folder, out = tmp_path / "rig", tmp_path / "out"
    for path in (folder, folder / "tests", out):
        path.mkdir()
    for path in places.rig("rig-0001").iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    test = load_recording(places.opened("rig-0001") / "test-1.csv")
    (folder / "tests" / "test-1.csv").write_text(commands_alone(test, "rest"))
    quick = {name: contest.METHODS[name] for name in ("alone", "whiteness")}

    def broken(_: Task) -> Entry:
        raise ValueError("no such luck")

    monkeypatch.setattr(contest, "METHODS", {**quick, "broken": ("broken", broken)})
    assert contest.main([str(folder), str(out)]) == 0
    content = json.loads((out / "baselines.json").read_text())
    assert sorted(content) == ["alone", "broken", "whiteness"]
    assert len(content["alone"]["predictions"]["test-1"]) == len(test.knobs)
    assert content["broken"]["missing"] == "broke down: no such luck"
    assert content["whiteness"]["predictions"] == {}


def test_no_rig_is_one_line(tmp_path: Path, capsys) -> None:
    assert contest.main([str(tmp_path / "none"), str(tmp_path)]) == 1
    assert "no such folder" in capsys.readouterr().err
