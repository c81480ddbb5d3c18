"""The sets that are worth a mention: the answer first, with probabilities."""

from dataclasses import replace

import pytest

from irt.diagnosis import config
from irt.diagnosis.score import Scores
from irt.diagnosis.sets import Posterior


@pytest.fixture(scope="module")
def of(plant):
    """Return a function that makes sets of given effects and scores."""
    base = Scores(plant([{"name": "lag", "time_constant_s": 0.1}], runs=1, stamped=True)).base()
    return lambda effects, score: replace(base, effects=effects, top=replace(base.top, log_evidence=score))


@pytest.mark.parametrize("ahead", [-50.0, 0.0, 10.0, 1000.0])
def test_the_answer_is_first_however_much_more_probable_another_set_is(of, ahead):
    answer, other = of(("lag",), 0.0), of(("lag", "bump"), ahead)
    others = [of((name,), -1.0) for name in ("delay", "dead_band", "parallax", "lean", "slew_limit", "bump")]
    best, *_ = sets = sorted([answer, other, *others], key=lambda one: -one.score)
    likely = Posterior(best, tuple(sets)).likely(answer)
    assert likely[0][0] is answer
    assert sum(chance for _, chance in likely) == pytest.approx(1.0)
    assert all(chance <= likely[0][1] for _, chance in likely)
    assert len(likely) <= config.PLAUSIBLE
    assert (other in [one for one, _ in likely]) == (ahead >= 0.0)


def test_another_name_of_an_effect_is_as_probable_as_the_answer(of):
    answer, renamed = of(("delay",), 0.0), of(("latency",), -40.0)
    likely = Posterior(answer, (answer,)).likely(answer, [renamed])
    assert likely == [(answer, 0.5), (renamed, 0.5)]
