"""In which order one effect, several, delays that differ, and what can be learned are asked."""

from types import SimpleNamespace

import pytest

from irt.diagnosis import run


class Scripted:
    """A search in which hypotheses of some numbers of effects leave noise."""

    def __init__(self, enough):
        self.case, self.base, self.enough, self.asked = None, None, enough, []

    def singles(self):
        return SimpleNamespace(effects=("delay",))

    def is_done(self, one):
        return one.effects == ("unlisted",) or len(one.effects) >= self.enough


@pytest.fixture
def searched(monkeypatch):
    """Search by a script, and return the effects of the answer, and what was asked for."""

    def of(
        *, enough=9, whole=False, repeats=False, most_left=False, jitters=False, strange=False, probable=True
    ):
        search = Scripted(enough)

        def several(search):
            search.asked.append("several")
            return SimpleNamespace(fitted=SimpleNamespace(effects=("delay", "lag")), is_whole=whole)

        def beyond(best):
            search.asked.append("library")
            return (None, ("term",), SimpleNamespace(effects=("unlisted",)))

        def jittering(search, best, report):
            search.asked.append("jitter")
            return run._Answer(None, SimpleNamespace(effects=("jitter",)), "spread") if jitters else None

        library = SimpleNamespace(search=search, is_repeatable=repeats, is_strange=strange, beyond=beyond)
        monkeypatch.setattr(run, "Library", lambda search: library)
        monkeypatch.setattr(run, "several", several)
        monkeypatch.setattr(run, "_jittering", jittering)
        monkeypatch.setattr(run, "is_most_left", lambda case, one, base: most_left)
        monkeypatch.setattr(run, "is_more_probable", lambda *_: probable)
        return run._searched(search, lambda text: None).best.effects, search.asked

    return of


def test_one_effect_that_leaves_noise_ends_the_search(searched):
    assert searched(enough=1) == (("delay",), [])


def test_what_is_strange_is_learned_before_several_effects_are_tried(searched):
    assert searched(strange=True) == (("unlisted",), ["library"])


def test_a_set_that_needs_no_push_lacks_nothing(searched):
    assert searched(whole=True, repeats=True, most_left=True) == (("delay", "lag"), ["several"])


def test_a_set_that_explains_most_is_named_beside_a_push_that_does_not_repeat(searched):
    assert searched() == (("delay", "lag"), ["several"])


def test_delays_that_differ_are_asked_where_a_set_leaves_most(searched):
    assert searched(most_left=True, jitters=True) == (("jitter",), ["several", "jitter"])


def test_what_was_learned_has_to_be_more_probable_than_a_set(searched):
    assert searched(repeats=True) == (("unlisted",), ["several", "jitter", "library"])
    assert searched(repeats=True, probable=False) == (("delay", "lag"), ["several", "jitter", "library"])
