"""Effects that explain recordings as well in place of another are ties; others are not."""

from dataclasses import replace

import pytest

from irt.diagnosis import config
from irt.diagnosis.hypotheses import hypotheses
from irt.diagnosis.score import Scores
from irt.diagnosis.selection import Selection
from irt.diagnosis.sets import Posterior
from irt.diagnosis.ties import exchanged, reason, ties
from irt.diagnosis.validation import Validation


def tied(dataset, asked=None):
    """Return the answer and the ties of its effects; by default all effects are searched."""
    posterior = Selection(Scores(dataset), asked or hypotheses(), lambda _: None).run()
    return posterior.best, ties(exchanged(posterior, Validation()), posterior.best)


@pytest.mark.slow
@pytest.mark.parametrize(
    "planted", [{"name": "delay", "delay_s": 0.15}, {"name": "latency", "latency_s": 0.15}]
)
def test_a_late_command_ties_with_a_late_picture(plant, planted):
    best, found = tied(plant([planted], stamped=True))
    names = {"delay", "latency"}
    assert set(best.effects) < names
    (tie,) = [one for one in found if {one.name, one.instead} == names]
    assert tie.name == best.effects[0]
    assert "lamp" in reason(best, tie)
    # Both have the same delay.
    late = [one.values[f"{one.effects[0]}.{one.effects[0]}_s"] for one in (best, tie.scored)]
    assert late[0] == pytest.approx(late[1], abs=0.01)


@pytest.mark.slow
def test_a_push_does_not_distinguish_them(plant):
    planted = {"name": "latency", "latency_s": 0.15}
    # On a board that is not level, a late picture and a late command show different starts.
    bias = {"name": "tilt_bias", "bias_x_rad": 0.003, "bias_y_rad": -0.002}
    names = {"delay", "latency"}
    asked = [*sorted(names), "tilt_bias", "lag", "bump"]
    best, found = tied(plant([planted, bias], runs=5, stamped=True, pushed=0.1), asked)
    assert names.intersection(best.effects)
    (tie,) = [one for one in found if {one.name, one.instead} == names]
    assert "the random push hides" in reason(best, tie)


@pytest.mark.slow
@pytest.mark.parametrize("level", [True, False])
def test_where_they_differ_the_recordings_must_agree_on_one_of_them(plant, monkeypatch, level):
    """On a board that leans, the marble sets off at once, and only a late picture shows it at rest."""
    monkeypatch.setattr(config, "SAME", 0.0)
    names = ["delay", "latency"]
    planted = [{"name": "latency", "latency_s": 0.15}]
    if not level:
        planted.append({"name": "tilt_bias", "bias_x_rad": 0.003, "bias_y_rad": -0.002})
    best, found = tied(plant(planted, runs=5, stamped=True), [*names, "tilt_bias"])
    late = [{one.name, one.instead} for one in found if one.name in names]
    assert late == ([set(names)] if level else [])
    assert level or "latency" in best.effects


def test_of_sets_about_as_probable_one_name_stands_in_the_place_of_another(plant):
    scores = Scores(plant([{"name": "delay", "delay_s": 0.15}], stamped=True))
    base = scores.base()

    def of(effects, less):
        return replace(base, effects=effects, top=replace(base.top, log_evidence=-less))

    best = of(("lag", "bump"), 0.0)
    near, far = of(("bump", "delay"), 0.5 * config.TIE), of(("lag", "point_field"), 2.0 * config.CLOSE)
    (found,) = exchanged(Posterior(best, (best, near, of(("lag",), 0.1), far)), Validation())
    assert (found.name, found.instead, found.scored) == ("lag", "delay", near)


class Judged(Validation):
    """A validation whose answer is given by a test."""

    def __init__(self, better):
        super().__init__()
        self.better = better

    def is_better(self, one, than):
        return self.better


@pytest.mark.parametrize(
    ("less", "better", "tie"),
    [
        (0.5 * config.TIE, True, True),
        (0.5 * config.CLOSE, False, True),
        (0.5 * config.CLOSE, True, False),
        (2.0 * config.CLOSE, False, False),
    ],
)
def test_within_what_engines_differ_by_held_out_recordings_decide(plant, less, better, tie):
    base = Scores(plant([], stamped=True)).base()
    best, other = (
        replace(base, effects=(name,), top=replace(base.top, log_evidence=-worse))
        for name, worse in (("stribeck", 0.0), ("static_friction", less))
    )
    assert bool(exchanged(Posterior(best, (best, other)), Judged(better))) is tie
    # An effect that would not be named itself does not tie with one that is.
    nothing = replace(base, top=replace(base.top, log_evidence=0.5 * config.SURE - less - base.price))
    assert bool(exchanged(Posterior(best, (best, other, nothing)), Judged(better))) is (less < config.TIE)


@pytest.mark.slow
def test_what_is_distinct_ties_with_nothing(plant):
    best, found = tied(plant([{"name": "viscous_drag", "rate_per_s": 0.8}], runs=5, stamped=True))
    assert best.effects == ("viscous_drag",)
    assert found == []
