"""A recording does not influence the selection that predicts it."""

from dataclasses import replace

import numpy as np
import pytest

from irt.diagnosis import config
from irt.diagnosis.nested import nested
from irt.diagnosis.score import Scores
from irt.diagnosis.validation import Validation

DRAG = {"name": "viscous_drag", "rate_per_s": 0.8}


@pytest.fixture(scope="module")
def two(plant):
    """The five-parameter model, and the model with the planted drag."""
    scores = Scores(plant([DRAG], runs=3, rows=60, stamped=True))
    base = scores.base()
    begin = np.append(base.top.values, 0.5)[None]
    (found,) = scores.ascend(("viscous_drag",), begin, base.noise[None], base.top.states, iterations=25)
    return base, found


class Judged(Validation):
    """A validation with log posteriors given by a test."""

    def __init__(self, scores):
        super().__init__()
        self.scores = scores

    def of(self, one):
        found = super().of(one)
        return replace(found, scores=np.array(self.scores[len(one.effects)]))


def test_what_is_planted_is_chosen_without_any_one_recording(two):
    validation = Validation()
    found = nested(two, validation)
    assert found.chosen == (frozenset({"viscous_drag"}),) * 3
    assert found.share_with(["viscous_drag", "bump"]) == 1.0
    assert found.share_with(["bump"]) == 0.0
    assert found.mae == validation.of(two[1]).mae


def test_each_recording_is_predicted_by_what_the_others_choose(two):
    base, drag = two
    validation = Judged({0: [0.0, -2.0, 0.0], 1: [9.0, 0.0, 9.0]})
    found = nested(two, validation)
    assert found.share_with(["viscous_drag"]) == pytest.approx(2 / 3)
    runs = [validation.of(one).runs[index].mae for index, one in enumerate((drag, base, drag))]
    assert found.mae == pytest.approx(np.mean(runs))


def test_an_effect_that_gains_less_than_the_search_asks_is_not_chosen(two):
    found = nested(two, Judged({0: [0.0] * 3, 1: [config.SURE - 0.1, config.SURE + 0.1, 0.0]}))
    assert found.share_with(["viscous_drag"]) == pytest.approx(1 / 3)


def test_values_by_free_runs_are_chosen_by_their_likelihood(two):
    base, drag = two
    free = Scores.of(drag).freed(drag)
    validation = Validation()
    assert np.isnan(validation.of(free).scores).all()
    found = nested([free, base], validation)
    assert found.share_with(["viscous_drag"]) == 1.0
    assert found.mae == validation.of(free).mae


def test_a_set_without_a_posterior_is_never_chosen(two):
    found = nested(two, Judged({0: [-9.0] * 3, 1: [np.nan, -np.inf, 0.0]}))
    assert found.share_with(["viscous_drag"]) == pytest.approx(1 / 3)
