"""Rigs of the concealed world: drawn, simulated, written, labelled; the same seed gives the same bytes."""

from __future__ import annotations

import ast
import dataclasses
import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from irt.proof import pybullet_world
from irt.proof.pybullet_world import drives, noise
from irt.proof.pybullet_world import spec as specs
from irt.proof.pybullet_world.__main__ import _is_watched, further, make, serve
from irt.proof.pybullet_world.effects import EFFECTS
from irt.proof.pybullet_world.out_of_catalogue import BEYOND
from irt.proof.pybullet_world.physics import EDGE_X_M, EDGE_Y_M, RADIUS_M
from irt.proof.pybullet_world.played import play
from irt.proof.pybullet_world.record import Recorded, record
from irt.proof.pybullet_world.spec import Spec, draw, physics_of
from irt.recording import load_recording
from irt.rig import load_rig

pytest.importorskip("pybullet", reason="PyBullet has wheels up to Python 3.11 only: pip install pybullet")

FOLDER = Path(pybullet_world.__file__).parent
LAG = {"name": "lag", "time_constant_s": 0.3}


def spec_with(**changes: object) -> Spec:
    plain = Spec("rig-000", 5, 0.07, 0.06, 5e-4, 14.0, 1.03, noise="heavy", sigma=0.002)
    return dataclasses.replace(plain, **changes)


@pytest.fixture(scope="module")
def recorded() -> Recorded:
    return record(spec_with(effects=(LAG,)))


@pytest.fixture(scope="module")
def plain() -> np.ndarray:
    """Where the marble is seen in 80 rows without hidden physics, (80, 2)."""
    spec = spec_with()
    commands, start = spec.excitation(0)
    return play(spec.base, commands[:80], start).seen


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.stem)
def test_world_imports_nothing_of_what_it_examines(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert not [one.name for one in node.names if one.name.split(".")[0] == "irt"]
        if isinstance(node, ast.ImportFrom):
            up = len(path.relative_to(FOLDER).parts)
            assert node.level <= up, "a relative import leaves the package"
            assert node.level or (node.module or "").split(".")[0] != "irt"


@pytest.mark.parametrize("kind", drives.DRIVES)
def test_drives_keep_within_what_a_servo_turns(kind: str) -> None:
    both = []
    for seed in range(20):
        commands = drives.drive(kind, np.random.default_rng(seed), (0.07, 0.05), 0.08)
        assert commands.shape == (drives.ROWS, 2)
        assert np.abs(commands).max() <= drives.MOST_RAD
        assert (commands[0] == 0.0).all()
        np.testing.assert_array_equal(commands, commands.round(6))
        both.append((commands != 0.0).any(axis=0))
    assert np.all(both) != (kind == "single")


def test_marbles_lie_within_the_rim_and_use_the_board() -> None:
    room = np.array([EDGE_X_M, EDGE_Y_M]) / 2 - RADIUS_M
    spec = spec_with()
    starts = np.array([spec.excitation(run)[1] for run in range(12)])
    assert (np.abs(starts) < room).all()
    assert 1 <= (starts == 0.0).all(axis=1).sum() < 12
    moved = np.array([np.ptp(spec.play(run).places, axis=0) for run in range(4)])
    assert (moved.max(axis=0) > 0.25 * room).all()


@pytest.mark.parametrize("kind", noise.KINDS)
def test_noise_is_as_large_as_it_says(kind: str) -> None:
    drawn = noise.noise(kind, 40_000, np.random.default_rng(1))
    assert drawn.std() == pytest.approx(1.0, abs=0.03)
    carried = np.mean(drawn[1:] * drawn[:-1])
    tails = np.mean(np.abs(drawn) > 4.0)
    assert (carried > 0.5) == (kind == "coloured")
    assert (tails > 1e-3) == (kind == "heavy")


def test_noise_has_the_size_of_a_tracker() -> None:
    sizes = np.array([noise.size(np.random.default_rng(seed)) for seed in range(300)]) * EDGE_X_M * 1000
    assert 0.2 <= sizes.min() < 0.25
    assert 1.7 < sizes.max() <= 2.0
    assert np.median(sizes) == pytest.approx(np.sqrt(0.2 * 2.0), rel=0.2)


@pytest.mark.parametrize("kind", [one.name for one in BEYOND])
def test_physics_beyond_the_catalogue_moves_the_marble_and_repeats(kind: str, plain: np.ndarray) -> None:
    one = next(one for one in BEYOND if one.name == kind)
    spec = spec_with(out_of_catalogue=one.draw(np.random.default_rng(1), 1.0).parameters())
    commands, start = spec.excitation(0)
    first, again, other = (
        play(spec.base, commands[:80], start, spec.hidden, np.random.default_rng(seed)).seen
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, other)
    assert np.abs(first - plain).mean() > 0.002


def test_beyond_is_another_list() -> None:
    assert len(BEYOND) >= 6
    assert not {one.name for one in BEYOND} & {one.name for one in EFFECTS}


@pytest.mark.parametrize("one", [*EFFECTS, *BEYOND], ids=lambda one: one.name)
def test_draws_go_from_small_to_large_and_are_made_again(one: type) -> None:
    small, large = (one.draw(np.random.default_rng(3), strength) for strength in (0.0, 1.0))
    assert small != large
    assert physics_of([json.loads(json.dumps(large.parameters()))]) == (large,)


def test_order_of_effects_does_not_matter() -> None:
    bias = {"name": "tilt_bias", "bias_x_rad": 0.001, "bias_y_rad": 0.0}
    one, other = (spec_with(effects=effects).play(0).seen for effects in ((LAG, bias), (bias, LAG)))
    np.testing.assert_array_equal(one, other)


def test_unknown_physics_is_refused() -> None:
    with pytest.raises(ValueError, match="'lagg' is no physics of this world: one of delay, "):
        physics_of([{"name": "lagg"}])
    with pytest.raises(ValueError, match="lag: "):
        physics_of([{"name": "lag", "time_s": 1.0}])
    with pytest.raises(ValueError, match="a kind of rig is one of none, "):
        draw(np.random.default_rng(1), "quadruple")
    with pytest.raises(ValueError, match="pair: 2 of delay, "):
        draw(np.random.default_rng(1), "pair", physics=["lag"])


@pytest.mark.slow
def test_same_spec_gives_the_same_bytes(recorded: Recorded) -> None:
    again = record(recorded.spec)
    assert json.dumps(again.label()) == json.dumps(recorded.label())
    assert [again.text(run) for run in range(12)] == [recorded.text(run) for run in range(12)]


def test_folder_holds_the_training_runs_and_no_hint(recorded: Recorded, tmp_path: Path) -> None:
    recorded.write(tmp_path)
    trains = [f"train-{number}.csv" for number in range(1, 9)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.toml", *trains]
    rig = load_rig(tmp_path)
    assert [len(one.marble) for one in rig.recordings] == [120] * 8
    np.testing.assert_allclose(rig.recordings[0].marble, recorded.seen[0], atol=1e-6)
    np.testing.assert_array_equal(rig.recordings[0].knobs, recorded.commands[0])
    text = "".join(path.read_text() for path in tmp_path.iterdir())
    assert not any(word in text for word in ("lag", "bullet", "effect", "seed"))


def test_label_is_complete(recorded: Recorded, tmp_path: Path) -> None:
    label = json.loads(json.dumps(recorded.label()))
    assert label["kind"] == "lag"
    assert label["truth"] == {
        "gear_x": 0.07,
        "gear_y": 0.06,
        "rolling_friction": 5e-4,
        "time_scale": 14.0,
        "observation_scale": 1.03,
        "effects": [LAG],
        "out_of_catalogue": None,
        "outliers": 0.0,
    }
    assert (label["sigma"], label["noise"], label["through_camera"]) == (0.002, "heavy", False)
    assert label["signal"] > 3.0
    assert list(label["tests"]) == ["test-1", "test-2", "test-3", "test-4"]
    for test in label["tests"].values():
        (tmp_path / "test.csv").write_text(test["csv"])
        missed = load_recording(tmp_path / "test.csv").marble - test["clean"]
        assert missed.std() == pytest.approx(0.002, rel=0.25)


def test_labels_name_what_is_hidden() -> None:
    nap = {"name": "nap", "share": 0.5, "angle_rad": 1.0}
    delay = {"name": "delay", "delay_s": 0.1}
    cases = {
        "none": spec_with(),
        "outliers": spec_with(outliers=0.02),
        "lag": spec_with(effects=(LAG,)),
        "unlisted_nap": spec_with(out_of_catalogue=nap),
    }
    assert {name: specs_kind(spec) for name, spec in cases.items()} == {name: name for name in cases}
    assert specs_kind(spec_with(effects=(delay, LAG))) == ["delay", "lag"]


def specs_kind(spec: Spec) -> object:
    from irt.proof.pybullet_world.record import kind  # noqa: PLC0415

    return kind(spec)


def test_outliers_are_rows_that_jump() -> None:
    seen = np.zeros((4000, 2))
    jumped = (noise.outliers(seen, 0.05, np.random.default_rng(1)) != seen).any(axis=1)
    assert 0.04 < jumped.mean() < 0.06
    assert not jumped[0]


@pytest.mark.slow
def test_drawn_rigs_show_what_they_hide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(specs, "PROBES", (0,))
    for kind, names in (
        ("single", ["tilt_bias"]),
        ("pair", ["gear_asymmetry", "tilt_bias"]),
        ("triple", ["gear_asymmetry", "side_force", "tilt_bias"]),
    ):
        spec = draw(np.random.default_rng(2), kind, "rig-007", names)
        assert (spec.name, sorted(str(one["name"]) for one in spec.effects)) == ("rig-007", names)
        assert all(specs.shows(spec, one) for one in names)
        assert spec == draw(np.random.default_rng(2), kind, "rig-007", names)
    spec = draw(np.random.default_rng(2), "unlisted", physics=["swirl"])
    assert spec.out_of_catalogue is not None
    assert spec.out_of_catalogue["name"] == "swirl"
    assert json.loads(json.dumps(spec.to_json()))["out_of_catalogue"] == spec.out_of_catalogue


@pytest.mark.slow
def test_server_answers_each_request_by_a_line(tmp_path: Path) -> None:
    request = {"index": 3, "kind": "none", "folder": f"{tmp_path / 'rig-003'}", "seed": 7}
    lines = [json.dumps({"make": request}), json.dumps({"make": {**request, "kind": "odd"}}), "[", "{}"]
    ran = subprocess.run(
        [sys.executable, "-m", "irt.proof.pybullet_world"],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        check=True,
    )
    made_, *refused = [json.loads(line) for line in ran.stdout.splitlines()]
    assert made_["made"] == "rig-003"
    assert made_["label"]["kind"] == "none"
    assert len(list((tmp_path / "rig-003").glob("train-*.csv"))) == 8
    assert [list(one) for one in refused] == [["error"]] * 3
    assert "odd" in refused[0]["error"]


@pytest.mark.slow
def test_a_further_run_is_recorded_by_the_same_physics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(specs, "PROBES", (0,))
    asked = {"index": 2, "kind": "single", "seed": 11, "physics": ["viscous_drag"]}
    _, label = make(**asked, folder=str(tmp_path))
    csv = (tmp_path / "train-2.csv").read_text()
    rerun = further(**asked, csv=csv)
    before, again = (np.genfromtxt(one.splitlines(), delimiter=",", skip_header=1) for one in (csv, rerun))
    assert (before[:, :3] == again[:, :3]).all()
    assert (before[:, 3:] != again[:, 3:]).any()
    # The start is read off row 0, noise and all, and the noise is drawn anew.
    assert np.median(np.abs(before - again)[:, 3:]) < 4.0 * label["sigma"]
    assert further(**asked, csv=csv) == rerun
    with pytest.raises(ValueError, match="a command in every row"):
        further(**asked, csv=csv.replace(csv.splitlines()[5], "4,,,0.1,0.1"))


def test_a_share_of_rigs_is_seen_through_a_camera() -> None:
    watched = [_is_watched({"seed": 3, "index": index}, 0.15) for index in range(1000)]
    assert 110 < sum(watched) < 190
    assert not any(_is_watched({"seed": 3, "index": index}, 0.0) for index in range(100))


def test_nothing_of_a_failed_rig_stops_the_server() -> None:
    answers = io.StringIO()
    serve(["", '{"make": {"index": 1}}'], answers)
    (answer,) = answers.getvalue().splitlines()
    assert json.loads(answer)["error"].startswith("TypeError: ")
