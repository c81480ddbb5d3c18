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


def test_the_same_fit_is_not_made_twice(begun, monkeypatch):
    found = begun({"name": "lag", "time_constant_s": 0.2})
    point = np.append(found.base.values, 0.1)[None]
    first = found.fit(["lag"], point, rounds=0)
    monkeypatch.setattr(type(found.case), "fit", lambda *_, **__: pytest.fail("it was made"))
    assert found.fit(["lag"], point, rounds=0) is first
