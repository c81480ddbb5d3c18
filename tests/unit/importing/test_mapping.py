"""Expressions are arithmetic on columns and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.errors import IrtError
from irt.importing.mapping import Expression, parse_mapping

COLUMNS = {"xb": np.array([1.0, 2.0]), "alpha": np.array([0.5, -0.5]), "stamp_ms": np.array([0.0, 20.0])}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("xb/0.276", [1.0 / 0.276, 2.0 / 0.276]),
        ("-alpha", [-0.5, 0.5]),
        ("stamp_ms / 1000", [0.0, 0.02]),
        ("rad(90 * xb)", [np.pi / 2, np.pi]),
        ("deg(alpha)", np.rad2deg([0.5, -0.5])),
        ("(xb - alpha) * 2 + +1e-3", [1.001, 5.001]),
        ("0", [0.0, 0.0]),
        ("xb / stamp_ms", [np.nan, 0.1]),
    ],
)
def test_arithmetic(text: str, expected: list[float]) -> None:
    assert np.allclose(Expression.parse(text).evaluate(COLUMNS, 2, "log.csv"), expected, equal_nan=True)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('x')",
        "xb ** 2",
        "xb if alpha else 0",
        "xb.real",
        "xb[0]",
        "open(xb)",
        "rad(xb, 2)",
        "lambda: 0",
        "'text'",
        "True",
        "1j",
        "xb +",
        "xb; alpha",
        "(" * 5000,
        "\0",
    ],
)
def test_what_is_no_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(IrtError, match=r"is no expression.*possible: columns, numbers"):
        Expression.parse(text)


@given(st.text(max_size=30))
def test_any_text_parses_or_is_refused(text: str) -> None:
    try:
        names = Expression.parse(text).names
    except IrtError:
        return
    assert all(name.isidentifier() for name in names)


def test_a_column_that_is_not_there_is_named_with_the_nearest() -> None:
    with pytest.raises(
        IrtError, match=r'log\.csv: in "alfa\*2": unknown column "alfa"; did you mean "alpha"'
    ):
        Expression.parse("alfa*2").evaluate(COLUMNS, 2, "log.csv")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["marble_x"], "expected TARGET=EXPRESSION"),
        (["marble_x="], "expected TARGET=EXPRESSION"),
        (["marble=xb"], 'unknown target "marble"; did you mean "marble_y"|"marble_x"'),
        (["marble_x=xb", "marble_x=xb/2"], "mapped twice"),
        (["marble_x=xb^2"], 'marble_x: "xb\\^2" is no expression'),
    ],
)
def test_bad_mappings(words: list[str], said: str) -> None:
    with pytest.raises(IrtError, match=said):
        parse_mapping(words)


def test_a_mapping() -> None:
    mapping = parse_mapping(["marble_x=xb/0.276", "t_s = stamp_ms/1000"])
    assert {target: one.names for target, one in mapping.items()} == {
        "marble_x": ("xb",),
        "t_s": ("stamp_ms",),
    }
