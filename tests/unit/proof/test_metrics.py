"""Scores of many rigs together, counted by hand."""

from __future__ import annotations

import math

import pytest

from irt.catalogue import hypothetical
from irt.proof.contested import Contestant, is_ahead, of_diagnosis, standing
from irt.proof.metrics import (
    BINS,
    Difference,
    Quantity,
    Rate,
    calibration,
    confusion,
    coverage,
    floors,
    power,
)
from irt.proof.score import Errors


def errors(signal: float = 8.0, final: float = 0.0011) -> Errors:
    return Errors(base=0.02, final=final, oracle=0.001, signal=signal)


@pytest.mark.parametrize(
    ("good", "of", "low", "high"),
    # Wilson's interval as tabulated by Newcombe (1998, Table I, method 3).
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_intervals_of_rates(good: int, of: int, low: float, high: float) -> None:
    assert Rate(good, of).interval == pytest.approx((low, high), abs=5e-5)
    assert Rate(of - good, of).interval == pytest.approx((1 - high, 1 - low), abs=5e-5)


def test_a_rate_of_none_is_unknown() -> None:
    assert math.isnan(Rate(0, 0).share)
    assert Rate(0, 0).interval == (0.0, 1.0)
    assert Quantity.median([]).of == 0


def test_a_median_lies_in_its_interval() -> None:
    median = Quantity.median([0.2, 0.9, 0.95, 0.97, 1.0])
    assert median.low <= median.value == 0.95 <= median.high
    assert Quantity.median([0.2, 0.9, 0.95, 0.97, 1.0]) == median


def test_who_was_taken_for_whom(score) -> None:
    scores = [
        score(),
        score(named=("lag",), ties={"lag": ["delay"]}, exact=False),
        score(named=("lag",), exact=False, found=False),
        score(named=(), verdict="sufficient", exact=False, found=False),
        score(named=("delay", "bump"), exact=False, found=False),
        score("pair"),
        score("pair", named=("lag", "bump"), found=False),
        score("unlisted", verdict="unlisted", named=("unlisted",)),
        score("unlisted", named=("bump",), found=False),
        score("none"),
        score("none", verdict="missing", named=("lag",), found=False, false_alarm=True),
        score(verdict="failed", named=(), found=False),
        score("outliers", verdict="failed", named=(), found=False),
    ]
    assert dict(confusion(scores)) == {
        ("delay", "delay"): 4,
        ("delay", "lag"): 2,
        ("delay", "nothing"): 1,
        ("nothing", "bump"): 1,
        ("bump", "bump"): 2,
        ("unlisted", "unlisted"): 1,
        ("unlisted", "bump"): 1,
        ("nothing", "nothing"): 1,
        ("nothing", "lag"): 1,
        ("delay", "failed"): 1,
        ("nothing", "failed"): 1,
    }


def test_power_by_signal(score) -> None:
    signals = [0.2, 0.6, 3.0, 3.0, 5.0, 7.0, 40.0]
    scores = [score(errors=errors(signal), found=signal > 3.5) for signal in signals]
    scores.append(score(errors=None, verdict="failed", found=False))
    rates = {one.low: (one.rate.good, one.rate.of) for one in power(scores)}
    assert rates == {
        0.0: (0, 1),
        0.5: (0, 1),
        1.0: (0, 0),
        2.0: (0, 2),
        5.0: (2, 2),
        10.0: (0, 0),
        20.0: (1, 1),
    }
    assert len(rates) == len(BINS) - 1


def test_coverage_leaves_open_intervals_out(score) -> None:
    scores = [
        score(intervals={"gear_x": "yes", "gear_y": "no", "delay.delay_s": "yes"}),
        score(intervals={"gear_x": "yes", "gear_y": "open"}),
    ]
    assert coverage(scores) == (Rate(3, 4), 1)
    assert coverage(scores, of_effects=True) == (Rate(1, 1), 0)
    assert coverage(scores, of_effects=False) == (Rate(2, 3), 1)


def test_floors(score) -> None:
    scores = [
        *[score(engine="pybullet", intervals={"gear_x": "yes" if i else "no"}) for i in range(19)],
        score(engine="pybullet", found=False),
        score(engine="pybullet", found=False, errors=errors(signal=2.0, final=0.018)),
        score("pair", engine="mujoco"),
        score("pair", engine="mujoco", found=False),
        score("triple", engine="pybullet", through_camera=True),
        score("unlisted", found=True),
        score("none"),
        score("none", false_alarm=True, found=False),
    ]
    measured = {
        one.what.split(" where")[0]: (round(one.value, 3), one.of, one.kept) for one in floors(scores)
    }
    assert measured == {
        "false alarms": (0.5, 2, False),
        "named, or in a declared tie,": (0.913, 23, False),
        "both effects of a pair": (0.5, 2, False),
        "all of three effects": (1.0, 1, True),
        "effects named through a camera": (1.0, 1, True),
        "effects named in PyBullet minus in MuJoCo": (0.405, 23, False),
        "held-out gap closed, median": (0.995, 24, True),
        "95 % intervals that contain the truth": (0.947, 19, True),
        "unlisted physics reported as such": (1.0, 1, True),
        "unlisted physics, held-out gap closed, median": (0.995, 1, True),
    }


def test_intervals_of_differences() -> None:
    """Newcombe (1998, Statistics in Medicine 17:873), Table II, method 10: 56/70 minus 48/80."""
    one = Difference(Rate(56, 70), Rate(48, 80))
    assert one.share == pytest.approx(0.2)
    assert one.interval == pytest.approx((0.0524, 0.3339), abs=5e-5)
    unknown = Difference(Rate(1, 1), Rate(0, 0))
    assert (unknown.of, unknown.interval) == (0, (-1.0, 1.0))


def test_probabilities_by_decile(score) -> None:
    often, seldom = {"delay": 0.95, "lag": 0.91, "bump": 0.0}, {"delay": 1.0, "lag": 0.34}
    missed, failed = score("pair", inclusion={"delay": 0.95}), score(verdict="failed")
    found = calibration([score(inclusion=often), score(inclusion=seldom), missed, failed])
    effects = 3 * len(hypothetical())
    assert [(one.number, round(one.mean, 2), one.rate) for one in found] == [
        (0, 0.0, Rate(1, effects - 5)),
        (3, 0.34, Rate(0, 1)),
        (9, 0.95, Rate(3, 4)),
    ]


def test_a_small_proof_is_not_sure(score) -> None:
    few = floors([score("none")])[0]
    many = floors([score("none") for _ in range(400)])[0]
    assert (few.kept, few.sure) == (True, False)
    assert (many.kept, many.sure) == (True, True)
    none = floors([score()])[0]
    assert (none.kept, none.of) == (None, 0)


def test_a_failed_diagnosis_breaks_promises(score) -> None:
    failed = {"verdict": "failed", "found": False, "errors": None}
    promises = floors([score("none", **failed), score(**failed)])
    assert [(one.value, one.kept) for one in promises[:2]] == [(1.0, False), (0.0, False)]


def test_methods_beside_each_other(score) -> None:
    scores = [score(), score(found=False), score("unlisted"), score("none"), score("none")]
    reported = [True, True, False, True, False]
    found = [True, False, False, False, True]
    entries = [
        Contestant(one.rig, "x", detected=said, found=right, error=0.0105, seconds=2.0)
        for one, said, right in zip(scores, reported, found, strict=True)
    ]
    stands = standing("x", scores, entries)
    assert (stands.named, stands.detected, stands.alarms) == (Rate(1, 2), Rate(2, 3), Rate(1, 2))
    assert stands.closed.value == pytest.approx(0.5)
    assert stands.over_oracle.value == pytest.approx(10.5)
    ours = standing("irt", scores, [of_diagnosis(one) for one in scores])
    assert ours.named == Rate(1, 2)
    assert is_ahead(ours, [stands]) is False
    assert is_ahead(ours, []) is None


def test_a_method_that_is_not_there_says_so(score) -> None:
    scores = [score(), score("none")]
    entries = [Contestant(one.rig, "x", None, None, None, 0.0, "not installed") for one in scores]
    stands = standing("x", scores, entries)
    assert (stands.missing, stands.named, stands.detected, stands.closed.of) == (
        "not installed",
        None,
        None,
        0,
    )
