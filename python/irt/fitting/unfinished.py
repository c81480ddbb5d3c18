"""What the engine has answered to a long work that may be interrupted, in a file, to go on from there.

The work is done again from its beginning, but each question that was answered is answered from the file. The
answers depend on the questions alone, so that the end is the same to the last bit.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from irt.errors import IrtError
from irt.files import write_atomic

_Answer = TypeVar("_Answer")

_CURRENT: ContextVar[Unfinished | None] = ContextVar("unfinished", default=None)
#: What the answer to a question does not depend on.
_ASIDE = ("threads", "progress")


def answered(ask: Callable[..., _Answer], *asked: Any, **options: Any) -> _Answer:
    """Return the engine's answer to a question, from the file of the work if it is known there."""
    current = _CURRENT.get()
    if current is None:
        return ask(*asked, **options)
    answer: _Answer = current.answer(ask, asked, options)
    return answer


@dataclass(eq=False)
class Unfinished:
    """Answers to the questions of one work, in a file with a line for each.

    Attributes
    ----------
    path : Path
        The file; it is there while the work is unfinished.
    about : dict
        What the answers belong to; the first line of the file.
    stale : tuple of str
        In what the file that was there differs, and was of no use; empty if it was of use, or none was there.
    """

    path: Path
    about: dict[str, str | int]
    stale: tuple[str, ...] = ()
    _known: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path, recordings: str, seed: int) -> Unfinished:
        """Return what is known of a work on recordings of this SHA-256, with this seed."""
        about: dict[str, str | int] = {
            "recordings": recordings,
            "seed": seed,
            "version": version("labsim-irt"),
            "engine": _engine(),
        }
        lines = list(_lines(path))
        if not lines:
            return cls(path, about)
        there, *answers = lines
        stale = tuple(name for name, value in about.items() if there.get(name) != value)
        known = {} if stale else {one["asked"]: one["answer"] for one in answers}
        return cls(path, about, stale, known)

    def __len__(self) -> int:
        return len(self._known)

    @contextmanager
    def used(self) -> Iterator[None]:
        """Answer from the file, and keep what is not in it; only a work that ends removes the file.

        Raises
        ------
        IrtError
            If the file cannot be written.
        """
        # Whole lines alone: the last one may have been cut.
        kept = [{"asked": key, "answer": one} for key, one in self._known.items()]
        write_atomic(self.path, "".join(map(_line, [self.about, *kept])))
        token = _CURRENT.set(self)
        try:
            yield
        finally:
            _CURRENT.reset(token)
        self.path.unlink(missing_ok=True)

    def answer(self, ask: Callable[..., Any], asked: tuple[Any, ...], options: Mapping[str, Any]) -> Any:
        """Return what is known, or ask and keep the answer."""
        sha = hashlib.sha256(ask.__name__.encode())
        _feed(sha, [*asked, dict(options)])
        key = sha.hexdigest()
        if key in self._known:
            return _decoded(self._known[key])
        answer = ask(*asked, **options)
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(_line({"asked": key, "answer": _encoded(answer)}))
        except OSError as error:
            raise IrtError(f"{self.path}: cannot be written: {error.strerror or error}") from error
        return answer


def _line(content: Mapping[str, Any]) -> str:
    return f"{json.dumps(content)}\n"


@cache
def _engine() -> str:
    """Return the SHA-256 of the engine, whose answers are kept."""
    spec = find_spec("irt._labsim")
    if spec is None or spec.origin is None:
        return ""
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the whole lines of a file, none if there is no file."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return
    for line in text.split("\n")[:-1]:
        try:
            yield json.loads(line)
        except ValueError:
            return


def _feed(sha: Any, value: Any) -> None:
    """Feed a question to a hash, each part with its kind."""
    if isinstance(value, np.ndarray):
        sha.update(f"array {value.dtype.str} {value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        for key in sorted(set(value) - set(_ASIDE)):
            sha.update(f"key {key}".encode())
            _feed(sha, value[key])
    elif isinstance(value, list | tuple):
        sha.update(f"list {len(value)}".encode())
        for one in value:
            _feed(sha, one)
    else:
        sha.update(f"{type(value).__name__} {value!r}".encode())


def _encoded(value: Any) -> Any:
    """Return an answer as JSON takes it: arrays by their bytes, floats by digits that give the same bits."""
    if isinstance(value, np.ndarray):
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        return {"array": data, "dtype": value.dtype.str, "shape": list(value.shape)}
    if isinstance(value, Mapping):
        return {name: _encoded(one) for name, one in value.items()}
    return [_encoded(one) for one in value] if isinstance(value, list | tuple) else value


def _decoded(value: Any) -> Any:
    """Return the answer of which `_encoded` made JSON; tuples are lists."""
    if isinstance(value, dict) and "array" in value:
        data = np.frombuffer(base64.b64decode(value["array"]), dtype=value["dtype"])
        return data.reshape(value["shape"]).copy()
    if isinstance(value, dict):
        return {name: _decoded(one) for name, one in value.items()}
    return [_decoded(one) for one in value] if isinstance(value, list) else value
