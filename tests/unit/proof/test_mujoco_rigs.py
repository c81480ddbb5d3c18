"""The concealed world in MuJoCo: the same hidden physics as in PyBullet, and rebounds of its own."""

from __future__ import annotations

import dataclasses
import io
import json
from pathlib import Path

import numpy as np
import pytest

import irt
from irt.proof.pybullet_world import drives
from irt.proof.pybullet_world import spec as specs
from irt.proof.pybullet_world.__main__ import THIRDS, serve
from irt.proof.pybullet_world.effects import EFFECTS
from irt.proof.pybullet_world.engine import Base, Engine
from irt.proof.pybullet_world.in_mujoco import MUJOCO
from irt.proof.pybullet_world.in_pybullet import PYBULLET
from irt.proof.pybullet_world.out_of_catalogue import BEYOND
from irt.proof.pybullet_world.physics import EDGE_X_M, RADIUS_M, Physics
from irt.proof.pybullet_world.played import play
from irt.proof.pybullet_world.spec import Spec, draw, physics_of

pytest.importorskip("pybullet", reason="PyBullet has wheels up to Python 3.11 only: pip install pybullet")
pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")

BASE = Base(0.07, 0.06, 5e-4, 16.0, 1.03)
#: Where marbles reach no rim.
ROWS = 45
#: Differences of engines away from rims [board edges]: 0.03 mm, and 0.14 mm where one turns its board.
NEAR, TURNING = 1e-4, 5e-4


def drive() -> np.ndarray:
    """Commands (ROWS, 2) [rad] that lead a marble to and fro."""
    time = np.arange(ROWS)[:, None] / ROWS
    return 0.12 * np.sin(2.0 * np.pi * time * [2.0, 3.0] + [0.0, 0.5]) * np.minimum(1.0, 6.0 * time)


def seen_in(engine: Engine, *hidden: Physics) -> np.ndarray:
    return play(BASE, drive(), (0.02, -0.01), hidden, np.random.default_rng(0), engine=engine).seen


@pytest.fixture(scope="module")
def plain() -> dict[str, np.ndarray]:
    """Where the marble is seen without hidden physics, (ROWS, 2), by engine."""
    return {"pybullet": seen_in(PYBULLET), "mujoco": seen_in(MUJOCO)}


def test_a_plate_of_mujoco_adds_the_inertial_forces_of_its_turns(plain: dict[str, np.ndarray]) -> None:
    """It takes an angle within 50 ms: a time constant of 1/60 s has the same effect."""
    inertia = [{"name": "inertial_forces", "rate_per_s": 60.0}]
    still, turning = (
        irt.rollouts([[*dataclasses.astuple(BASE)]], drive(), start=plain["mujoco"][0], effects=effects)[0]
        for effects in ([], inertia)
    )
    assert np.ptp(still, axis=0).min() > 0.02
    assert np.abs(plain["pybullet"] - still).max() < 2.0 * NEAR
    missed = np.abs(plain["mujoco"] - still).max()
    assert missed > 2.0 * TURNING
    assert np.abs(plain["mujoco"] - turning).max() < 0.3 * missed


@pytest.mark.parametrize("kind", [*EFFECTS, *BEYOND], ids=lambda kind: kind.name)
def test_hidden_physics_does_the_same_in_both(kind: type[Physics], plain: dict[str, np.ndarray]) -> None:
    hidden = kind.draw(np.random.default_rng(3), 0.7)
    one, other = seen_in(PYBULLET, hidden) - plain["pybullet"], seen_in(MUJOCO, hidden) - plain["mujoco"]
    assert np.abs(one - other).mean() < TURNING + 0.1 * np.abs(one).mean()


@pytest.mark.parametrize("increase", [0.0, 0.6])
def test_a_rim_returns_the_part_of_the_speed_that_it_should(increase: float) -> None:
    commands = np.tile([0.0, 0.12], (40, 1))
    commands[0] = 0.0
    hidden = physics_of([{"name": "wall_restitution", "increase": increase}]) if increase else ()
    path = play(BASE, commands, (0.08, 0.0), hidden, engine=MUJOCO).seen[:, 0] * EDGE_X_M / 1.03
    reach = EDGE_X_M / 2.0 - RADIUS_M
    assert path.max() == pytest.approx(reach, abs=1e-3)
    hit = int(np.argmax(path > reach - 2e-3))
    back = reach - path[hit + 1 : hit + 12].min()
    # A marble that is thrown back with half its speed comes back a quarter of the way.
    assert (back > 4e-3) == bool(increase)


@pytest.mark.parametrize("engine", [PYBULLET, MUJOCO], ids=["pybullet", "mujoco"])
def test_a_sticky_rim_holds_what_leans_on_it_up_to_its_hold(engine: Engine) -> None:
    press, rest = np.tile([0.0, 0.05], (30, 1)), np.tile([0.0, -0.03], (30, 1))
    # 0.06 x 0.03 rad of tilt pull by 0.018 m/s^2 away from the rim. A board that turns at once throws off.
    slowly = np.linspace(press[-1], rest[0], 17)
    reach, ends = EDGE_X_M / 2.0 - RADIUS_M, []
    for hold in (0.0, 0.01, 0.03):
        hidden = physics_of([{"name": "sticky_rim", "hold_m_per_s2": hold}]) if hold else ()
        path = play(BASE, np.vstack([press, slowly, rest]), (0.1, 0.0), hidden, engine=engine).seen[:, 0]
        ends.append(reach - path[-1] * EDGE_X_M / BASE.observation_scale)
    # What it holds back is missing until the marble has left the rim.
    assert ends[0] > 1.4 * ends[1] > 2e-3
    assert ends[2] < 5e-4


@pytest.mark.parametrize("engine", [PYBULLET, MUJOCO], ids=["pybullet", "mujoco"])
def test_a_rim_of_felt_drags_on_what_rolls_along_it(engine: Engine) -> None:
    commands = np.tile([-0.03, 0.05], (45, 1))
    ways = []
    for hidden in ((), physics_of([{"name": "felt_rim", "rate_per_s": 7.0}])):
        path = play(BASE, commands, (0.12, -0.05), hidden, engine=engine).seen[:, 1]
        ways.append(path[25] - path[15])
    assert ways[1] < 0.8 * ways[0]


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_a_controller_leads_the_marble_by_what_it_sees(engine: str) -> None:
    late = [{"name": "latency", "latency_s": 0.05}, {"name": "delay_jitter", "sd_s": 0.05}]
    spec = Spec(
        "rig", 5, 0.07, 0.06, 5e-4, 16.0, 1.03, tuple(late), sigma=1e-3, drive="controller", engine=engine
    )
    one, again = (spec.play(2) for _ in range(2))
    np.testing.assert_array_equal(one.commands, again.commands)
    assert (one.commands[0] == 0.0).all()
    assert 0.1 < np.abs(one.commands).max() <= drives.MOST_RAD
    assert (np.abs(np.diff(one.commands, axis=0)) > 0.01).mean() > 0.2
    assert np.ptp(one.seen, axis=0).min() > 0.1
    # Its commands, played back, give the same run, so that nothing was issued before it was known.
    recorded = play(
        spec.base,
        one.commands,
        spec.excitation(2)[1],
        spec.hidden,
        spec.random(2, 1),
        engine=specs.ENGINES[engine],
    )
    np.testing.assert_array_equal(recorded.seen, one.seen)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_rig_in_mujoco() -> None:
    one, other = (
        draw(np.random.default_rng(4), "single", physics=["lag"], engine="mujoco") for _ in range(2)
    )
    assert one == other
    np.testing.assert_array_equal(one.play(0).seen, other.play(0).seen)
    with pytest.raises(ValueError, match="an engine is one of pybullet, mujoco, not 'bullet'"):
        draw(np.random.default_rng(4), "none", engine="bullet")


def test_rigs_take_turns_at_the_worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict] = []
    monkeypatch.setattr(
        "irt.proof.pybullet_world.__main__._answered", lambda _, request: asked.append(request) or {}
    )
    lines = [json.dumps({"make": {"index": index, "seed": 1, "kind": "none"}}) for index in range(6)]
    serve(lines, io.StringIO(), "module:track", thirds=True)
    assert [one.get("engine", "camera") for one in asked] == [*THIRDS, *THIRDS]
    assert [one.get("tracker") for one in asked] == [None, None, "module:track"] * 2


@pytest.mark.slow
def test_a_label_names_its_engine(tmp_path: Path) -> None:
    answers = io.StringIO()
    asked = {"index": 1, "kind": "none", "seed": 3, "folder": f"{tmp_path / 'rig'}"}
    serve([json.dumps({"make": asked})], answers, "module:track", thirds=True)
    label = json.loads(answers.getvalue())["label"]
    assert (label["engine"], label["through_camera"], label["kind"]) == ("mujoco", False, "none")
    assert len(list((tmp_path / "rig").glob("train-*.csv"))) == 8
