"""Intervals contain the planted values, and effects whose interval contains zero are not named."""

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis import intervals, time_symmetry
from irt.diagnosis.dataset import Dataset, Fitted
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import Scores
from irt.diagnosis.selection import Selection
from irt.diagnosis.validation import Validation
from irt.engine import rollouts
from irt.model import Parameter
from irt.rig import PARAMETERS

DRAG = {"name": "viscous_drag", "rate_per_s": 0.8}
TRUTH = dict(zip(PARAMETERS, (0.06, 0.05, 4e-4, 15.0, 1.03), strict=True)) | {"viscous_drag.rate_per_s": 0.8}
SLOWED = (0.06, 0.05, 4e-4, 20.0, 1.0)
#: Standard deviation of the planted tracker [board edges].
NOISE = 1e-3


def parameters(dataset, name="viscous_drag", near=(0.5,)):
    """Return the intervals with a planted effect, fitted from near the truth."""
    scores = Scores(dataset)
    base = scores.base()
    values = np.append(base.top.values, near)[None]
    (one,) = scores.ascend((name,), values, base.noise[None], base.top.states, iterations=25)
    loss = one.top.log_likelihood - base.top.log_likelihood
    return intervals.parameters(one, Validation().of(one), {name: loss})[0]


@pytest.mark.slow
@pytest.mark.parametrize("pushed", [0.0, 0.05])
def test_intervals_hold_what_was_planted(plant, pushed):
    held, widths = [], []
    for seed in range(8):
        found = parameters(plant([DRAG], seed=seed, stamped=True, pushed=pushed))
        drag = found["viscous_drag.rate_per_s"]
        widths.append(drag.high - drag.low)
        held += [
            one.low <= TRUTH[name] <= one.high
            for name, one in found.items()
            if name in TRUTH and one.low is not None
        ]
    assert len(held) == 8 * 5
    # Fewer than 32 of 40 independent intervals contain the truth with a probability of 1e-4.
    assert sum(held) >= 32
    assert np.median(widths) < (0.5 if pushed else 0.15)


@pytest.mark.slow
@pytest.mark.parametrize("sd_s", [0.05, 0.1], ids=["shorter than a row", "longer than a row"])
def test_mean_and_spread_of_delays_are_known_where_shift_and_lag_are_not(plant, sd_s):
    effects = [{"name": "delay", "delay_s": 0.3}, {"name": "delay_jitter", "sd_s": sd_s}]
    scores = Scores(plant(effects, runs=8, rows=100, stamped=True))
    best = Selection(scores, ["delay", "delay_jitter"], lambda _: None).run().best
    assert best.effects == ("delay_jitter",)
    found = intervals.parameters(best, Validation().of(best), {})[0]
    spread, mean = (found[f"delay_jitter.{name}"] for name in ("sd_s", "mean_s"))
    assert spread.low < sd_s < spread.high < 2.0 * spread.low
    assert mean.low < 0.3 < mean.high < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_without_stamps_no_time_scale_is_read_off_impacts(plant, seed):
    found = parameters(plant([DRAG], rows=120, runs=6, seed=seed))
    assert all(found[name].low <= true <= found[name].high for name, true in TRUTH.items())
    time_scale = found["time_scale"]
    assert time_scale.high - time_scale.low > 0.5 * time_scale.value


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_without_stamps_a_size_is_as_unknown_as_the_time_scale(plant, seed):
    """A tilt goes with the inverse square of the time scale."""
    bias = {"name": "tilt_bias", "bias_x_rad": 0.002, "bias_y_rad": -0.001}
    found = parameters(plant([bias], runs=3, rows=60, seed=seed), "tilt_bias", (0.002, -0.001))
    size, time_scale = found["tilt_bias.bias_x_rad"], found["time_scale"]
    least = size.value * (time_scale.value / time_scale.high) ** 2
    assert 0.0 < size.low <= 1.001 * least


@pytest.mark.slow
def test_recordings_that_disagree_widen_the_interval(plant):
    rates = (0.4, 0.6, 0.8, 1.0, 1.2)
    alike = plant([DRAG], runs=5, stamped=True)
    runs = [
        plant([{**DRAG, "rate_per_s": rate}], runs=5, stamped=True).rig.recordings[index]
        for index, rate in enumerate(rates)
    ]
    differing = Dataset.of(_with(alike.rig, runs))
    same, other = (parameters(dataset)["viscous_drag.rate_per_s"] for dataset in (alike, differing))
    assert other.high - other.low > 3.0 * (same.high - same.low)
    assert other.low <= 0.8 <= other.high


def _with(rig, runs):
    return type(rig)(rig.path, rig.board, rig.marble, rig.start, rig.ranges, tuple(runs))


@pytest.mark.parametrize(
    ("name", "ends", "may_be"),
    [
        ("bump", {"height_m": (-1e-4, 3e-4), "x_m": (0.01, 0.02)}, True),
        ("bump", {"height_m": (1e-4, 3e-4), "x_m": (-0.1, 0.1)}, False),
        ("anisotropic_friction", {"ratio": (1.0, 5.0), "grain_rad": (0.7, 2.0)}, True),
        ("backlash", {"width_x_rad": (0.0, 0.02), "width_y_rad": (0.01, 0.03)}, False),
        ("backlash", {"width_x_rad": (0.0, 0.02), "width_y_rad": (0.0, 0.03)}, True),
        ("side_force", {"rate_per_s": (None, None)}, True),
    ],
)
def test_a_size_that_may_as_well_be_none_is_not_named(name, ends, may_be):
    found = {
        f"{name}.{one.name}": Parameter(0.5 * sum(ends[one.name]), *ends[one.name])
        if ends.get(one.name, (None,))[0] is not None
        else Parameter(0.5 * (one.low + one.high))
        for one in effect(name).parameters
    }
    assert intervals.may_be_absent(name, found) is may_be
    assert intervals.is_named(effect(name), found) is not may_be


@pytest.mark.parametrize(
    ("low", "high", "named"),
    [(0.045, 0.055, False), (0.54, 0.66, True), (0.1, 0.9, False), (-0.6, -0.5, True)],
)
def test_a_rebound_is_certainly_larger_than_what_engines_differ_by(low, high, named):
    found = {"wall_restitution.increase": Parameter(0.5 * (low + high), low, high)}
    assert intervals.is_distinct(effect("wall_restitution"), found)
    assert intervals.is_named(effect("wall_restitution"), found) is named


@pytest.mark.parametrize(("speed", "named"), [(0.02, True), (0.002, False), (0.2, False)])
def test_friction_at_other_speeds_than_stribecks_is_another_effect(speed, named):
    found = {
        "stribeck.strength": Parameter(9.0, 8.0, 10.0),
        "stribeck.speed_m_per_s": Parameter(speed, 0.001, 0.3),
    }
    assert intervals.is_named(effect("stribeck"), found) is named


@pytest.mark.parametrize(("low", "named"), [(0.02, True), (0.0, False), (None, False)])
def test_delays_differ_where_their_spread_is_no_zero(low, named):
    high = None if low is None else 0.1
    found = {"delay_jitter.sd_s": Parameter(0.05, low, high)}
    assert intervals.is_named(effect("delay_jitter"), found) is named


@pytest.mark.parametrize(
    "learned",
    [
        {"drag_strength": 0.03, "drag_power": 2.0},
        {"side_strength": 0.03, "side_power": 0.5},
        {"push_1_x_m_per_s2": 0.01, "velocity_1_x_s_per_m": 5.0, "rate_1_per_s": 2.0},
        {"shape_1": 1.0, "push_1_y_m_per_s2": 0.01, "tilt_1_x_per_rad": 500.0, "wave_1_x_per_m": 20.0},
        {"shape_1": 2.0, "brake_1_m_per_s2": 0.004, "drag_power": 0.0, "way_1_per_m": 9.0},
        {"shape_1": 5.0, "gear_1_x": 0.2, "gear_1_y": -0.2, "heading_1_x": 1.0, "phase_1_rad": 0.5},
        {"mode_gain": 0.8, "mode_rate_rad_per_s": 6.0, "mode_damping": 0.2},
        {
            "yield_lag_s": 0.2,
            "yield_x": 0.8,
            "yield_x_s_per_rad": 90.0,
            "yield_y": 0.5,
            "yield_y_s_per_rad": 60.0,
        },
    ],
    ids=lambda learned: "-".join(name for name in learned if name != "shape_1"),
)
def test_the_symmetry_of_time_leaves_the_path_of_what_was_learned_as_it_is(learned):
    values = {one.name: one.neutral for one in effect(UNLISTED).parameters} | learned
    names = tuple(f"{UNLISTED}.{name}" for name in values)
    at = np.array([*SLOWED, *values.values()])
    fitted = Fitted(None, (UNLISTED,), (*PARAMETERS, *names), at, (), 0.0)
    powers = dict(zip(values, time_symmetry.powers(names, fitted), strict=True))
    knobs = 0.03 * np.sin(np.arange(60)[:, None] / [9.0, 13.0])

    def path(factor, *, is_slowed=True):
        base = np.array([SLOWED])
        base[0, :4] *= [factor**-2, factor**-2, factor**-2, factor]
        slowed = {name: value * factor ** (is_slowed * powers[name]) for name, value in learned.items()}
        return rollouts(base, knobs, effects=[{"name": UNLISTED, **slowed}])[0]

    moved = np.abs(path(1.0) - path(1.0)[0]).max()
    apart = np.abs(path(1.5) - path(1.0)).max()
    assert apart < 0.03 * moved
    if any(powers[name] for name in learned):
        assert np.abs(path(1.5, is_slowed=False) - path(1.0)).max() > 3.0 * apart


@pytest.mark.parametrize(("low_s", "named"), [(0.0, False), (0.0011, False), (0.0013, True)])
def test_delay_jitter_exceeds_the_spread_of_a_simulators_step(low_s, named):
    """Commands that take effect at the next of 240 steps a second are late by 1.2 ms, standard deviation."""
    found = {"delay_jitter.sd_s": Parameter(0.002, low_s, 0.003)}
    assert intervals.is_named(effect("delay_jitter"), found) == named


def test_the_width_of_an_effect_is_plausible_in_the_unit_of_the_commands():
    info = effect("spring_hysteresis").in_unit("us", 1e-3)
    found = {
        "spring_hysteresis.strength": Parameter(0.5, 0.4, 0.6),
        "spring_hysteresis.width_rad": Parameter(40.0, 35.0, 45.0),
        "spring_hysteresis.jumps": Parameter(1.0),
    }
    assert intervals.is_named(info, found)
    assert not intervals.is_named(effect("spring_hysteresis"), found)


def test_an_interval_spans_what_a_removed_effect_would_change_and_no_absence():
    found = {
        "gear_x": Parameter(0.06, 0.059, 0.061),
        "gear_y": Parameter(0.05, None, None),
        "lag.time_constant_s": Parameter(0.12, 0.115, 0.125),
        "viscous_drag.rate_per_s": Parameter(0.4, 0.3, 0.5),
    }
    others = {
        "gear_x": Parameter(0.062, 0.0615, 0.0625),
        "gear_y": Parameter(0.05, 0.04, 0.06),
        "lag.time_constant_s": Parameter(0.1, 0.09, 0.11),
        "viscous_drag.rate_per_s": Parameter(0.1, -0.1, 0.3),
        "delay.delay_s": Parameter(0.02, 0.01, 0.03),
    }
    assert intervals.spanning(found, others) == {
        "gear_x": Parameter(0.06, 0.059, 0.0625),
        "gear_y": Parameter(0.05, None, None),
        "lag.time_constant_s": Parameter(0.12, 0.09, 0.125),
        # Without the drag the recordings would be lost: only how large it is is in doubt.
        "viscous_drag.rate_per_s": Parameter(0.4, 0.3, 0.5),
    }
    assert intervals.spanning(found, found) == found


def test_what_the_picture_scales_is_known_no_better_than_its_corners(plant):
    """The four corners are 0.65 long edges from the centre each, together 1.3."""
    found = parameters(plant([DRAG], runs=8, stamped=True))
    for name in ("gear_x", "gear_y", "rolling_friction", "observation_scale"):
        one = found[name]
        assert min(one.high - one.value, one.value - one.low) > 1.8 * NOISE / 1.31 * one.value
