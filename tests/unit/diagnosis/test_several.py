"""Several effects at once, where the marble is also pushed by what never repeats."""

from dataclasses import replace

import numpy as np
import pytest

from irt.diagnosis import config
from irt.diagnosis.score import PULL, PUSH, Scores
from irt.diagnosis.screening import Screening
from irt.diagnosis.search import Search
from irt.diagnosis.selection import Selection
from irt.diagnosis.several import several
from irt.segments import segments

BIAS = {"name": "tilt_bias", "bias_x_rad": 0.003, "bias_y_rad": -0.002}
DELAY = {"name": "delay", "delay_s": 0.15}
DRAG = {"name": "viscous_drag", "rate_per_s": 0.6}
ASKED = ("delay", "lag", "backlash", "tilt_bias", "bump", "viscous_drag", "stribeck")


def quiet(_text: str) -> None:
    """Say nothing."""


def pushed(case, share, seed=3):
    """Return a case whose knobs did not quite do what the recordings say."""
    random = np.random.default_rng(seed)
    runs = tuple(
        replace(
            one, knobs=one.knobs + share * np.abs(one.knobs).max() * random.standard_normal(one.knobs.shape)
        )
        for one in case.rig.recordings
    )
    rig = replace(case.rig, recordings=runs)
    return replace(case, rig=rig, segments=tuple(segments(rig)))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.1])
def test_effects_that_act_together_are_found_whatever_pushes_besides(plant, share):
    case = pushed(plant([DELAY, BIAS, DRAG], runs=6, rows=100), share)
    posterior = Selection(Scores(case), ASKED, quiet).run()
    assert set(posterior.best.effects) == {"delay", "tilt_bias", "viscous_drag"}
    # Without stamps a delay is known in rows.
    rows = posterior.best.values["delay.delay_s"] / posterior.best.values["time_scale"]
    assert rows == pytest.approx(0.15 / 15.0, rel=0.1)
    assert all(posterior.inclusion(name) > 0.95 for name in posterior.best.effects)
    assert posterior.inclusion("bump") < 0.5
    assert set(posterior.probabilities()) >= set(posterior.best.effects)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.1])
def test_a_push_alone_asks_for_no_effect(plant, share):
    case = pushed(plant([], runs=6, rows=100), share)
    scores = Scores(case)
    posterior = Selection(scores, ASKED, quiet).run()
    assert posterior.best.effects == ()
    assert (scores.push(posterior.best) > config.SURE) is (share > 0.0)


def test_the_push_that_a_set_needs_shrinks_with_the_right_effect(plant):
    case = plant([DELAY], runs=4)
    scores = Scores(case)
    base = scores.base()
    (promise,) = Screening(scores, base).promises(["delay"])
    noise = np.tile(base.noise, (len(promise.starts), 1))
    found = scores.ascend(("delay",), promise.starts, noise, base.top.states, iterations=25)
    best = max(found, key=lambda one: one.score)
    assert best.score > base.score + 20.0
    assert best.noise[PULL] + np.sqrt(best.noise[PUSH]) < base.noise[PULL] + np.sqrt(base.noise[PUSH])


def test_the_effect_that_acts_promises_most(plant):
    case = plant([BIAS], runs=4)
    scores = Scores(case)
    promises = Screening(scores, scores.base()).promises(["viscous_drag", "tilt_bias", "backlash"])
    assert promises[0].name == "tilt_bias"
    assert promises[0].gain > promises[1].gain + 5.0


@pytest.mark.slow
def test_an_effect_that_does_not_matter_is_not_named(plant):
    """Runs held out are predicted as well without a tilt that moves the marble by one noise."""
    case = plant([{**DELAY}, {"name": "tilt_bias", "bias_x_rad": 3e-6, "bias_y_rad": 0.0}], runs=6)
    search = Search(case, quiet)
    search.keep(case.fit(starts=8))
    assert several(search).fitted.effects == ("delay",)


def test_threads_change_no_bit(plant):
    tops = [Scores(replace(plant([DELAY]), threads=threads)).base().top for threads in (1, 2, 4)]
    assert all(np.array_equal(tops[0].values, one.values) for one in tops)
    assert len({one.log_evidence for one in tops}) == 1
