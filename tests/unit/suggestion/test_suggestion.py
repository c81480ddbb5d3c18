from __future__ import annotations

import dataclasses
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.errors import IrtError
from irt.fitting.least_squares import least_squares
from irt.model import Effect, Model
from irt.recording import CMD, Recording, load_commands
from irt.rig import RANGES, Board, Commands, Marble, Rig
from irt.suggestion import Suggestion, suggest
from irt.suggestion.excitations import FAMILIES, GENES, Limits, as_recorded, draw

VALUES = (0.07, 0.06, 0.0005, 20.0, 1.0)
NOISE = 0.001
ROWS = 80
LAG = Effect("lag", {"time_constant_s": 0.08})
DELAY = Effect("delay", {"delay_s": 0.08})


def played(name: str, knobs: np.ndarray, hidden: tuple[Effect, ...], start=(0.0, 0.0), seed: int = 0):
    effects = [{"name": one.name, **one.parameters} for one in hidden]
    path = rollouts([VALUES], knobs, effects=effects, start=start, time_step="continuous")[0]
    path += NOISE * np.random.default_rng([seed, len(name)]).normal(size=path.shape)
    return Recording(name, Path(name), knobs, path)


def rig_with(*hidden: Effect, start: tuple[float, float] = (0.0, 0.0)) -> Rig:
    """Four smooth runs, as most people would record them."""
    rng = np.random.default_rng(1)
    time = np.arange(ROWS)[:, None] / ROWS
    runs = []
    for number in range(4):
        cycles = np.array([1.0, 1.3]) * (1.0 + 0.3 * number)
        knobs = [0.1, 0.08] * np.sin(2.0 * np.pi * (cycles * time + rng.random(2)))
        runs.append(played(f"run-{number + 1}", knobs, hidden, start, number))
    return Rig(Path("planted"), Board(), Marble(), "rest", dict(RANGES), tuple(runs))


def model_of(rig: Rig, *effects: Effect) -> Model:
    return Model.from_rig(rig, VALUES, effects=effects, time_step="continuous")


def fitted(rig: Rig, *effects: Effect) -> Model:
    return least_squares(rig, effects=effects, starts=4, seed=1, threads=1).model


@pytest.fixture(scope="module")
def lagging() -> Rig:
    return rig_with(LAG)


@pytest.fixture(scope="module")
def lag_or_delay(lagging: Rig) -> tuple[Model, Model]:
    return fitted(lagging, LAG), fitted(lagging, DELAY)


@pytest.fixture(scope="module")
def suggestion(lagging: Rig, lag_or_delay: tuple[Model, Model]) -> Suggestion:
    return suggest(lagging, lag_or_delay, NOISE, threads=1)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search less where the outcome does not depend on how good it is."""
    search = import_module("irt.suggestion.search")
    monkeypatch.setattr(search, "_DRAWN", 6)
    monkeypatch.setattr(search, "_ROUNDS", 2)


@pytest.mark.slow
def test_a_lag_is_separated_from_a_delay_several_times_better_than_by_runs_as_recorded(
    suggestion: Suggestion,
) -> None:
    [pair] = suggestion.separation
    assert (pair.first, pair.second, pair.alike) == (("lag",), ("delay",), False)
    assert pair.nats > 4.0 * pair.random_nats
    assert pair.distance > 2.0 * pair.random_distance
    assert (
        suggestion.random_information
        < suggestion.information
        <= suggestion.doubt
        == pytest.approx(np.log(2.0))
    )
    assert "Separated: lag and delay." in suggestion.sentences[2]


@pytest.mark.slow
def test_what_is_promised_is_what_refits_find(lagging: Rig, lag_or_delay, suggestion: Suggestion) -> None:
    def against_delay(new: Recording) -> float:
        more = dataclasses.replace(lagging, recordings=(*lagging.recordings, new))
        losses = []
        for model in lag_or_delay:
            fit = least_squares(more, effects=model.effects, starts=4, seed=1, threads=1)
            squares = np.concatenate([one.ravel() for one in fit.residuals]) ** 2
            losses.append(2.5 * np.log1p(squares / (4.0 * NOISE**2)).sum())
        return losses[1] - losses[0]

    recorded = as_recorded(lagging, Limits.of(lagging, None))[5]
    suggested = against_delay(played("new", suggestion.commands, (LAG,), suggestion.start))
    random = against_delay(played("new", recorded.commands, (LAG,), recorded.start))
    assert suggested > random + 0.5 * suggestion.separation[0].nats


@pytest.mark.slow
def test_viscous_is_separated_from_quadratic_drag() -> None:
    viscous, quadratic = (
        Effect("viscous_drag", {"rate_per_s": 0.15}),
        Effect("quadratic_drag", {"coefficient_per_m": 2.0}),
    )
    rig = rig_with(viscous)
    [pair] = suggest(rig, [fitted(rig, viscous), fitted(rig, quadratic)], NOISE, threads=1).separation
    assert pair.nats > 3.0 * pair.random_nats


@pytest.mark.usefixtures("quick")
def test_no_drive_separates_a_delay_from_a_latency_and_other_means_are_named() -> None:
    rig = rig_with(DELAY)
    other = Model.from_rig(
        rig,
        # As far along an unidentified direction as another fit may end.
        np.array(VALUES) * [1.1, 1.1, 1.1, 1.1**-0.5, 1.0],
        effects=[Effect("latency", {"latency_s": 0.08 * 1.1**-0.5})],
        time_step="continuous",
    )
    found = suggest(rig, [model_of(rig, DELAY), other], NOISE, threads=1)
    [pair] = found.separation
    assert pair.alike
    assert pair.most_nats == 0.0
    text = " ".join(found.sentences)
    assert "No commands separate delay and latency" in text
    assert "a lamp in the camera's view" in text
    assert "sharpens the parameters" in text


@pytest.mark.usefixtures("quick")
def test_what_is_known_already_is_no_doubt(lagging: Rig, lag_or_delay: tuple[Model, Model]) -> None:
    even, sure = (
        suggest(lagging, lag_or_delay, NOISE, probabilities=chances, threads=1)
        for chances in ((1.0, 1.0), (0.999, 0.001))
    )
    assert sure.doubt == pytest.approx(0.0079, abs=1e-4)
    assert 0.0 < sure.information < sure.doubt < even.information < even.doubt


@pytest.mark.parametrize("chances", [[1.0], [0.5, -0.1], [0.5, float("nan")]])
def test_bad_probabilities(lagging: Rig, lag_or_delay: tuple[Model, Model], chances: list[float]) -> None:
    with pytest.raises(IrtError, match="probabilities: expected 2 numbers above 0, one for each model"):
        suggest(lagging, lag_or_delay, NOISE, probabilities=chances)


@pytest.mark.usefixtures("quick")
def test_two_fits_of_the_same_physics_are_not_separated() -> None:
    rig = rig_with()
    moved = Model.from_rig(
        rig, np.array(VALUES) * [1.05, 1.05, 1.05, 1.05**-0.5, 1.0], time_step="continuous"
    )
    [pair] = suggest(rig, [model_of(rig), moved], NOISE, threads=1).separation
    assert pair.nats < 1.0


def test_with_one_model_its_parameters_are_sharpened() -> None:
    rig = rig_with(DELAY)
    found = suggest(rig, [model_of(rig, DELAY)], NOISE, threads=1)
    assert found.separation == ()
    assert found.gain > found.random_gain > 0.0
    assert set(found.remaining) > {"gear_x", "delay.delay_s"}
    assert 0.0 < min(found.remaining.values()) < 0.95
    assert max(found.remaining.values()) <= 1.0 + 1e-9
    assert "sharpens the parameters" in found.sentences[-1]


def test_limits_are_those_of_the_recordings(lagging: Rig, suggestion: Suggestion) -> None:
    limits = Limits.of(lagging, None)
    knobs = np.array([one.knobs for one in lagging.recordings])
    np.testing.assert_array_equal(limits.amplitude, np.abs(knobs).max(axis=(0, 1)))
    assert suggestion.commands.shape == (ROWS, 2)
    assert (np.abs(suggestion.commands) <= limits.amplitude).all()
    assert (np.abs(np.diff(suggestion.commands, axis=0, prepend=0.0)) <= limits.rate).all()
    np.testing.assert_array_equal(suggestion.start, [0.0, 0.0])
    assert "in the centre" in suggestion.sentences[0]


@pytest.mark.parametrize("family", FAMILIES)
def test_every_member_of_a_family_can_be_played(family: str) -> None:
    limits = Limits(
        np.array([0.1, 0.05]), np.array([0.01, 0.02]), 60, None, np.array([[0.0, 0.0], [0.1, 0.2]])
    )
    rng = np.random.default_rng(2)
    turned, places = np.zeros(2), set()
    for genes in [np.zeros(GENES), np.ones(GENES), *rng.random((60, GENES))]:
        run = draw(family, genes, limits)
        assert run.commands.shape == (60, 2)
        assert not run.commands[0].any()
        assert (np.abs(run.commands) <= limits.amplitude).all()
        assert (np.abs(np.diff(run.commands, axis=0)) <= limits.rate).all()
        assert run.words.endswith(" rad")
        turned = np.maximum(turned, np.abs(run.commands).max(axis=0))
        places.add(tuple(run.start))
    assert (turned > 0.0).all()
    assert len(places) == 2


@pytest.mark.usefixtures("quick")
def test_a_knob_that_never_moved_stays_level() -> None:
    rig = rig_with()
    still = [
        dataclasses.replace(one, knobs=one.knobs * [1.0, 0.0], marble=one.marble * [0.0, 1.0])
        for one in rig.recordings
    ]
    rig = dataclasses.replace(rig, recordings=tuple(still))
    assert not suggest(rig, [model_of(rig)], NOISE, threads=1).commands[:, 1].any()


@pytest.mark.usefixtures("quick")
def test_runs_start_where_recordings_do() -> None:
    rig = rig_with(start=(0.1, -0.05))
    found = suggest(rig, [model_of(rig)], NOISE, threads=1)
    np.testing.assert_allclose(found.start, [0.1, -0.05], atol=3 * NOISE)
    assert "at x 0.1" in found.sentences[0]


@pytest.mark.usefixtures("quick")
def test_recordings_with_stamps_get_commands_with_stamps(tmp_path: Path) -> None:
    stamps = np.arange(ROWS) * 20.0 / 240.0
    rig = rig_with()
    runs = tuple(dataclasses.replace(one, stamps=stamps) for one in rig.recordings)
    rig = dataclasses.replace(rig, recordings=runs)
    found = suggest(rig, [model_of(rig, LAG), model_of(rig, DELAY)], NOISE, threads=1)
    assert " s" in found.sentences[0].partition(":")[0]
    found.save(tmp_path / "suggest.csv")
    back = load_commands(tmp_path / "suggest.csv")
    np.testing.assert_array_equal(back.knobs, found.commands)
    np.testing.assert_array_equal(back.start, found.start)
    assert back.stamps is not None
    np.testing.assert_allclose(back.stamps, stamps, atol=1e-6)  # as written, to the microsecond


@pytest.mark.usefixtures("quick")
def test_commands_in_the_rigs_own_unit_are_suggested_in_it(tmp_path: Path) -> None:
    rig = rig_with()
    runs = tuple(dataclasses.replace(one, knobs=2000.0 * one.knobs, columns=CMD) for one in rig.recordings)
    ranges = {**rig.ranges, "gear_x": (0.0, 5e-5), "gear_y": (0.0, 5e-5)}
    rig = dataclasses.replace(rig, recordings=runs, commands=Commands("us"), ranges=ranges)
    values = (VALUES[0] / 2000.0, VALUES[1] / 2000.0, *VALUES[2:])
    models = [Model.from_rig(rig, values, effects=(one,), time_step="continuous") for one in (LAG, DELAY)]
    found = suggest(rig, models, NOISE, threads=1)
    assert " us" in found.sentences[0]
    found.save(tmp_path / "suggest.csv")
    back = load_commands(tmp_path / "suggest.csv")
    assert back.columns == CMD
    np.testing.assert_array_equal(back.knobs, found.commands)
    assert np.abs(back.knobs).max() <= max(np.abs(one.knobs).max() for one in runs)


@pytest.mark.usefixtures("quick")
def test_the_seed_decides_and_the_number_of_threads_does_not(lagging: Rig, lag_or_delay) -> None:
    one, two = (suggest(lagging, lag_or_delay, NOISE, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.commands, two.commands)
    assert (one.separation, one.sentences) == (two.separation, two.sentences)
    drawn = [suggest(lagging, lag_or_delay[:1], NOISE, seed=seed, threads=1) for seed in (0, 1)]
    assert not np.array_equal(drawn[0].commands, drawn[1].commands)


@pytest.mark.usefixtures("quick")
def test_progress_is_reported(lagging: Rig, lag_or_delay) -> None:
    calls: list[tuple[int, int, str]] = []
    suggest(lagging, lag_or_delay[:1], NOISE, threads=1, progress=lambda *call: calls.append(call))
    assert [done for done, _, _ in calls] == list(range(len(calls)))
    assert {total for _, total, _ in calls} == {len(calls)}


@pytest.mark.parametrize("noise", [0.0, -1.0, np.nan, np.inf])
def test_noise_that_is_none(lagging: Rig, lag_or_delay, noise: float) -> None:
    with pytest.raises(IrtError, match=r"noise: expected a standard deviation above 0 \[board edges\], got"):
        suggest(lagging, lag_or_delay, noise)


def test_nothing_to_go_by(lagging: Rig) -> None:
    with pytest.raises(IrtError, match="models: expected at least one"):
        suggest(lagging, [], NOISE)
    level = tuple(dataclasses.replace(one, knobs=np.zeros((ROWS, 2))) for one in lagging.recordings)
    with pytest.raises(IrtError, match="planted: no recording moves a knob"):
        suggest(dataclasses.replace(lagging, recordings=level), [model_of(lagging)], NOISE)


def test_an_unknown_effect_is_named(lagging: Rig) -> None:
    with pytest.raises(IrtError, match='unknown effect "lagg"; did you mean "lag"'):
        suggest(lagging, [model_of(lagging, Effect("lagg", {}))], NOISE)
