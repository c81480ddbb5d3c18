"""Checks of arguments: errors are one line with the expected and the actual value."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError, unknown_name

P = ParamSpec("P")
T = TypeVar("T")

#: Most threads that the engine accepts.
_MOST_THREADS = 1024
#: Most bits of a whole number that the engine accepts.
_BITS = 63
#: Most characters of a value in a message.
_SHOWN = 60


def entry(function: Callable[P, T]) -> Callable[P, T]:
    """Make a public function raise `IrtError` for unknown arguments, and suggest the nearest name."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        for name in kwargs:
            if name not in signature.parameters:
                raise unknown_name(f"option of {function.__name__}", name, signature.parameters)
        try:
            return function(*args, **kwargs)
        except TypeError:
            # Binding every call would take longer than a short batch of rollouts.
            try:
                signature.bind(*args, **kwargs)
            except TypeError as error:
                raise IrtError(f"{function.__name__}: {error}") from error
            raise

    return call


def whole(name: str, value: object, least: int = 0) -> int:
    """Return a whole number that is not below ``least``.

    Raises
    ------
    IrtError
        If the value is not. All functions of this module raise it.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise IrtError(f"{name}: expected a whole number of at least {least}, got {shown(value)}")
    if int(value).bit_length() > _BITS:
        raise IrtError(f"{name}: expected a whole number below 2^{_BITS}, got {shown(value)}")
    return int(value)


def number(name: str, value: object) -> float:
    """Return a number, finite or not."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise IrtError(f"{name}: expected a number, got {shown(value)}")
    try:
        return float(value)
    except OverflowError as error:
        raise IrtError(f"{name}: expected a number below 1e308, got {shown(value)}") from error


def pair(name: str, value: object) -> tuple[float, float]:
    """Return two numbers from a tuple, a list or an array."""
    if not isinstance(value, tuple | list | np.ndarray) or len(value) != 2:
        raise IrtError(f"{name}: expected two numbers (low, high), got {shown(value)}")
    return number(name, value[0]), number(name, value[1])


def upwards(name: str, low: float, high: float) -> None:
    """Raise `IrtError` unless a range runs upwards."""
    if low >= high:
        how = "empty" if low == high else "upside down"
        raise IrtError(f"{name}: the range [{low}, {high}] is {how}; expected [low, high] with low < high")


def array(name: str, values: Any) -> NDArray[np.float64]:
    """Return a copy of an array of numbers."""
    try:
        return np.array(real(values), dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise IrtError(f"{name} must be an array of numbers ({error})") from error


def real(values: Any) -> Any:
    """Return values unchanged, unless numpy would take them for numbers that they are not.

    Raises
    ------
    TypeError
        If they are complex, or dates and durations, whose unit would be lost.
    """
    if np.iscomplexobj(values):
        raise TypeError("complex numbers")
    if getattr(getattr(values, "dtype", None), "kind", "f") in "mM":
        raise TypeError("dates or durations: give seconds, such as (t - t[0]) / np.timedelta64(1, 's')")
    return values


def flag(name: str, value: object) -> bool:
    """Return True or False."""
    if not isinstance(value, bool | np.bool_):
        raise IrtError(f"{name}: expected True or False, got {shown(value)}")
    return bool(value)


def word(name: str, value: object, possible: Sequence[str]) -> str:
    """Return one of the possible words."""
    if not isinstance(value, str):
        raise IrtError(f"{name}: expected one of {', '.join(possible)}, got {shown(value)}")
    if value not in possible:
        raise unknown_name(name, value, possible)
    return value


def text(name: str, value: object) -> str:
    """Return text."""
    if not isinstance(value, str):
        raise IrtError(f"{name}: expected text, got {shown(value)}")
    return value


def path(name: str, value: object) -> Path:
    """Return a path."""
    if not isinstance(value, str | os.PathLike) or "\0" in os.fspath(value):
        raise IrtError(f"{name}: expected a path, got {shown(value)}")
    return Path(value)


def instance(name: str, value: object, kind: type[T], *, expected: str = "") -> T:
    """Return an instance of a class; ``expected`` describes it in the message."""
    if not isinstance(value, kind):
        raise IrtError(f"{name}: expected {expected or f'irt.{kind.__name__}'}, got {shown(value)}")
    return value


def mapping(name: str, value: object) -> Mapping[Any, Any]:
    """Return a mapping."""
    if not isinstance(value, Mapping):
        raise IrtError(f"{name}: expected a mapping by name, got {shown(value)}")
    return value


def listed(name: str, value: object, kind: type[T], *, expected: str = "") -> tuple[T, ...]:
    """Return a tuple of instances of a class."""
    expected = expected or f"a sequence of irt.{kind.__name__}"
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        raise IrtError(f"{name}: expected {expected}, got {shown(value)}")
    for index, one in enumerate(value):
        if not isinstance(one, kind):
            raise IrtError(f"{name}: expected {expected}; item {index} is {shown(one)}")
    return tuple(value)


def threads(value: object) -> int | None:
    """Return a number of threads; None means one per core."""
    if value is None:
        return None
    count = whole("threads", value)
    if not 1 <= count <= _MOST_THREADS:
        raise IrtError(f"threads: expected 1 to {_MOST_THREADS}, got {count}")
    return count


def progress(value: Callable[..., Any] | None) -> None:
    """Check a progress callback."""
    if value is not None and not callable(value):
        raise IrtError(f"progress: expected a function of (done, total, text), got {shown(value)}")


def shown(value: object) -> str:
    """Return a value as text for a message: its type, and the value itself if it is short."""
    if value is None:
        return "None"
    kind = type(value).__name__
    if isinstance(value, str | int | float | os.PathLike | np.number):
        written = repr(str(value)) if isinstance(value, str | os.PathLike) else repr(value)
        return f"{written if len(written) <= _SHOWN else written[: _SHOWN - 3] + '...'} ({kind})"
    return f"an object of type {kind}"
