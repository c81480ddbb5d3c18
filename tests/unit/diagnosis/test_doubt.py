"""What an answer no longer names when it is looked at once more."""

from types import SimpleNamespace

import pytest

from irt.diagnosis import run
from irt.diagnosis.result import NamedEffect
from irt.model import Parameter

HEIGHTS = {"there": (1e-4, 3e-4), "may be absent": (-1e-4, 3e-4)}


class Told:
    """Says what a hypothesis of a delay, or of delays that differ, and a bump comes to."""

    def __init__(self, search, possible, tied, spread, several=None):
        self.effects, self.spread, self.bump = possible[0][1].effects, spread, search.bump

    def diagnosis(self, where):
        height = Parameter(1e-4, *HEIGHTS[self.bump])
        parameters = {"delay": {"delay_s": Parameter(0.1, 0.09, 0.11)}, "bump": {"height_m": height}}
        effects = [
            NamedEffect(
                "delay_jitter" if name == "delay" and self.spread else name,
                "board",
                parameters[name],
                {},
                0.04,
                0.03,
            )
            for name in self.effects
        ]
        return SimpleNamespace(
            verdict="missing",
            effects=effects,
            is_held_out=True,
            base_heldout_mae=0.04,
            final_heldout_mae=0.02,
        )


@pytest.fixture
def named(monkeypatch):
    """Return the names that are told of a delay and a bump."""

    def of(*, spread, bump, explained):
        best = SimpleNamespace(effects=("delay", "bump"))
        search = SimpleNamespace(
            case=SimpleNamespace(seed=0),
            base=SimpleNamespace(effects=()),
            bump=bump,
            without=lambda one, name: SimpleNamespace(effects=tuple({*one.effects} - {name})),
            is_explained_between=lambda one: False,
            evidence=lambda: SimpleNamespace(price=lambda parameters, choices: 10.0, scale=1.0),
        )
        monkeypatch.setattr(run, "_searched", lambda *_: run._Answer(search.case, best, spread))
        monkeypatch.setattr(run, "grips", lambda case, one: [(case, one)])
        monkeypatch.setattr(run, "is_explained", lambda *_: explained)
        monkeypatch.setattr(run, "Leftover", lambda *_: SimpleNamespace(sources=lambda seed: []))
        for name in ("variables", "locate", "stages", "kicks"):
            monkeypatch.setattr(run, name, lambda *_: ())
        monkeypatch.setattr(run, "spread", lambda *_: spread)
        monkeypatch.setattr(run, "rivals", lambda *_: {})
        monkeypatch.setattr(run, "Found", Told)
        return [one.name for one in run._found(search, lambda text: None).effects]

    return of


@pytest.mark.parametrize(
    ("spread", "explained", "bump", "names"),
    [
        (None, True, "may be absent", ["delay", "bump"]),
        (None, False, "there", ["delay", "bump"]),
        (None, False, "may be absent", ["delay"]),
        (Parameter(0.05), False, "there", ["delay_jitter", "bump"]),
        (Parameter(0.05), False, "may be absent", ["delay_jitter"]),
    ],
)
def test_beside_what_nothing_explains_a_size_that_may_be_none_is_not_named(
    named, spread, explained, bump, names
):
    """A patch of friction of any factor was named beside delays that differ, for 1 % of the error."""
    assert named(spread=spread, explained=explained, bump=bump) == names
