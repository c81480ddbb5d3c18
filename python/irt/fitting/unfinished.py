"""Cache the engine's answers in a file, so that an interrupted computation can be resumed.

A resumed computation starts over, but reads known answers from the file. Answers depend only on their calls,
so the result has the same bits as without an interruption.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
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
#: Arguments that do not influence an answer.
_ASIDE = ("threads", "progress")


def answered(ask: Callable[..., _Answer], *asked: Any, **options: Any) -> _Answer:
    """Call a function of the engine, or return its cached answer if a cache is in use."""
    current = _CURRENT.get()
    if current is None:
        return ask(*asked, **options)
    answer: _Answer = current.answer(ask, asked, options)
    return answer


@dataclass(eq=False)
class Unfinished:
    """Cached answers of a computation, in a file with one line for each.

    Attributes
    ----------
    path : Path
        The file; it exists while the computation is unfinished.
    about : dict
        Recordings, seed, version and engine of the answers; the first line of the file.
    stale : tuple of str
        Keys of `about` in which an existing file differs, so that it is not used; empty if none differs.
    """

    path: Path
    about: dict[str, str | int]
    stale: tuple[str, ...] = ()
    _known: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path, recordings: str, seed: int) -> Unfinished:
        """Load the cache of a computation on recordings with this SHA-256 and with this seed."""
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
        known = {} if stale else {one["asked"]: one["answer"] for one in answers if _is_answer(one)}
        return cls(path, about, stale, known)

    def __len__(self) -> int:
        return len(self._known)

    @contextmanager
    def used(self) -> Iterator[None]:
        """Use the cache within the block, and remove the file if the block completes.

        Raises
        ------
        IrtError
            If the file cannot be written.
        """
        # Rewrite complete lines only: the last line may have been cut.
        kept = [_checked(key, one) for key, one in self._known.items()]
        write_atomic(self.path, "".join(map(_line, [self.about, *kept])))
        token = _CURRENT.set(self)
        try:
            yield
        finally:
            _CURRENT.reset(token)
        self.path.unlink(missing_ok=True)

    def answer(self, ask: Callable[..., Any], asked: tuple[Any, ...], options: Mapping[str, Any]) -> Any:
        """Return a cached answer, or call `ask` and store its answer."""
        sha = hashlib.sha256(ask.__name__.encode())
        _feed(sha, [*asked, dict(options)])
        key = sha.hexdigest()
        if key in self._known:
            return _decoded(self._known[key])
        answer = ask(*asked, **options)
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(_line(_checked(key, _encoded(answer))))
        except OSError as error:
            raise IrtError(f"{self.path}: cannot be written: {error.strerror or error}") from error
        return answer


def _line(content: Mapping[str, Any]) -> str:
    return f"{json.dumps(content)}\n"


def _checked(asked: str, answer: Any) -> dict[str, Any]:
    """Return a line's content. A damaged answer would change results unnoticed: the checksum shows it."""
    return {"asked": asked, "answer": answer, "crc32": zlib.crc32(json.dumps([asked, answer]).encode())}


def _is_answer(content: dict[str, Any]) -> bool:
    """Whether a line's content is an answer as it was written."""
    return content.keys() == {"asked", "answer", "crc32"} and content == _checked(
        content["asked"], content["answer"]
    )


@cache
def _engine() -> str:
    """Return the SHA-256 of the engine's extension module."""
    spec = find_spec("irt._labsim")
    if spec is None or spec.origin is None:
        return ""
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the objects on complete lines of a file, none if there is no file."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return
    for line in text.split("\n")[:-1]:
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(content, dict):
            yield content


def _feed(sha: Any, value: Any) -> None:
    """Feed the arguments of a call to a hash, each with its type."""
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
    """Return an answer as JSON-compatible values that preserve all bits; arrays become base64 strings."""
    if isinstance(value, np.ndarray):
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        return {"array": data, "dtype": value.dtype.str, "shape": list(value.shape)}
    if isinstance(value, Mapping):
        return {name: _encoded(one) for name, one in value.items()}
    return [_encoded(one) for one in value] if isinstance(value, list | tuple) else value


def _decoded(value: Any) -> Any:
    """Invert `_encoded`; tuples come back as lists."""
    if isinstance(value, dict) and "array" in value:
        data = np.frombuffer(base64.b64decode(value["array"]), dtype=value["dtype"])
        return data.reshape(value["shape"]).copy()
    if isinstance(value, dict):
        return {name: _decoded(one) for name, one in value.items()}
    return [_decoded(one) for one in value] if isinstance(value, list) else value
