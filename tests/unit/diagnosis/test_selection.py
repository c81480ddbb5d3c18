"""The most probable set of effects is the planted one, with and without a random push."""

from types import SimpleNamespace

import numpy as np
import pytest

from irt.catalogue import effect, effects
from irt.diagnosis import config
from irt.diagnosis.hypotheses import MAP, hypotheses
from irt.diagnosis.score import KICK, LASTING, OF_EFFECTS, PULL, PUSH, RELEASE, Scores, mean_delay, of_effects
from irt.diagnosis.screening import Screening
from irt.diagnosis.selection import Selection
from irt.diagnosis.validation import Validation
from irt.engine import SUBSTEP_S

BIAS = {"name": "tilt_bias", "bias_x_rad": 0.0015, "bias_y_rad": -0.001}
BUMP = {"name": "bump", "x_m": 0.02, "y_m": -0.015, "height_m": 2e-4, "width_m": 0.02}
DELAY = {"name": "delay", "delay_s": 0.15}
DRAG = {"name": "viscous_drag", "rate_per_s": 0.8}
LAG = {"name": "lag", "time_constant_s": 0.15}
PARALLAX = {"name": "parallax", "height_m_per_rad": 0.4}
#: Random deviation of the knobs as a share of the largest command, which pushes the marble.
PUSHED = 0.05


def quiet(_text: str) -> None:
    """Ignore progress."""


def select(dataset):
    """Return the scores and the posterior of a search over all effects."""
    scores = Scores(dataset)
    return scores, Selection(scores, hypotheses(), quiet).run()


@pytest.mark.parametrize(
    ("index", "start", "effects"),
    [
        (RELEASE, config.RELEASE, ["static_friction"]),
        (RELEASE, config.RELEASE, ["stribeck"]),
        (KICK, config.KICK, ["delay_jitter"]),
    ],
)
def test_noise_sizes_of_effects_are_zero_without_them(index, start, effects):
    noise = np.full((2, 14), 0.5)
    noise[0, index] = 0.0
    assert of_effects(noise, ["viscous_drag", *effects])[:, index].tolist() == [start, 0.5]
    others = [RELEASE, KICK]
    without = of_effects(noise, ["viscous_drag", "unlisted"])
    assert not without[:, others].any()
    assert (np.delete(without, others, axis=1) == 0.5).all()


def test_each_noise_size_of_an_effect_has_a_place_in_the_filter():
    assert {one.noise for one in effects()} - {None} == set(OF_EFFECTS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planted", "pushed"),
    [
        ([DRAG], PUSHED),
        ([LAG], PUSHED),
        ([PARALLAX], 0.0),
        ([BUMP], 0.0),
        ([DELAY, BIAS, DRAG], PUSHED),
    ],
    ids=["drag", "lag", "parallax", "bump", "three"],
)
def test_what_is_planted_is_selected_beside_any_push(plant, planted, pushed):
    scores, posterior = select(plant(planted, runs=5, stamped=True, pushed=pushed))
    best, names = posterior.best, {one["name"] for one in planted}
    assert set(best.effects) == names
    chances = posterior.probabilities(())
    assert all(chances[name] > 0.9 for name in names)
    assert all(0.0 <= chance <= 1.0 for chance in chances.values())
    # Cases with a random push need one in the model.
    assert (scores.push(best) > config.SURE) is (pushed > 0.0)
    for one in planted:
        for name, value in one.items():
            if name != "name":
                spread = 0.3 if pushed else 0.1
                assert best.values[f"{one['name']}.{name}"] == pytest.approx(value, rel=spread, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("pushed", [0.0, PUSHED])
def test_an_uneven_board_is_no_bump(plant, pushed):
    random = np.random.default_rng(5)
    slopes = {one.name: 5e-4 * random.standard_normal() for one in effect(MAP).parameters}
    planted = [{"name": MAP, **slopes}, DELAY]
    _, posterior = select(plant(planted, runs=5, rows=100, stamped=True, pushed=pushed))
    best = posterior.best
    assert set(best.effects) == {MAP, "delay"}
    found = np.array([best.values[f"{MAP}.{name}"] for name in slopes])
    wanted = np.array(list(slopes.values()))
    # Random pushes in each row hide fine waves.
    assert np.corrcoef(found, wanted)[0, 1] > (0.8 if pushed else 0.98)


@pytest.mark.slow
def test_without_stamps_a_delay_is_known_in_rows(plant):
    _, posterior = select(plant([DELAY, BIAS], runs=5, pushed=PUSHED))
    assert set(posterior.best.effects) == {"delay", "tilt_bias"}
    rows = posterior.best.values["delay.delay_s"] / posterior.best.values["time_scale"]
    assert rows == pytest.approx(0.15 / 15.0, rel=0.3)


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_where_nothing_is_planted_nothing_is_even_tried(plant, seed, stamped):
    tried = []
    posterior = Selection(Scores(plant(seed=seed, stamped=stamped)), hypotheses(), tried.append).run()
    assert posterior.best.effects == ()
    assert tried == []
    assert posterior.probabilities(()) == {}


@pytest.mark.slow
@pytest.mark.parametrize("beside", [DELAY, DRAG])
def test_two_effects_that_imitate_a_third_are_merged(plant, beside):
    field = {"name": "point_field", "x_m": 0.2, "y_m": -0.17, "strength_m3_per_s2": 0.0028}
    scores = Scores(plant([field, beside], seed=1))
    imitated = Selection(scores, ["board_warp", "bump", beside["name"]], quiet).run().best
    assert len(imitated.effects) == 3
    merged = Selection(scores, hypotheses(), quiet).merged(imitated)
    assert set(merged.effects) == {"point_field", beside["name"]}
    assert merged.score > imitated.score + config.NEAR


@pytest.mark.slow
def test_effects_are_compared_with_the_five_parameters_that_predict_best(plant):
    """Not with those that are likeliest, because correlated noise may be the whole path there."""
    scores = Scores(plant([BIAS]))
    base = scores.base()
    values, noise = base.top.values.copy(), base.noise.copy()
    values[:2] *= 0.01
    noise[LASTING] = 0.1
    (resting,) = scores.ascend((), values[None], noise[None], iterations=2)
    scores.known[frozenset()] = resting
    selection = Selection(scores, hypotheses(), quiet)
    assert selection.baseline.effects == ()
    errors = [selection.validation.of(one).mae for one in (selection.baseline, base, resting)]
    assert errors[0] == min(errors)


@pytest.mark.parametrize(
    ("gain", "agreed", "taken"),
    [(5.0, False, True), (4.0, True, True), (4.0, False, False), (2.9, True, False)],
)
def test_what_held_out_recordings_agree_on_needs_less_evidence(gain, agreed, taken):
    class Agreed(Validation):
        def is_better(self, one, than):
            return agreed

    search = Selection(None, (), quiet, validation=Agreed())
    one, less = (SimpleNamespace(score=score) for score in (gain, 0.0))
    assert (search._if_better(one, less, None) is one) is taken


@pytest.mark.slow
def test_a_push_alone_asks_for_no_effect(plant):
    scores, posterior = select(plant(runs=5, seed=1, stamped=True, pushed=PUSHED))
    assert posterior.best.effects == ()
    assert scores.push(posterior.best) > config.SURE
    assert all(chance < 0.5 for chance in posterior.probabilities(()).values())


@pytest.mark.slow
def test_without_stamps_delays_that_differ_are_selected_and_sized(plant):
    jitter = {"name": "delay_jitter", "sd_s": 0.08}
    _, posterior = select(plant([DELAY, jitter], runs=5, rows=120))
    best = posterior.best
    assert best.effects == ("delay_jitter",)
    rows = best.noise[KICK] / best.values["time_scale"]
    assert 0.5 < rows / (0.08 / 15.0) < 2.0
    assert mean_delay(best.values) / best.values["time_scale"] == pytest.approx(0.01, rel=0.4)


@pytest.mark.slow
def test_the_same_delay_each_time_does_not_differ(plant):
    _, posterior = select(plant([DELAY], runs=5, rows=120, stamped=True))
    assert posterior.best.effects in {("delay",), ("latency",)}
    assert posterior.any_of(["delay_jitter"]) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("delay_s", "rate_rad_per_s", "seed"), [(0.3, 0.15, 1), (0.4, 0.2, 3)])
def test_delays_that_seem_to_differ_are_a_delay_and_another_effect(plant, delay_s, rate_rad_per_s, seed):
    """Jitter, which counts as two effects, was never compared with two others if it was named first."""
    slow = {"name": "slew_limit", "rate_rad_per_s": rate_rad_per_s}
    scores = Scores(plant([{**DELAY, "delay_s": delay_s}, slow], rows=90, stamped=True, seed=seed))
    best = Selection(scores, ["delay", "lag", "delay_jitter", "slew_limit"], quiet).run().best
    assert "slew_limit" in best.effects
    assert {"delay", "latency"}.intersection(best.effects)
    assert "delay_jitter" not in best.effects


@pytest.mark.slow
def test_the_push_that_a_set_needs_shrinks_with_the_right_effect(plant):
    scores = Scores(plant([DELAY], stamped=True))
    base = scores.base()
    (promise,) = Screening(scores, base).promises(["delay"])
    noise = np.tile(base.noise, (len(promise.starts), 1))
    found = scores.ascend(("delay",), promise.starts, noise, base.top.states, iterations=25)
    best = max(found, key=lambda one: one.score)
    assert best.score > base.score + 20.0
    # Correlated tracker noise would explain a lagging board about as well as a push.
    lasts = [PUSH, PULL, LASTING]
    assert scores.loss_without(best, lasts) < 0.5 * scores.loss_without(base, lasts)


def test_an_effect_more_costs_its_choice(plant):
    scores = Scores(plant(runs=2, rows=40))
    prices = [scores.price(effects) for effects in ((), ("lag",), ("lag", "bump"))]
    assert prices[0] == 0.0
    assert prices[0] < prices[1] < prices[2]
    # Mean and spread count separately.
    assert scores.price(["delay_jitter"]) == scores.price(["delay", "lag"])


@pytest.mark.slow
def test_a_filter_goes_through_whole_recordings_of_a_marble_in_motion(plant, in_motion):
    rows, gone = 200, 40
    dataset = in_motion(plant([DRAG], runs=4, rows=rows, stamped=True, pushed=PUSHED), gone)
    # The board still follows unknown commands in the first half second.
    known = rows - gone - round(0.5 / dataset.time_scale / SUBSTEP_S)
    assert [len(one.knobs) for one in dataset.runs] == [known] * 4
    assert len(dataset.segments) > len(dataset.runs)
    assert list(dataset.only([1, 3]).run_folds) == [1, 3]
    scores = Scores(dataset)
    posterior = Selection(scores, ["delay", "lag", "viscous_drag", "point_field"], quiet).run()
    assert posterior.best.effects == ("viscous_drag",)
    assert len(posterior.best.top.states) == len(dataset.runs)


@pytest.mark.slow
def test_an_effect_shows_where_the_marble_is_expected_to_move(plant):
    """A proof's rig moved in two of eight runs; the likeliest five parameters let time stand still."""
    backlash = {"name": "backlash", "width_x_rad": 0.14, "width_y_rad": 0.12}
    scores = Scores(plant([backlash], runs=4))
    values, noise = scores.base().top.values.copy(), scores.base().noise.copy()
    values[:4] = 1e-3, 1e-3, 1e-5, 0.5
    noise[[LASTING, PUSH, PULL]] = 0.0
    (resting,) = scores.ascend((), values[None], noise[None], iterations=config.THOROUGH)
    scores.known, scores.fits_of_base = {frozenset(): resting}, [resting]
    assert scores.is_whole(resting)
    found = Selection(scores, ["backlash", "lag", "parallax"], quiet).run().best
    assert found.effects == ("backlash",)
    assert found.values["backlash.width_x_rad"] == pytest.approx(0.14, rel=0.05)
    assert found.values["backlash.width_y_rad"] == pytest.approx(0.12, rel=0.05)
    assert found.score > resting.score + config.NEAR


@pytest.mark.slow
def test_a_restart_leads_from_wrong_values_to_those_planted(plant):
    """The likelihood of a knob's steps has many maxima."""
    name = "command_quantisation"
    scores = Scores(plant([{"name": name, "step_rad": 0.018}], runs=5))
    base = scores.base()
    values = np.append(base.top.values, 0.0067)[None]
    (wrong,) = scores.ascend((name,), values, base.noise[None], base.top.states, iterations=40)
    assert wrong.values[f"{name}.step_rad"] < 0.01
    found = Selection(scores, hypotheses(), quiet)._restarted(wrong)
    assert found.values[f"{name}.step_rad"] == pytest.approx(0.018, rel=0.02)
    assert Selection(scores, hypotheses(), quiet)._restarted(found) is None


def test_an_effect_is_not_kept_for_a_poor_fit_without_it(plant, monkeypatch):
    """A lag gains 30 nats beside a delay that is fitted far from its value, and nothing else."""
    scores = Scores(plant([DELAY], runs=2, rows=40, stamped=True))

    def fit(effects, source, values, iterations):
        problem = scores.problem(effects)
        start = {**dict(zip(problem.names, scores.from_where(problem, source), strict=True)), **values}
        begin = np.array([start[name] for name in problem.names])[None]
        return scores.ascend(effects, begin, source.noise[None], source.top.states, iterations=iterations)

    (one,) = fit(("delay", "lag"), scores.base(), {"delay.delay_s": 0.1, "lag.time_constant_s": 0.05}, 40)
    monkeypatch.setattr(Selection, "_refitted", lambda _, of, rest: fit(rest, of, {"delay.delay_s": 0.05}, 1))
    selection = Selection(scores, ["delay", "lag"], quiet)
    assert one.score > selection.without(one, "lag").score + config.SURE
    assert selection._pruned(one).effects == ("delay",)
