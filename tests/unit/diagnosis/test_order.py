"""In which order one effect, several, what can be learned, and delays that differ are asked."""

from types import SimpleNamespace

import pytest

from irt.diagnosis import run
from irt.diagnosis.search import MOST_EFFECTS


class Scripted:
    """A search in which only hypotheses of some numbers of effects leave noise."""

    def __init__(self, enough, partners):
        self.case, self.base, self.enough, self.asked = None, None, enough, []
        self.partners = partners

    def singles(self):
        return SimpleNamespace(effects=("delay",))

    def larger(self, best, size):
        self.asked.append(size)
        return best if self.is_done(best) else SimpleNamespace(effects=("delay",) * size)

    def pruned(self, best):
        """Take away what is needless."""
        return SimpleNamespace(effects=tuple(one for one in best.effects if one != "needless"))

    def with_partners(self, best):
        return SimpleNamespace(effects=(*best.effects[:1], *self.partners)) if self.partners else best

    def is_explained_between(self, best):
        return False

    def is_done(self, one):
        return one.effects == ("unlisted",) or len(one.effects) >= self.enough


@pytest.fixture
def searched(monkeypatch):
    """Search by a script, and return the effects of the answer, and what was asked for."""

    def of(*, enough, repeats, most_left=False, learns=True, jitters=False, strange=False, partners=()):
        search = Scripted(enough, partners)
        learned = (None, ("term",), SimpleNamespace(effects=("unlisted",))) if learns else None

        def beyond(best):
            search.asked.append("library")
            return learned

        def jittering(search, best, report):
            search.asked.append("jitter")
            return run._Answer(None, SimpleNamespace(effects=("jitter",)), "spread") if jitters else None

        library = SimpleNamespace(search=search, is_repeatable=repeats, is_strange=strange, beyond=beyond)
        monkeypatch.setattr(run, "Library", lambda search: library)
        monkeypatch.setattr(run, "_jittering", jittering)
        monkeypatch.setattr(run, "is_most_left", lambda case, one, base: most_left)
        monkeypatch.setattr(run, "is_explained", lambda case, one, base: search.is_done(one))
        return run._searched(search, lambda text: None).best.effects, search.asked

    return of


def test_one_effect_that_leaves_noise_ends_the_search(searched):
    assert searched(enough=1, repeats=True) == (("delay",), [])


def test_what_has_names_is_not_learned(searched):
    effects, asked = searched(enough=2, repeats=True)
    assert len(effects) == 2
    assert "library" not in asked


def test_what_one_term_explains_is_learned_before_chance_is_believed(searched):
    assert searched(enough=3, repeats=True, jitters=True) == (("unlisted",), [2, "jitter", "library"])


def test_what_is_strange_is_learned_before_two_effects_are_tried(searched):
    assert searched(enough=2, repeats=True, strange=True) == (("unlisted",), ["library"])


def test_two_effects_are_tried_where_of_what_is_strange_nothing_can_be_learned(searched):
    effects, asked = searched(enough=2, repeats=True, strange=True, learns=False)
    assert len(effects) == 2
    assert asked[:2] == ["library", 2]


@pytest.mark.parametrize(("jitters", "told"), [(True, "jitter"), (False, "unlisted")])
def test_where_two_effects_leave_most_chance_and_then_the_library_are_asked(searched, jitters, told):
    effects, asked = searched(enough=3, repeats=False, most_left=True, jitters=jitters)
    assert effects == (told,)
    assert asked == ([2, "jitter"] if jitters else [2, "jitter", "library"])


@pytest.mark.parametrize("repeats", [False, True])
def test_three_effects_are_asked_where_nothing_can_be_learned(searched, repeats):
    effects, asked = searched(enough=MOST_EFFECTS, repeats=repeats, learns=False)
    assert len(effects) == MOST_EFFECTS
    assert asked.count("library") == 1 + repeats


def test_delays_that_differ_are_told_where_nothing_that_repeats_leaves_noise(searched):
    effects, asked = searched(enough=9, repeats=True, learns=False, jitters=True)
    assert effects == ("jitter",)
    assert asked == [2, "jitter", "library"]


def test_what_a_partner_between_impacts_makes_needless_is_not_named(searched):
    """A delay and what stood in for a dead band stayed with it, and three were named for two."""
    effects, _ = searched(enough=2, repeats=False, learns=False, partners=("needless", "dead_band"))
    assert effects == ("delay", "delay")
    effects, _ = searched(enough=9, repeats=False, learns=False, partners=("needless", "dead_band"))
    assert effects == ("delay", "dead_band")


def test_what_can_be_learned_comes_last(searched):
    assert searched(enough=9, repeats=False) == (("unlisted",), [2, 3, "jitter", "library"])
