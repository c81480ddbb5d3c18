"""What the leftover depends on, and what is learned of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis import unlisted
from irt.diagnosis.latent import Leftover
from irt.diagnosis.library import Term, of_slot
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.search import Search
from irt.diagnosis.unlisted import Library, _refined, formula, learn, variables
from irt.diagnosis.view import likely_terms, motion_seen


def wave(**changes):
    values = {"push_1_x_m_per_s2": 0.02, "wave_1_x_per_m": 100.0, "phase_1_rad": 0.5, **changes}
    return {"name": UNLISTED, **values}


def likely(case):
    base = case.fit()
    return likely_terms(case, motion_seen(case, base), base, ())


def likeliest(case):
    return likely(case)[0]


def test_a_wave_over_the_board_is_found_with_its_length(plant):
    case = plant([wave()], runs=6)
    first = likeliest(case)
    assert first.variable == "position"
    assert np.hypot(first.values["wave_1_x_per_m"], first.values["wave_1_y_per_m"]) == pytest.approx(
        100.0, rel=0.1
    )


def test_a_push_that_comes_and_goes_with_time_is_found_with_its_rate(plant):
    gust = {"name": UNLISTED, "push_1_y_m_per_s2": 0.02, "rate_1_per_s": 9.0}
    case = plant([gust], runs=6)
    first = likeliest(case)
    assert first.variable == "time"
    time_scale = case.fit().values[3]
    # Without stamps time is known up to the time scale.
    assert first.values["rate_1_per_s"] * time_scale == pytest.approx(9.0 * 15.0, rel=0.1)


def test_a_push_by_the_tilt_is_found(plant):
    swing = {
        "name": UNLISTED,
        "push_1_x_m_per_s2": 0.01,
        "tilt_1_x_per_rad": 300.0,
        "tilt_1_y_per_rad": 200.0,
    }
    case = plant([swing], runs=6)
    first = likeliest(case)
    assert first.variable == "command"


@pytest.mark.slow
def test_what_is_left_of_a_first_wave_is_learned_next(plant):
    first = {"push_1_x_m_per_s2": 0.01, "wave_1_x_per_m": 60.0, "phase_1_rad": 0.5}
    second = {"push_2_y_m_per_s2": 0.006, "wave_2_y_per_m": 100.0}
    case = plant([{"name": UNLISTED, **first, **second}], runs=6)
    base = case.fit()
    learned = learn(case, base, motion_seen(case, base))
    one, two = next(learned), next(learned)
    assert [len(terms) for _, terms, _ in (one, two)] == [1, 2]
    assert two[2].noise < 1.3 * case.noise < one[2].noise
    assert variables(two[2].value_of(UNLISTED)) == ["position"]


def test_a_term_that_later_ones_make_needless_is_taken_away(plant):
    """A washboard both ways was begun with a wave askew, which stayed at a hundredth of the others."""
    planted, tiny = wave(), {"push_1_y_m_per_s2": 1e-4, "wave_1_y_per_m": 60.0}
    case = plant([planted], runs=6)
    search = Search(case, lambda text: None)
    search.keep(case.fit())
    pushes = [tiny, {name: value for name, value in planted.items() if name != "name"}]
    askew, right = (Term("position", values, tuple(values), 0.0) for values in pushes)
    values = neutral() | tiny | {of_slot(name, 2): value for name, value in right.values.items()}
    both = _refined(case, search.base, (askew, right), list(values.values()))
    kept = Library(search)._needed(both)
    assert kept[1] == (right,)
    told = kept[2].value_of(UNLISTED)
    assert told["wave_1_x_per_m"] == pytest.approx(planted["wave_1_x_per_m"], rel=0.2)
    assert told["push_2_x_m_per_s2"] == 0.0
    assert kept[2].noise < 1.1 * both[2].noise


@pytest.mark.parametrize(("most_left", "taken"), [(True, "position"), (False, "heading")])
def test_of_first_terms_that_leave_most_the_motion_knows_the_right_one(most_left, taken, monkeypatch):
    """Of a board that is wavy both ways one wave alone made whole runs no better; a wrong drag a little."""
    fits = {
        name: SimpleNamespace(noise=1.0, loss=lambda scale, loss=loss: loss, values=np.zeros(5))
        for name, loss in (("position", 99.0), ("heading", 95.0), ("refitted", 100.0))
    }
    found = [Term(name, {}, (), 0.5) for name in ("position", "heading")]
    monkeypatch.setattr(unlisted, "likely_terms", lambda held, seen, learned, terms: found)
    monkeypatch.setattr(unlisted, "_added", lambda case, _, terms: (case, terms, fits[terms[-1].variable]))
    monkeypatch.setattr(unlisted, "_values", lambda learned, terms: [])
    monkeypatch.setattr(unlisted, "is_most_left", lambda case, one, base: most_left)
    case = SimpleNamespace(noise=1.0, fit=lambda effects, points, rounds: fits["refitted"])
    _, terms, _ = next(learn(case, fits["refitted"], None))
    assert [one.variable for one in terms] == [taken]


@pytest.mark.parametrize(
    ("left", "families", "strange"),
    [
        (0.9, [("position", "push"), ("position", "push")], True),
        (0.5, [("position", "push"), ("position", "push")], False),
        (0.9, [("position", "push"), ("heading", "brake")], False),
        (0.9, [("velocity", "side"), ("velocity", "side")], False),
        (0.9, [("position", "push")], False),
    ],
)
def test_two_terms_of_one_family_are_strange_where_no_effect_does_much(left, families, strange, monkeypatch):
    """Each explains seven tenths of what is left, so that two are needed."""
    size = {"brake": "brake_1_m_per_s2", "side": "side_strength"}
    terms = [Term(name, {size.get(what, "shape_1"): 0.0}, (), 0.7) for name, what in families]
    ahead = iter(terms)
    seen = SimpleNamespace(
        likely=lambda known, count: [one for one in [next(ahead, None)] if one is not None],
        explains=lambda term: term.explained,
        take=lambda term: None,
    )
    monkeypatch.setattr(unlisted, "motion_seen", lambda case, base: seen)
    monkeypatch.setattr(unlisted, "excess", lambda case, one: one)
    search = SimpleNamespace(case=None, base=1.0, ranked=lambda size: [1.0, left])
    assert [one.family for one in terms] == families
    assert Library(search).is_strange is strange


def test_drag_is_a_power_of_the_speed(plant):
    case = plant([{"name": "viscous_drag", "rate_per_s": 1.0}], runs=6, rows=120)
    first = likeliest(case)
    assert first.variable == "velocity"
    assert first.values["drag_strength"] > 0.0
    assert first.values["drag_power"] in {0.5, 1.0, 1.5}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planted", "family"),
    [
        (
            {"shape_1": 1.0, "push_1_x_m_per_s2": 0.005, "wave_1_x_per_m": 150.0, "phase_1_rad": 0.5},
            ("position", "push"),
        ),
        (
            {
                "shape_1": 4.0,
                "brake_1_m_per_s2": 0.1,
                "drag_power": 1.0,
                "wave_1_x_per_m": 30.0,
                "across_1_rad": 0.3,
            },
            ("position", "brake"),
        ),
        (
            {"shape_1": 5.0, "brake_1_m_per_s2": 0.3, "drag_power": 1.0, "way_1_per_m": 2.0},
            ("way", "brake"),
        ),
        (
            {
                "shape_1": 5.0,
                "brake_1_m_per_s2": 0.05,
                "drag_power": 1.0,
                "heading_1_x": 0.9,
                "phase_1_rad": 1.0,
            },
            ("heading", "brake"),
        ),
        (
            {
                "shape_1": 7.0,
                "push_1_x_m_per_s2": 0.005,
                "push_1_y_m_per_s2": 0.007,
                "tilt_1_x_per_rad": 300.0,
            },
            ("command", "push"),
        ),
        (
            {"shape_1": 5.0, "gear_1_x": -0.2, "gear_1_y": 0.4, "rate_1_per_s": 0.5},
            ("time", "gear"),
        ),
        ({"mode_gain": 1.0, "mode_rate_rad_per_s": 6.0, "mode_damping": 0.1}, ("command", "mode")),
    ],
    ids=["step", "spot", "way", "heading", "saddle", "gear", "mode"],
)
def test_what_is_planted_is_learned_first_and_leaves_noise(plant, planted, family):
    case = plant([{"name": UNLISTED, **planted}], runs=6, rows=100)
    base = case.fit()
    _, terms, fitted = next(learn(case, base, motion_seen(case, base)))
    assert terms[0].family == family
    assert fitted.noise < 1.3 * case.noise < base.noise


@pytest.mark.parametrize("seed", range(4))
def test_noise_teaches_nothing(plant, seed):
    case = plant(runs=6, seed=seed)
    assert likely(case) == []


def test_what_is_learned_simulates_and_leaves_noise(plant):
    case = plant([wave()], runs=6)
    base = case.fit()
    fixed, _, fitted = next(learn(case, base, motion_seen(case, base)))
    assert fitted.noise < 1.3 * case.noise < base.noise
    values = fitted.value_of(UNLISTED)
    assert set(values) == {one.name for one in effect(UNLISTED).parameters}
    assert set(fixed.held[UNLISTED]) < set(values)
    assert values["push_2_x_m_per_s2"] == 0.0
    assert "cos(" in formula(values)


def neutral(**changes):
    return {one.name: one.neutral for one in effect(UNLISTED).parameters} | changes


@pytest.mark.parametrize(
    ("changes", "told", "depends"),
    [
        ({"shape_2": 1.0, "push_2_x_m_per_s2": 0.5, "rate_2_per_s": 2.0}, "0.5 e_x tanh(2 t)", ["time"]),
        (
            {"shape_1": 3.0, "push_1_y_m_per_s2": 0.5, "wave_1_x_per_m": 9.0, "phase_1_rad": -1.0},
            "0.5 e_y ridge(9 x - 1), ridge(s) = -s exp((1 - s^2)/2)",
            ["position"],
        ),
        (
            {"shape_1": 4.0, "brake_1_m_per_s2": 0.2, "wave_1_x_per_m": 9.0, "across_1_rad": 2.0},
            "-(0.2 exp(-((9 x)^2 + (9 y + 2)^2)/2)) (v / 0.1 m/s)^1 along v",
            ["position", "speed"],
        ),
        (
            {"shape_1": 7.0, "push_1_x_m_per_s2": 0.5, "tilt_1_x_per_rad": 3.0},
            "0.5 e_x (3 tilt_x) (3 tilt_y)",
            ["tilt"],
        ),
        (
            {"drag_strength": 0.3, "shape_1": 5.0, "brake_1_m_per_s2": 0.1, "heading_1_y": 1.0},
            "-(0.3 + 0.1 (1 sin heading)) (v / 0.1 m/s)^1 along v",
            ["heading", "speed"],
        ),
        (
            {
                "push_1_x_m_per_s2": 0.005,
                "push_1_y_m_per_s2": -1e-6,
                "wave_1_x_per_m": -0.02,
                "wave_1_y_per_m": 90.0,
            },
            "0.005 e_x cos(90 y)",
            ["position"],
        ),
        (
            {"shape_1": 5.0, "gear_1_x": 0.1, "gear_1_y": -0.2, "rate_1_per_s": 3.0},
            "5/7 g (-0.2 tilt_y e_x - 0.1 tilt_x e_y) (3 t)",
            ["tilt", "time"],
        ),
        (
            {
                "push_1_x_m_per_s2": 4e-6,
                "push_1_y_m_per_s2": -3e-5,
                "wave_1_x_per_m": 26.0,
                "rate_1_per_s": 2.0,
                "push_2_x_m_per_s2": 0.0044,
                "wave_2_x_per_m": 108.0,
                "shape_3": 5.0,
                "push_3_x_m_per_s2": 1e-5,
                "wave_3_y_per_m": 900.0,
            },
            "0.0044 e_x cos(108 x) + 1e-05 e_x (900 y)",
            ["position"],
        ),
        ({"mode_gain": 1.0}, "5/7 g 1 (u - tilt), u'' = 100 (tilt - u) - 4 u'", ["tilt"]),
    ],
)
def test_a_formula_tells_what_was_learned(changes, told, depends):
    assert formula(neutral(**changes)) == f"a = {told}"
    assert variables(neutral(**changes)) == depends


@pytest.mark.slow
def test_the_likeliest_source_of_a_wave_is_the_position(plant):
    case = plant([wave()], runs=6)
    sources = Leftover(case, case.fit()).sources(0)
    repeatable = [one for one in sources if one.variable in {"position", "velocity", "command", "time"}]
    assert repeatable[0].variable == "position"
    assert repeatable[0].p_value == 0.01


@pytest.mark.parametrize(("planted", "repeats"), [([wave()], True), ([], False)])
def test_one_term_explains_the_motion_where_one_is_planted(plant, planted, repeats):
    search = Search(plant(planted, runs=6), lambda _: None)
    search.keep(search.case.fit())
    assert Library(search).is_repeatable is repeats


def test_noise_has_no_source(plant):
    case = plant(runs=6)
    assert all(one.p_value > 0.01 or one.gain == 0.0 for one in Leftover(case, case.fit()).sources(0))


@pytest.mark.parametrize(
    ("margin", "explained", "left", "preferred"),
    [(-1.0, False, 10.0, False), (1.0, False, 40.0, True), (1.0, True, 40.0, False), (1.0, True, 10.0, True)],
)
def test_what_is_learned_has_to_beat_names(margin, explained, left, preferred, monkeypatch):
    """Where these leave much of the mismatch by a little, where they seem to leave noise by half of it."""
    found = {"base": 100.0, "best": 50.0, "learned": left}
    monkeypatch.setattr(unlisted, "excess", lambda case, one: found[one.name])
    monkeypatch.setattr(unlisted, "is_trusted", lambda case, one, base: False)
    monkeypatch.setattr(unlisted, "is_explained", lambda case, one, base: explained)
    monkeypatch.setattr(unlisted, "is_supported", lambda one, over, scale: True)
    best, base = SimpleNamespace(name="best", effects=("stribeck",)), SimpleNamespace(name="base")
    evidence = SimpleNamespace(margin=lambda one, over: margin, scale=1.0)
    search = SimpleNamespace(case=None, base=base, evidence=lambda: evidence, held_out=lambda one: one)
    assert unlisted._is_preferred(search, SimpleNamespace(name="learned"), best) is preferred
