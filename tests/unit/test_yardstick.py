"""Rigs with hidden effects, the world of MuJoCo, and how answers are scored."""

import numpy as np
import pytest

import irt
from diagnosis import Row, compared, figures
from hide_effects import ROWS, TEST, TRAIN, Recipe, hide, recipes
from irt.proof.plan import group_of
from irt.proof.score import Errors, RigScore
from peers.workload import drive
from yardstick import table

#: How far apart two engines may be on average over a gentle run [board edges]: 0.15 mm.
NEAR = 5.4e-4
EDGE_MM = 276.0
VALUES = np.array([0.02, 0.025, 3e-4, 12.0, 1.02])
KNOBS = np.stack([drive() * scale for scale in ([0.7, 1.0], [-1.0, 0.5])])


@pytest.fixture
def mujoco_world():
    pytest.importorskip("mujoco", reason="mujoco is an optional package: labsim-irt[mujoco]")
    import mujoco_world  # noqa: PLC0415

    return mujoco_world


def simulated(world, effects):
    """Return paths (2, rows, 2) by a world and by the rolling engine, away from the rim."""
    ours = world.simulate(VALUES, KNOBS, effects, start=None, seeds=np.arange(2))
    return ours, irt.rollouts(np.tile(VALUES, (2, 1)), KNOBS, effects=effects)


def test_a_marble_of_mujoco_goes_the_rolling_engines_way(mujoco_world):
    ours, theirs = simulated(mujoco_world, [])
    assert np.abs(theirs).max() > 0.05
    assert np.abs(ours - theirs).mean() < NEAR


@pytest.mark.parametrize(
    "hidden",
    [
        {"name": "delay", "delay_s": 0.3, "y_minus_x_s": 0.1},
        {"name": "backlash", "width_x_rad": 0.05, "width_y_rad": 0.02},
        {"name": "spring_hysteresis", "strength": 0.5, "width_rad": 0.05, "jumps": 0.0},
        {"name": "clock_drift", "drift": 0.2},
        {"name": "slope_map", "slope_10": 1e-3, "slope_21": -1e-3, "slope_04": 2e-3},
        {"name": "side_force", "rate_per_s": 0.8},
        {"name": "anisotropic_friction", "ratio": 4.0, "grain_rad": 0.5},
        {"name": "latency", "latency_s": 0.2},
        {"name": "parallax", "height_m_per_rad": 0.5},
        {"name": "perspective", "slope_x": 0.3, "slope_y": -0.2, "distance_edges": 2.2},
        {"name": "camera_rotation", "angle_rad": 0.17},
    ],
    ids=lambda hidden: hidden["name"],
)  # fmt: skip
def test_an_effect_in_mujoco_is_the_catalogues(mujoco_world, hidden):
    ours, theirs = simulated(mujoco_world, [hidden])
    plain = irt.rollouts(np.tile(VALUES, (2, 1)), KNOBS)
    moves = np.abs(theirs - plain).mean()
    assert moves > NEAR
    assert np.abs(ours - theirs).mean() < min(NEAR, 0.3 * moves)


@pytest.fixture(scope="module")
def controlled_runs():
    """Noise, parameters and commands of a controller of two runs."""
    pytest.importorskip("mujoco", reason="mujoco is an optional package: labsim-irt[mujoco]")
    from controlled import commands  # noqa: PLC0415

    values = np.array([0.09, 0.07, 8e-4, 13.0, 1.0])
    noise = np.random.default_rng(1).normal(0.0, 1e-3, (2, 80, 2))
    turns, seeds = np.zeros_like(noise), np.arange(2)
    again = [
        commands(values, [], noise, turns, seeds=seeds, random=np.random.default_rng(0)) for _ in range(2)
    ]
    np.testing.assert_array_equal(*again)
    return noise, values, again[0]


def test_a_controller_moves_the_marble_to_its_targets_within_its_limits(mujoco_world, controlled_runs):
    _, values, commands = controlled_runs
    assert np.abs(commands).max() <= 0.15
    assert (np.abs(np.diff(commands, axis=1)) > 0.01).mean() > 0.2
    paths = mujoco_world.simulate(values, commands, [], start=None, seeds=np.arange(2))
    assert 0.1 < np.abs(paths).max() < 0.5


def test_inertial_forces_are_what_a_plate_of_mujoco_does_as_it_turns(mujoco_world, controlled_runs):
    """The plate takes an angle within 50 ms: a time constant of 1/60 s has the same effect."""
    _, values, commands = controlled_runs
    paths = mujoco_world.simulate(values, commands, [], start=None, seeds=np.arange(2))
    many = np.tile(values, (2, 1))
    inertia = [{"name": "inertial_forces", "rate_per_s": 60.0}]
    for engine in ("rolling", "rapier"):
        plain, turning = (irt.rollouts(many, commands, engine=engine, effects=each) for each in ([], inertia))
        assert np.abs(plain - paths).mean() > 2 * NEAR
        assert np.abs(turning - paths).mean() < 0.3 * np.abs(plain - paths).mean()


def test_a_rim_of_mujoco_returns_the_part_of_the_speed_that_it_should(mujoco_world):
    values, knobs = np.array([0.05, 0.05, 3e-4, 20.0, 1.0]), np.zeros((1, 40, 2))
    knobs[0, 1:12, 1] = 0.3
    speeds = []
    for increase in (0.0, 0.4, 0.8):
        hidden = [{"name": "wall_restitution", "increase": increase}]
        (path,) = mujoco_world.simulate(values, knobs, hidden, start=None, seeds=np.array([0]))
        assert path[:, 0].max() == pytest.approx(0.5 - 6.85 / EDGE_MM, abs=0.02)
        speeds.append(path[-10, 0] - path[-1, 0])
    assert abs(speeds[0]) < 0.1 * speeds[2]
    assert speeds[0] < speeds[1] < speeds[2]


def test_mujoco_refuses_what_it_does_not_simulate(mujoco_world):
    with pytest.raises(ValueError, match="no tilt_sensor"):
        simulated(mujoco_world, [{"name": "tilt_sensor", "zero_x_rad": 0.1}])


def test_rigs_take_turns_at_effects_and_each_number_of_them_meets_each_push():
    made = recipes(12, 0.0, Recipe(), (2, 3, 4), (0.05, 0.1))
    assert [one.effects for one in made] == [2, 3, 4] * 4
    assert {(one.effects, one.push) for one in made} == {(n, p) for n in (2, 3, 4) for p in (0.05, 0.1)}
    assert sum(one.effects == 0 for one in recipes(10, 0.3, Recipe(), (1,), (0.0,))) == 3


@pytest.mark.slow
def test_a_rig_has_its_files_its_label_and_a_push_that_is_recorded_nowhere(tmp_path):
    calm, pushed = (
        hide(tmp_path / name, Recipe(effects=2, push=push), np.random.default_rng(3))
        for name, push in (("calm", 0.0), ("pushed", 0.2))
    )
    rigs = [irt.load_rig(tmp_path / name) for name in ("calm", "pushed")]
    for rig in rigs:
        names = [one.name for one in rig.recordings]
        assert sum(name.startswith("train-") for name in names) == TRAIN
        assert sum(name.startswith("test-") for name in names) == TEST
    assert calm["kind"] == pushed["kind"] == [one["name"] for one in calm["truth"]["effects"]]
    assert list(calm["moves"]) == calm["kind"]
    assert min(calm["moves"].values()) > 3.0
    assert calm["oracle"] < calm["base"]
    for one, other in zip(*(rig.recordings for rig in rigs), strict=True):
        assert len(one.knobs) == ROWS
        np.testing.assert_array_equal(one.knobs, other.knobs)
        assert np.abs(one.marble - other.marble).mean() > calm["sigma"]


@pytest.mark.slow
def test_a_rig_under_a_controller_has_the_commands_that_it_gave_to_what_it_saw(tmp_path):
    pytest.importorskip("mujoco", reason="mujoco is an optional package: labsim-irt[mujoco]")
    recipe = Recipe("mujoco", effects=0, push=0.1, controlled=True)
    label = hide(tmp_path / "rig", recipe, np.random.default_rng(2))
    assert (label["kind"], label["push"]) == ("none", 0.1)
    rig = irt.load_rig(tmp_path / "rig")
    assert len(rig.recordings) == TRAIN + TEST
    turned = [np.abs(np.diff(one.knobs, axis=0)).max(axis=1) for one in rig.recordings]
    # No drive that is drawn beforehand changes as often.
    assert np.mean(np.concatenate(turned) > 1e-3) > 0.5
    for one in rig.recordings:
        # Towards its target: a marble far to the right is sent to the left more often than not.
        away, push = one.marble[:-2, 0] - one.marble[:, 0].mean(), one.knobs[2:, 1]
        assert np.corrcoef(away, push)[0, 1] < 0.0


@pytest.mark.parametrize(
    ("named", "right", "false"),
    [
        ({}, [], []),
        ({"lag": ["lag", "delay"]}, ["delay"], []),
        ({"lag": ["lag", "delay"], "delay": ["delay"]}, ["delay"], ["lag"]),
        # The tie could be either effect; it is the one that no other name stands for.
        ({"bump": ["bump", "delay"], "delay": ["delay"]}, ["delay", "bump"], []),
        ({"unlisted": ["unlisted"], "parallax": ["parallax"]}, [], ["parallax"]),
    ],
)
def test_a_name_stands_for_one_hidden_effect_at_most(named, right, false):
    assert compared(["delay", "bump"], named) == (right, false)


def test_what_is_left_over_may_be_named_or_not():
    named = {"stribeck": ["stribeck"], "board_warp": ["board_warp"], "delay": ["delay"]}
    assert compared(["delay"], named) == (["delay"], ["stribeck", "board_warp"])
    assert compared(["delay"], named, ["static_friction", "slope_map"]) == (["delay"], [])
    assert compared(["delay"], {"slope_map": ["slope_map"]}, ["slope_map"]) == ([], [])
    assert compared(["delay"], {"slope_map": ["slope_map"]}) == ([], ["slope_map"])


def row(kind, right=(), false=(), *, oracle=0.01, final=0.019, **others):
    named = (*right, *false)
    group, hidden = group_of({"kind": list(kind) if len(kind) > 1 else kind[0]})
    exact = set(hidden) == set(named)
    score = RigScore(
        "made-up",
        group,
        hidden,
        "missing" if named else "sufficient",
        **{
            "named": named,
            "exact": exact,
            "found": exact,
            "false_alarm": bool(named and not hidden),
            "errors": Errors(0.1, final, oracle, signal=9.0),
            "intervals": {"gear_x": "yes"},
            "seconds": 2.0,
            **others,
        },
    )
    moves = {name: 4.0 if name == "delay" else 50.0 for name in hidden}
    return Row(score, tuple(right), tuple(false), moves)


def test_figures_count_effects_named_and_names_that_are_false():
    found = figures(
        [
            row(["lag", "bump", "delay"], ["lag", "bump"], ["parallax"]),
            row(["lag", "bump", "delay"], ["lag", "bump", "delay"]),
            row(["none"], (), ["lag"]),
            row(["none"], seconds=9.0),
        ]
    )
    assert found["several at once: effects named"].split()[:3] == ["5", "of", "6"]
    assert found["several at once: named of 3 to 10 noises"].split()[:3] == ["1", "of", "2"]
    assert found["several at once: named of 30 to inf noises"].split()[:3] == ["4", "of", "4"]
    assert found["several at once: false names a rig"] == "0.50"
    assert found["false alarms"].split()[:3] == ["1", "of", "2"]
    assert found["CPU seconds a rig: median, largest"] == "2, 9"
    assert "single effects named, or in a tie" not in found
    lines = list(table({"made-up": found}, {"made-up": {"false alarms": "2 of 2"}}))
    assert any("| 2 of 2 |" in line for line in lines)


def test_a_gap_counts_only_where_the_truth_closes_one():
    lag, jitter = row(["lag"], ["lag"]), row(["delay_jitter"], ["delay_jitter"], final=0.08)
    pushed = row(["lag"], ["lag"], final=0.12, oracle=0.099)
    assert figures([lag, jitter, pushed])["gap closed: median, 10th percentile"] == "0.9, 0.9"


def test_probabilities_are_held_against_the_truth_by_decile():
    often = row(["lag", "bump"], inclusion={"lag": 0.93, "bump": 0.93})
    seldom = row(["bump"], inclusion={"lag": 0.93, "bump": 0.2})
    found = figures([often] * 9 + [seldom] * 2)
    probable = {key: value.split() for key, value in found.items() if key.startswith("inclusion")}
    assert probable.pop("inclusion, mean 0.000: true")[0] == "0"
    assert probable == {"inclusion, mean 0.930: true": ["18", "of", "20", "90", "%"]}
