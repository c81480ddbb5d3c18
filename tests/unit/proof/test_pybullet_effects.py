"""Effects of the concealed world: what they do is what the catalogue says, in sign, unit and size."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import irt
from irt.catalogue import effect, hypothetical
from irt.proof.pybullet_world.effects import EFFECTS
from irt.proof.pybullet_world.engine import Base
from irt.proof.pybullet_world.physics import EDGE_X_M, EDGE_Y_M, RADIUS_M
from irt.proof.pybullet_world.played import Played, play
from irt.proof.pybullet_world.spec import physics_of

pytest.importorskip("pybullet", reason="PyBullet has wheels up to Python 3.11 only: pip install pybullet")

BASE = Base(gear_x=0.07, gear_y=0.06, rolling_friction=6e-4, time_scale=14.0, observation_scale=1.05)
VALUES = [[*dataclasses.astuple(BASE)]]
REACH = np.array([EDGE_X_M, EDGE_Y_M]) / 2 - RADIUS_M
ROWS = 60
TIME = np.arange(ROWS) / ROWS
RAMP = np.minimum(1.0, np.arange(ROWS) / 3.0)

#: Values with another for x than for y, of either sign, so that no swap and no sign goes unseen.
CATALOGUED = {
    "delay": {"delay_s": 0.13},
    "command_quantisation": {"step_rad": 0.013},
    "dead_band": {"half_width_rad": 0.02},
    "slew_limit": {"rate_rad_per_s": 0.15},
    "lag": {"time_constant_s": 0.2},
    "backlash": {"width_x_rad": 0.05, "width_y_rad": 0.02},
    "spring_hysteresis": {"strength": 0.9, "width_rad": 0.05},
    "gear_nonlinearity": {"cubic_per_rad2": -15.0},
    "gear_asymmetry": {"asymmetry_x": 0.2, "asymmetry_y": -0.1},
    "clock_drift": {"drift": 0.15},
    "cross_coupling": {"x_from_y": 0.2, "y_from_x": -0.1},
    "tilt_bias": {"bias_x_rad": 0.0006, "bias_y_rad": -0.0009},
    "board_warp": {"curvature_xx_per_m": 0.03, "curvature_xy_per_m": -0.02, "curvature_yy_per_m": -0.01},
    "bump": {"x_m": 0.02, "y_m": -0.01, "height_m": 0.0002, "width_m": 0.03},
    "point_field": {"x_m": 0.05, "y_m": -0.06, "strength_m3_per_s2": 1e-4},
    "side_force": {"rate_per_s": 0.6},
    "stribeck": {"strength": 2.0, "speed_m_per_s": 0.02},
    "anisotropic_friction": {"ratio": 4.0, "grain_rad": 0.5},
    "friction_patch": {"x_m": 0.02, "y_m": -0.01, "radius_m": 0.04, "factor": 5.0},
    "viscous_drag": {"rate_per_s": 0.7},
    "quadratic_drag": {"coefficient_per_m": 9.0},
    "latency": {"latency_s": 0.1},
    "parallax": {"height_m_per_rad": -0.4},
    "perspective": {"slope_x": 0.2, "slope_y": -0.1},
    "lens_distortion": {"k_per_edge2": -0.4},
    "camera_rotation": {"angle_rad": 0.12},
}


#: Parameters that a world of rigid bodies lacks, at their values there: a heavy side is fixed in the marble,
#: a knob passes through all angles of a turn, a rim returns the same part at all speeds and rubs as the file
#: says. Tilted, its camera is a formula; only the rendered one foreshortens.
ANSWERS = {
    "eccentric_marble": {"follows_path": 0},
    "perspective": {"distance_edges": 0},
    "spring_hysteresis": {"jumps": 0},
    "wall_restitution": {"falloff": 0, "friction_increase": 0},
}
#: A marble with a heavy side, but for where that is.
HEAVY = {"name": "eccentric_marble", "offset": 0.001}


def waves(*parts: tuple[float, float, float]) -> np.ndarray:
    return sum(size * np.sin(2 * np.pi * cycles * TIME + phase) for size, cycles, phase in parts) * RAMP


DRIVES = [
    np.stack([waves((0.07, 1.3, 0.2), (0.04, 3.1, 1.0)), waves((0.06, 1.7, 1.2), (0.05, 2.6, 0.1))], 1),
    np.stack([waves((0.06, 1.1, 2.0), (0.05, 2.4, 0.3)), waves((0.07, 1.4, 4.0), (0.04, 3.3, 2.0))], 1),
]
STARTS = [(0.04, -0.03), (-0.02, 0.02)]


def named(name: str) -> type:
    return next(one for one in EFFECTS if one.name == name)


def until_rim(*runs: Played) -> int:
    """Return the number of rows before a marble is at the rim, where the engines' contacts differ."""
    close = np.any([(np.abs(one.places) > REACH - 2e-3).any(axis=1) for one in runs], axis=0)
    return int(np.argmax(close)) if close.any() else len(close)


def ours(played: Played, commands: np.ndarray, effects: list) -> np.ndarray:
    chosen = [{**ANSWERS.get(one["name"], {}), **one} for one in effects]
    return irt.rollouts(VALUES, commands, start=played.seen[0], effects=chosen)[0]


def compared(effect: dict, commands: np.ndarray, start: tuple[float, float]) -> tuple[float, float]:
    """Return the largest difference between the engines, and what the effect itself comes to [edges]."""
    commands = commands.round(6)
    played = play(BASE, commands, start, physics_of([effect]))
    rows = until_rim(played)
    assert rows > 30
    with_it, without = ours(played, commands, [effect]), ours(played, commands, [])
    return float(np.abs(with_it - played.seen)[:rows].max()), float(np.abs(with_it - without)[:rows].max())


def agree(effect: dict, commands: np.ndarray, start: tuple[float, float], within: float = 0.002) -> None:
    apart, size = compared(effect, commands, start)
    assert size > 5 * within, "the case does not show the effect"
    assert apart < within


@pytest.mark.parametrize("run", [0, 1])
def test_nothing_hidden_agrees_with_our_engine(run: int) -> None:
    commands = DRIVES[run].round(6)
    played = play(BASE, commands, STARTS[run])
    rows = until_rim(played)
    assert rows > 50
    np.testing.assert_allclose(played.seen[:rows], ours(played, commands, [])[:rows], atol=5e-4)


def test_effects_are_those_of_the_catalogue() -> None:
    catalogue = {one.name: [parameter.name for parameter in one.required] for one in hypothetical()}
    here = {one.name: [field.name for field in dataclasses.fields(one)] for one in EFFECTS}
    for name, answers in ANSWERS.items():
        catalogue[name] = [one for one in catalogue[name] if one not in answers]
    assert here == catalogue


@pytest.mark.parametrize("name", [one.name for one in EFFECTS])
@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0])
def test_draws_lie_within_what_the_catalogue_searches(name: str, strength: float) -> None:
    parameters = effect(name).required
    for seed in range(20):
        drawn = named(name).draw(np.random.default_rng(seed), strength).parameters()
        for one in [one for one in parameters if one.name in drawn]:
            # Neutral in all but its size, an effect of two axes may act along one alone.
            low, high = min(one.low, one.neutral), max(one.high, one.neutral if one.neutral < np.inf else 0)
            assert low - 1e-9 <= drawn[one.name] <= high + 1e-9, one.name


@pytest.mark.parametrize("name", CATALOGUED)
def test_effect_is_the_one_that_our_engine_knows_by_its_name(name: str) -> None:
    effect = {"name": name, **CATALOGUED[name]}
    cases = [compared(effect, commands, start) for commands, start in zip(DRIVES, STARTS, strict=True)]
    apart, size = np.max(cases, axis=0)
    assert size > 0.005, "the case does not show the effect"
    assert apart < min(0.001, size / 8)


@pytest.mark.parametrize("gain", [0.9, -0.4])
def test_spring_hysteresis_in_steps_agrees_where_commands_change_slowly(gain: float) -> None:
    commands = np.stack([waves((0.06, 1.5, 0.0)), waves((0.05, 2.0, 0.0))], 1)
    effect = {"name": "spring_hysteresis", "strength": gain, "width_rad": 0.2}
    played = play(BASE, commands.round(6), (0, 0), physics_of([effect]))
    rows = until_rim(played)
    stepped = ours(played, commands.round(6), [{**effect, "jumps": 1}])
    apart = np.abs(stepped - played.seen)[:rows].max()
    size = np.abs(stepped - ours(played, commands.round(6), []))[:rows].max()
    assert apart < 0.1 * size


@pytest.mark.parametrize(("ratio", "moved"), [(2.0, True), (4.0, False)])
def test_static_friction_holds_up_to_its_tilt_and_then_lets_go(ratio: float, moved: bool) -> None:
    """Three times the tilt that keeps the marble rolling, then six times."""
    threshold = BASE.rolling_friction / BASE.gear_y
    commands = np.zeros((40, 2))
    commands[1:20, 1], commands[20:, 1] = 3.0 * threshold, 6.0 * threshold
    effect = {"name": "static_friction", "ratio": ratio}
    played = play(BASE, commands.round(6), (-0.1, 0.0), physics_of([effect]))
    travelled = played.places[:, 0] + 0.1
    assert (travelled[20] > 1e-3) == moved
    assert travelled[20] > 1e-3 or travelled[20] < 2e-5
    assert travelled[-1] > 0.01
    np.testing.assert_allclose(played.seen, ours(played, commands, [effect]), atol=1e-3)


def test_static_friction_agrees_where_the_marble_turns_back() -> None:
    commands = np.stack([waves((0.045, 3.0, 0.0)), np.zeros(ROWS)], 1)
    apart, size = compared({"name": "static_friction", "ratio": 4.0}, commands, (0, 0))
    assert size > 0.0015
    assert apart < 0.2 * size


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_eccentric_marble_agrees_on_a_straight_way(sign: float, axis: int) -> None:
    commands = np.zeros((40, 2))
    commands[:, axis] = sign * np.minimum(0.1, 0.05 * np.arange(40))
    towards = np.array([0.0, -1.0]) if axis == 0 else np.array([1.0, 0.0])
    agree({"phase_rad": np.pi, "lean_rad": 0.0, **HEAVY}, commands, tuple(-0.09 * sign * towards))


def test_eccentric_marble_is_pushed_to_the_side_of_its_phase() -> None:
    commands = np.stack([np.zeros(40), np.minimum(0.1, 0.05 * np.arange(40))], 1)
    agree({"phase_rad": np.pi + 0.5, "lean_rad": 0.0, **HEAVY}, commands, (-0.09, 0.0))


@pytest.mark.parametrize("run", [0, 1])
def test_eccentric_marble_agrees_wherever_the_path_leads(run: int) -> None:
    """Back and aside in three dimensions, which the path length alone does not determine."""
    effect = {"phase_rad": np.pi - 0.1, "lean_rad": 0.15, **HEAVY}
    agree(effect, DRIVES[run], STARTS[run])
    commands = DRIVES[run].round(6)
    played = play(BASE, commands, STARTS[run], physics_of([effect]))
    rows = until_rim(played)
    by_way = ours(played, commands, [{**effect, "lean_rad": 0.0, "follows_path": 1}])
    assert np.abs(by_way - played.seen)[:rows].max() > 0.01


def test_eccentric_marble_turns_its_heavy_side_back() -> None:
    """On the way back the ripple is that of the way there: what pushed on holds back."""
    effect = physics_of([{"phase_rad": np.pi, "lean_rad": 0.0, **HEAVY, "offset": 0.003}])
    base = dataclasses.replace(BASE, rolling_friction=0.0)
    played = play(
        base,
        np.zeros((80, 2)),
        (0.0, 0.0),
        [*effect, *physics_of([{"name": "tilt_bias", "bias_x_rad": 0.0, "bias_y_rad": 0.002}])],
    )
    # A pendulum about where weight and tilt balance: it comes back to where it was let go, again and again.
    assert played.places[:, 0].max() < 2 * np.pi * RADIUS_M
    assert played.places[:, 0].min() > -1e-4
    assert (np.abs(played.places[20:, 0]) < 5e-4).any()


def test_rim_returns_what_our_engine_returns() -> None:
    commands = np.tile([0.0, 0.1], (40, 1))
    commands[15:] = 0.0
    effect = {"name": "wall_restitution", "increase": 0.7}
    played = play(BASE, commands, (0.11, 0.0), physics_of([effect]))
    with_it, without = ours(played, commands, [effect]), ours(played, commands, [])
    assert np.abs(with_it - without).max() > 0.05
    # The remaining spin differs between contact solvers, and with it a part of the way back.
    assert np.abs(played.seen - with_it).max() < 0.25 * np.abs(with_it - without).max()


def test_shifted_camera_sees_the_rim_shifted() -> None:
    commands = np.tile([-0.1, 0.1], (40, 1))
    effect = {"name": "camera_offset", "x_edges": 0.06, "y_edges": -0.03}
    played = play(BASE, commands, (0.1, 0.08), physics_of([effect]))
    np.testing.assert_allclose(played.seen[-1], REACH / EDGE_X_M * 1.05 + [0.06, -0.03], atol=0.002)
    np.testing.assert_allclose(played.seen[-1], ours(played, commands, [effect])[-1], atol=0.002)


def test_jitter_delays_as_often_as_ours() -> None:
    """No two runs are alike, so what agrees is by how much they miss the run without it."""
    effect = {"name": "delay_jitter", "sd_s": 0.15}
    commands = DRIVES[0].round(6)
    plain = play(BASE, commands, STARTS[0])
    runs = [
        play(BASE, commands, STARTS[0], physics_of([effect]), np.random.default_rng(i)).seen for i in range(8)
    ]
    many = irt.rollouts(
        VALUES * 200,
        np.tile(commands, (200, 1, 1)),
        start=plain.seen[0],
        effects=[effect],
        seed=np.arange(200),
    )
    ours_missed = np.abs(many - ours(plain, commands, [])).mean(axis=(1, 2))
    missed = np.abs(np.array(runs) - plain.seen).mean(axis=(1, 2))
    assert np.ptp(missed) > 0
    assert abs(missed.mean() - ours_missed.mean()) < 4 * ours_missed.std() / np.sqrt(len(runs))


def test_jitter_is_never_early_and_half_of_it_is_punctual() -> None:
    (jitter,) = physics_of([{"name": "delay_jitter", "sd_s": 0.15}])
    late = jitter.arrive(np.zeros(20_000), np.random.default_rng(1))
    assert late.min() == 0.0
    assert np.mean(late == 0.0) == pytest.approx(0.5, abs=0.02)
    assert np.sqrt(2.0 * np.mean(late**2)) == pytest.approx(0.15, rel=0.03)
