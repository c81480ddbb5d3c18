"""The answer that is made of a set, of any search."""

from dataclasses import replace

import numpy as np
import pytest

from irt.diagnosis import config
from irt.diagnosis.answer import Answer
from irt.diagnosis.relevance import Relevance
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import DEPARTURE, LASTING, LASTING_S, PULL, PUSH, RESTITUTION, Scores
from irt.diagnosis.selection import Selection
from irt.diagnosis.sets import Posterior


def quiet(_text: str) -> None:
    """Ignore progress."""


@pytest.mark.slow
@pytest.mark.parametrize(("lasting", "verdict"), [(0.001, "unlisted"), (0.003, "sufficient")])
def test_noise_that_stands_for_what_is_missing_is_not_sufficient(plant, lasting, verdict):
    """Correlated noise follows from row to row what a free run lacks, so that no push seems to be needed."""
    turns = {"name": UNLISTED, "picture_turn_x": 10.0, "picture_turn_y": -7.5}
    scores = Scores(plant([turns], runs=4, stamped=True))
    base = scores.base()
    noise = base.noise.copy()
    noise[[PUSH, PULL, RESTITUTION]] = config.LITTLE
    noise[[LASTING, LASTING_S, DEPARTURE]] = lasting, 1.0, 0.0
    noisy = replace(base, top=replace(base.top, noise=noise))
    scores.known[frozenset()] = noisy
    relevance = Relevance(Selection(scores, [], quiet), Posterior(noisy, (noisy,)))
    found = Answer(noisy, relevance, frozenset()).diagnosis(quiet)
    assert not found.effects
    assert found.verdict == verdict
    assert ("own noise allows" in found.summary) == (verdict == "unlisted")


def test_the_drift_is_that_of_a_push_that_is_integrated_twice(plant):
    """A push that lasts for 0.2 s, an Ornstein-Uhlenbeck process, on a marble without friction and walls."""
    base = Scores(plant(runs=4, rows=160, stamped=True)).base()
    row_s, edge_m = base.dataset.row_s(base.fitted), base.dataset.edge_m(base.fitted)
    _, pull, _ = config.LITTLE
    step, count = 0.01, round(160 * row_s / 0.01)
    random, kept = np.random.default_rng(0), np.exp(-0.01 / config.PULL_S)
    push, speed, place = pull * random.standard_normal(4000), np.zeros(4000), np.zeros(4000)
    squares = 0.0
    for _ in range(count):
        push = kept * push + pull * np.sqrt(1.0 - kept**2) * random.standard_normal(4000)
        speed += step * push
        place += step * speed
        squares += float((place**2).mean()) / count
    # Towards its start the push is not white yet, and moves the marble a little less.
    assert base.drift * edge_m == pytest.approx(np.sqrt(squares), rel=0.1)
