"""Named effects are nonzero, and held-out errors increase without them."""

from dataclasses import replace

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis import config, intervals
from irt.diagnosis.hypotheses import INERTIA
from irt.diagnosis.relevance import Relevance
from irt.diagnosis.score import Scores
from irt.diagnosis.selection import Selection
from irt.diagnosis.validation import Validation

DELAY = {"name": "delay", "delay_s": 0.15}
ASKED = ("delay", "lag", "backlash", "tilt_bias", "viscous_drag", "bump")


def judged(dataset):
    selection = Selection(Scores(dataset), ASKED, lambda _: None)
    posterior = selection.run()
    return posterior.best, Relevance(selection, posterior)


@pytest.mark.slow
def test_every_effect_that_is_kept_is_lost_without(plant):
    bias = {"name": "tilt_bias", "bias_x_rad": 0.0015, "bias_y_rad": -0.001}
    best, relevance = judged(plant([DELAY, bias], runs=5, stamped=True))
    kept, _ = relevance.kept(relevance.freed(best))
    assert set(kept.effects) == {"delay", "tilt_bias"}
    found, _ = relevance.parameters(kept)
    for name in kept.effects:
        assert relevance.loss(kept, name) >= config.MATTERS * kept.dataset.noise
        sizes = [(found[f"{name}.{one.name}"], one.neutral) for one in effect(name).required]
        assert any(not one.low <= neutral <= one.high for one, neutral in sizes)


@pytest.mark.slow
def test_an_effect_that_does_not_matter_is_not_kept(plant):
    """A tilt with an effect of one noise is detected, but does not improve predictions."""
    bias = {"name": "tilt_bias", "bias_x_rad": 3e-6, "bias_y_rad": 0.0}
    best, relevance = judged(plant([DELAY, bias], runs=5, stamped=True))
    kept, immaterial = relevance.kept(best)
    assert kept.effects in {("delay",), ("latency",)}
    assert immaterial <= {"tilt_bias"}
    assert immaterial == set(best.effects) - {"delay", "latency"}
    assert immaterial.isdisjoint(relevance.posterior.probabilities(immaterial))


def test_of_nothing_nothing_is_kept(plant):
    best, relevance = judged(plant(stamped=True))
    assert relevance.kept(relevance.freed(best)) == (best, frozenset())


@pytest.mark.slow
def test_where_free_runs_are_off_by_noise_the_values_stay(plant):
    best, relevance = judged(plant([DELAY], runs=4, stamped=True))
    assert relevance.freed(best) is best
    (name,) = best.effects
    less = relevance.without(best, name)
    assert less.effects == ()
    assert relevance.without(best, name) is less


class FreeRunsPredictBest(Validation):
    """A validation in which values from free runs predict held-out recordings without any error."""

    def of(self, one):
        found = super().of(one)
        runs = tuple(replace(run, mae=0.0) for run in found.runs) if one.is_free else found.runs
        return replace(found, runs=runs)


@pytest.mark.parametrize("undone", [False, True])
def test_values_from_free_runs_that_undo_an_effect_are_rejected(plant, monkeypatch, undone):
    dataset = plant([DELAY], runs=4, rows=60, stamped=True, pushed=0.1)
    selection = Selection(Scores(dataset), ("delay",), lambda _: None, FreeRunsPredictBest())
    posterior = selection.run()
    best, relevance = posterior.best, Relevance(selection, posterior)
    assert best.effects == ("delay",)
    values = best.top.values.copy()
    if undone:
        values[best.names.index("delay.delay_s")] = 0.0
    monkeypatch.setattr(
        Scores, "freed", lambda _, one: replace(one, top=replace(one.top, values=values), filtered=one)
    )
    assert relevance.freed(best).is_free is not undone


@pytest.mark.parametrize("refused", [False, True])
def test_likelihoods_alone_count_unless_errors_refuse_the_effect(plant, monkeypatch, refused):
    dataset = plant([DELAY], runs=4, rows=60, stamped=True)
    selection = Selection(Scores(dataset), ("delay",), lambda _: None)
    relevance = Relevance(selection, selection.run())
    monkeypatch.setattr(Relevance, "loss", lambda *_: 0.0)
    monkeypatch.setattr(Validation, "is_better", lambda *_: refused)
    kept, _ = relevance.kept(relevance.posterior.best)
    assert bool(kept.effects) is not refused


@pytest.mark.parametrize(("rate", "is_kept"), [(0.0, False), (1.0, False), (20.0, True)])
def test_a_board_that_hardly_turns_throws_no_marble(plant, rate, is_kept):
    scores = Scores(plant(runs=2, rows=40, stamped=True))
    base = scores.base()
    values = scores.from_where(scores.problem((INERTIA,)), base)[None]
    (one,) = scores.ascend((INERTIA,), values, base.noise[None], base.top.states, iterations=1)
    values = one.top.values.copy()
    values[one.names.index(f"{INERTIA}.rate_per_s")] = rate
    selection = Selection(scores, (INERTIA,), lambda _: None)
    relevance = Relevance(selection, selection.run())
    kept, _ = relevance.kept(replace(one, top=replace(one.top, values=values)))
    assert (INERTIA in kept.effects) is is_kept


@pytest.mark.slow
@pytest.mark.parametrize("agreed", [False, True])
def test_delays_only_seem_random_if_windows_agree_that_their_mean_predicts_better(plant, monkeypatch, agreed):
    dataset = plant([DELAY, {"name": "delay_jitter", "sd_s": 0.08}], runs=4, rows=100, stamped=True)
    selection = Selection(Scores(dataset), ("delay", "delay_jitter"), lambda _: None)
    relevance = Relevance(selection, selection.run())
    assert relevance.posterior.best.effects == ("delay_jitter",)
    monkeypatch.setattr(Relevance, "loss", lambda *_: -dataset.noise)
    monkeypatch.setattr(Validation, "windows_agree", lambda *_: agreed)
    kept, _ = relevance.kept(relevance.posterior.best)
    assert ("delay_jitter" in kept.effects) is not agreed


class ChosenAgain(Validation):
    """A validation in which a set with an effect gains enough without `folds` of the recordings only."""

    folds = 0

    def of(self, one):
        found = super().of(one)
        gains = np.full(len(found.scores), 0.5 * config.SURE)
        gains[: self.folds] = 2.0 * config.SURE
        return replace(found, scores=gains if one.effects else np.zeros(len(gains)))


@pytest.mark.parametrize(("folds", "is_kept"), [(4, True), (2, True), (1, False), (0, False)])
def test_an_effect_is_chosen_again_without_most_recordings(plant, monkeypatch, folds, is_kept):
    dataset = plant([DELAY], runs=4, rows=60, stamped=True)
    monkeypatch.setattr(ChosenAgain, "folds", folds)
    selection = Selection(Scores(dataset), ("delay",), lambda _: None, ChosenAgain())
    relevance = Relevance(selection, selection.run())
    kept, immaterial = relevance.kept(relevance.posterior.best)
    assert bool(kept.effects) is is_kept
    assert bool(immaterial) is not is_kept


class WithoutTheEffect(Validation):
    """A validation in which runs are off by 1 % with the effect, and without it by 2 % or by `free`."""

    free = (0.0, 0.0, 0.0, 0.0)

    def of(self, one):
        found = super().of(one)
        own = [0.01] * 4 if one.effects else self.free if one.is_free else [0.02] * 4
        return replace(
            found, runs=tuple(replace(run, mae=mae) for run, mae in zip(found.runs, own, strict=True))
        )


@pytest.mark.parametrize(
    ("free", "is_kept"), [((0.9, 0.0, 0.0, 0.0), True), ((0.05, 0.009, 0.009, 0.009), False)]
)
def test_an_effect_is_judged_beside_the_better_values_without_it(plant, monkeypatch, free, is_kept):
    """Values from free runs that are wild in one run hide no effect; where they predict better, they do."""
    monkeypatch.setattr(WithoutTheEffect, "free", free)
    for name in ("windows_agree", "is_likelier", "each_is_likelier"):
        monkeypatch.setattr(Validation, name, lambda *_: False)
    dataset = plant([DELAY], runs=4, rows=60, stamped=True, pushed=0.1)
    selection = Selection(Scores(dataset), ("delay",), lambda _: None, WithoutTheEffect())
    relevance = Relevance(selection, selection.run())
    assert not relevance.posterior.best.is_exact
    kept, _ = relevance.kept(relevance.posterior.best)
    assert bool(kept.effects) is is_kept


LAG = {"name": "lag", "time_constant_s": 0.1}


@pytest.mark.slow
@pytest.mark.parametrize("late", [{"name": "delay", "delay_s": 0.02}, None])
def test_the_interval_of_a_lag_holds_beside_a_delay_that_is_too_small_to_be_found(plant, late):
    best, relevance = judged(plant([LAG, *([late] if late else [])], rows=90, stamped=True, seed=5))
    assert best.effects == ("lag",)
    found, unknown = relevance.estimates(best)
    lag = found["lag.time_constant_s"]
    assert lag.low < 0.1 < lag.high
    alone = relevance.parameters(best)[0]["lag.time_constant_s"]
    assert (alone.low < 0.1 < alone.high) is (late is None)
    assert any(sentence.startswith("lag and delay: ") for sentence in unknown)


@pytest.mark.parametrize(
    ("effects", "more"),
    [
        (("lag",), "delay"),
        (("delay",), "lag"),
        (("latency",), "lag"),
        (("delay", "lag"), None),
        (("lag", "latency"), None),
        (("delay_jitter",), None),
        (("tilt_bias",), None),
        ((), None),
    ],
)
def test_of_delay_and_lag_the_missing_one_is_put_beside_the_other(plant, effects, more):
    scores = Scores(plant([LAG], runs=2, rows=40, stamped=True))
    base = scores.base()
    problem = scores.problem(effects)
    values = scores.from_where(problem, base)[None]
    (one,) = scores.ascend(effects, values, base.noise[None], base.top.states, iterations=2)
    both = intervals.with_delay_and_lag(one)
    assert (both and both.effects) == (more and (*effects, more))
