"""What one more run is worth: names are compared with what is hidden, and wins are counted in pairs."""

import json
from types import SimpleNamespace

import pytest

import suggested_run


def named(*effects):
    return SimpleNamespace(
        effects=[SimpleNamespace(name=name, confusable_with=ties) for name, *ties in effects]
    )


@pytest.mark.parametrize(
    ("found", "hidden", "exact"),
    [
        (named(["bump"]), ["bump"], True),
        (named(["latency", "delay"]), ["delay"], True),
        (named(["lag"], ["delay", "latency"]), ["latency", "lag"], True),
        (named(["delay", "latency", "lag"]), ["delay"], False),
        (named(["bump"], ["lag"]), ["bump"], False),
        (named(["bump"]), ["bump", "lag"], False),
        (named(["lag"]), ["bump"], False),
        (named(), ["bump"], False),
    ],
)
def test_only_what_is_hidden_is_exact_and_a_late_picture_is_a_late_command(found, hidden, exact):
    assert suggested_run.answer(found, hidden)["exact"] is exact


def test_wins_are_counted_in_pairs(tmp_path):
    results = [(True, False)] * 6 + [(False, True)] + [(True, True)] * 2 + [(False, False)] * 3
    for number, (suggested, random) in enumerate(results):
        after = {"suggested": {"exact": suggested}, "random": {"exact": random}}
        (tmp_path / f"{number}.json").write_text(json.dumps({"after": after}))
    (tmp_path / "known.json").write_text(json.dumps({"before": {"exact": True}}))
    first, *_, suggested, random, _, chance = suggested_run.table(tmp_path)
    assert first.startswith("13 rigs, 12 of them")
    assert suggested == "| suggested | 66.7 % (39.1 to 86.2) of 12 | 6 |"
    assert random == "| random | 25.0 % (8.9 to 53.2) of 12 | 1 |"
    # Of seven that differ, six or more: (7 + 1) / 2^7.
    assert chance.endswith(": 0.062.")
