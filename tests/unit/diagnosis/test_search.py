"""What a search tries, and what it takes for one thing by two names."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from irt.diagnosis import search
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.rivals import rivals
from irt.diagnosis.search import Search


@pytest.fixture
def begun(plant):
    """Return what begins a search of a case with these effects."""

    def begin(*effects, **case):
        found = Search(plant(effects, **case), lambda text: None)
        found.keep(found.case.fit(starts=8))
        return found

    return begin


@pytest.mark.slow
def test_an_effect_that_the_screen_did_not_see_is_tried_in_the_end(begun, monkeypatch):
    monkeypatch.setattr(search, "SINGLES", 0)
    found = begun({"name": "viscous_drag", "rate_per_s": 0.5})
    assert found.singles().effects == ("viscous_drag",)


def test_a_late_command_and_a_late_picture_are_one_thing_by_two_names(begun):
    found = begun({"name": "latency", "latency_s": 0.15})
    best = found.with_effect("latency")
    assert "delay" in {one.effects[0] for one in rivals(found, best, best.effects)["latency"]}


def test_what_was_learned_without_a_name_ties_with_none(begun):
    """It imitates what has one; a tie is a choice of names."""
    found = begun({"name": "tilt_bias", "bias_x_rad": 0.002, "bias_y_rad": 0.001})
    best = found.with_effect("tilt_bias")
    found.fits[frozenset({UNLISTED})] = replace(best, effects=(UNLISTED,))
    assert (UNLISTED,) not in {one.effects for one in rivals(found, best, best.effects)["tilt_bias"]}


def test_a_hypothesis_is_begun_where_a_larger_one_led(begun):
    found = begun({"name": "lag", "time_constant_s": 0.2})
    lost = found.case.refine(["lag"], np.append(found.base.values, 1.5)[None], iterations=1)[0]
    found.keep(lost)
    right = found.case.fit(["lag", "viscous_drag"])
    assert found.thorough(lost, right).loss(found.case.noise) < lost.loss(found.case.noise) - 10.0


@pytest.mark.slow
def test_two_effects_that_one_order_left_in_a_wrong_minimum_are_tried_in_the_other(begun, monkeypatch):
    """A patch of friction that spun the marble as well was learned without a name for want of this."""
    monkeypatch.setattr(search, "SWAPS", 1)
    monkeypatch.setattr(Search, "_refine", lambda self, size: None)
    found = begun({"name": "lag", "time_constant_s": 0.2}, {"name": "viscous_drag", "rate_per_s": 0.5})
    begin = np.concatenate([found.base.values, [0.8, 2.5]])
    stuck = found.case.refine(["lag", "viscous_drag"], begin[None], iterations=1)[0]
    found.keep(stuck)
    found._swap(stuck)
    pair = found.fits[frozenset(stuck.effects)]
    assert pair.loss(found.case.noise) < stuck.loss(found.case.noise) - 10.0


@pytest.mark.parametrize(
    ("effects", "explained", "trusted", "done"),
    [
        ((), True, False, True),
        (("lag",), True, True, True),
        (("lag",), True, False, False),
        (("lag",), False, True, False),
    ],
)
def test_effects_are_not_enough_by_what_most_windows_look_like(
    effects, explained, trusted, done, monkeypatch
):
    """A lag left noise in most windows of a rig that had a dead band beside it."""
    monkeypatch.setattr(search, "is_explained", lambda case, one, base: explained)
    monkeypatch.setattr(search, "is_trusted", lambda case, one, base: trusted)
    found = Search(None, lambda text: None, {frozenset(): None})
    assert found.is_done(SimpleNamespace(effects=effects)) is done


def test_two_effects_that_do_most_alone_are_fitted_together(begun, monkeypatch):
    """Beside a delay a dead band was not among those that draws seemed to tell, and a stranger was named."""
    found = begun({"name": "delay", "delay_s": 0.15}, {"name": "dead_band", "half_width_rad": 0.02})
    for name in ("delay", "latency", "dead_band"):
        found.with_effect(name)
    monkeypatch.setattr(Search, "seeds", lambda self, parent, names: pytest.fail("nothing is drawn"))
    found._pair_up()
    pair = found.ranked(2)[0]
    assert "dead_band" in pair.effects
    assert pair.noise < 1.3 * found.case.noise


def test_what_is_one_by_two_names_is_paired_once(begun):
    found = begun({"name": "latency", "latency_s": 0.15})
    for name in ("delay", "latency", "lag"):
        found.with_effect(name)
    different = [one.effects for one in found._different(1)]
    assert len(different) == 2
    assert different[0] == found.ranked(1)[0].effects
    assert ("lag",) in different


def test_the_same_fit_is_not_made_twice(begun, monkeypatch):
    found = begun({"name": "lag", "time_constant_s": 0.2})
    point = np.append(found.base.values, 0.1)[None]
    first = found.fit(["lag"], point, rounds=0)
    monkeypatch.setattr(type(found.case), "fit", lambda *_, **__: pytest.fail("it was made"))
    assert found.fit(["lag"], point, rounds=0) is first


@pytest.mark.slow
@pytest.mark.parametrize(("trusted", "named"), [(True, {"lag"}), (False, {"lag", "viscous_drag"})])
def test_what_leaves_much_of_whole_runs_is_tried_with_a_second_effect(begun, monkeypatch, trusted, named):
    """Beside a point that repels a hysteresis left noise between impacts, and 29 % of the mismatch in all."""
    monkeypatch.setattr(search, "hypotheses", lambda: ("lag", "viscous_drag", "wall_restitution"))
    monkeypatch.setattr(search, "is_trusted", lambda case, one, base: trusted)
    monkeypatch.setattr(Search, "is_explained_between", lambda self, one: True)
    found = begun({"name": "lag", "time_constant_s": 0.2}, {"name": "viscous_drag", "rate_per_s": 0.5})
    assert set(found.larger(found.with_effect("lag"), 2).effects) == named


def test_what_does_most_alone_is_tried_in_the_place_of_what_stands_in_for_it(begun, monkeypatch):
    """A tilt beside a side force was learned without a name: a far point stood in for the tilt."""
    found = begun(
        {"name": "tilt_bias", "bias_x_rad": 0.003, "bias_y_rad": -0.002},
        {"name": "viscous_drag", "rate_per_s": 0.5},
    )
    found.with_effect("tilt_bias")
    stand_in = found.with_effect("viscous_drag", found.with_effect("bump"))
    monkeypatch.setattr(Search, "seeds", lambda self, parent, names: pytest.fail("nothing is drawn"))
    found._replace(stand_in)
    assert found.fits[frozenset({"tilt_bias", "viscous_drag"})].noise < 1.3 * found.case.noise
