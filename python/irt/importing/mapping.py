"""Arithmetic on columns: ``marble_x=xb/0.276``, parsed and never evaluated as Python."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError, unknown_name
from irt.recording import CMD, KNOBS, MARBLE, STAMP, TILT

Array = NDArray[np.float64]

#: Stamps of commands and of the tilt, if they have separate clocks [s].
COMMAND_STAMP, TILT_STAMP = "cmd_t_s", "tilt_t_s"
#: Zero or empty in rows in which the tracker lost the marble.
SEEN = "seen"
#: The targets of a mapping.
TARGETS = (STAMP, COMMAND_STAMP, TILT_STAMP, *MARBLE, *TILT, *CMD, *KNOBS, SEEN)

_OPERATORS: dict[type[ast.operator], Callable[[Array, Array], Array]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_FUNCTIONS: dict[str, Callable[[Array], Array]] = {"rad": np.deg2rad, "deg": np.rad2deg}
_GRAMMAR = "columns, numbers, + - * / ( ), rad(...) for degrees to radians, deg(...) for the reverse"


@dataclass(frozen=True)
class Expression:
    """Arithmetic on columns.

    Attributes
    ----------
    text : str
        Its source text.
    names : tuple of str
        The columns in it.
    """

    text: str
    tree: ast.expr
    names: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Parse the text of an expression.

        Raises
        ------
        IrtError
            If it is not arithmetic on columns.
        """
        try:
            tree = ast.parse(text.strip(), mode="eval").body
            names = _names(tree)
        # Deep nesting raises other errors of the parser than a syntax error.
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            reason = f" ({error})" if isinstance(error, IrtError) else ""
            raise IrtError(f'"{text}" is no expression{reason}; possible: {_GRAMMAR}') from None
        return cls(text.strip(), tree, tuple(dict.fromkeys(names)))

    def evaluate(self, columns: Mapping[str, Array], rows: int, where: str) -> Array:
        """Return the value of each row, (rows,).

        Raises
        ------
        IrtError
            If a column is not among ``columns``; ``where`` names their file.
        """
        for name in self.names:
            if name not in columns:
                raise IrtError(f'{where}: in "{self.text}": {unknown_name("column", name, columns)}')
        with np.errstate(all="ignore"):
            value = np.asarray(_value(self.tree, columns), dtype=np.float64)
        # A division by zero is no measurement.
        return np.where(np.isinf(value), np.nan, value) * np.ones(rows)


def parse_mapping(words: Sequence[str]) -> dict[str, Expression]:
    """Return the expressions of ``TARGET=EXPRESSION`` arguments by target.

    Raises
    ------
    IrtError
        If an argument has another form, an unknown target or a repeated target.
    """
    mapping: dict[str, Expression] = {}
    for word in words:
        target, equals, text = word.partition("=")
        target = target.strip()
        if not equals or not text.strip():
            raise IrtError(f'--map {word}: expected TARGET=EXPRESSION, such as "marble_x=xb/0.276"')
        if target not in TARGETS:
            raise IrtError(f"--map {word}: {unknown_name('target', target, TARGETS)}")
        if target in mapping:
            raise IrtError(f"--map {word}: {target} is mapped twice; keep one")
        try:
            mapping[target] = Expression.parse(text)
        except IrtError as error:
            raise IrtError(f"--map {target}: {error}") from error
    return mapping


def _names(node: ast.expr) -> list[str]:
    """Return the columns of a tree, and raise unless it is arithmetic."""
    match node:
        case ast.Name(id=name):
            return [name]
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            _number(value)
            return []
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            return _names(operand)
        case ast.BinOp(left=left, op=kind, right=right) if type(kind) in _OPERATORS:
            return [*_names(left), *_names(right)]
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
            return _names(argument)
    raise IrtError(f'found "{ast.unparse(node)}"')


def _value(node: ast.expr, columns: Mapping[str, Array]) -> Array:
    match node:
        case ast.Name(id=name):
            return columns[name]
        case ast.Constant(value=int() | float() as number):
            return np.array(_number(number))
        case ast.UnaryOp(op=kind, operand=operand):
            value = _value(operand, columns)
            return -value if isinstance(kind, ast.USub) else value
        case ast.BinOp(left=left, op=kind, right=right):
            return _OPERATORS[type(kind)](_value(left, columns), _value(right, columns))
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return _FUNCTIONS[name](_value(argument, columns))
    raise AssertionError(f"{node} passed the parser")


def _number(value: float) -> float:
    try:
        return float(value)
    except OverflowError as error:
        raise IrtError("a number of more than 308 digits") from error
