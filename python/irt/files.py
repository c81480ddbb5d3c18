"""Read text and TOML files, and write files atomically; errors are one line with the file's name."""

from __future__ import annotations

import json
import math
import os
import secrets
import shlex
import shutil
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from irt.errors import IrtError, unknown_name

PathLike = str | os.PathLike[str]


def read_text(path: PathLike, expected: str = "") -> str:
    """Return the text of a UTF-8 file, with or without a byte order mark; line ends are unchanged.

    Parameters
    ----------
    path : path
        The file.
    expected : str, optional
        Description of the file to give; part of the message where there is none.

    Raises
    ------
    IrtError
        If the file is missing, unreadable or not UTF-8.
    """
    path = Path(path)
    remedy = f"; give {expected}" if expected else ""
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise IrtError(f"{path}: no such file{remedy}") from error
    except IsADirectoryError as error:
        raise IrtError(f"{path}: is a folder, where a file was expected{remedy}") from error
    except OSError as error:
        raise IrtError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise IrtError(f"{path}, line {line}: not UTF-8 text; save the file as UTF-8") from error


def file_or_inside(path: Path, name: str) -> Path:
    """Return the file of a name inside a folder, or the path itself if it is no folder with such a file."""
    inside = path / name
    return inside if inside.is_file() else path


def read_json(path: Path, expected: str = "") -> dict[str, Any]:
    """Return the object in a JSON file; ``expected`` as for `read_text`.

    Raises
    ------
    IrtError
        If the file cannot be read or is broken.
    """
    text = read_text(path, expected)
    try:
        content: dict[str, Any] = json.loads(text)
    except ValueError as error:
        raise IrtError(f"{path}: broken JSON: {error}") from error
    return content


def as_typed(path: Path) -> str:
    """Return a path as typed in a shell: quoted, and relative to the working directory if inside it."""
    here = Path.cwd()
    return shlex.quote(f"{path.relative_to(here) if path.is_relative_to(here) else path}")


@contextmanager
def atomic_path(path: PathLike) -> Iterator[Path]:
    """Yield a temporary path that replaces ``path`` when the block completes.

    If the block raises, ``path`` is unchanged and the temporary file is removed. The temporary name keeps the
    suffix of ``path``, because some writers choose their format by it. Devices and pipes are written
    directly: replacing ``/dev/null`` by a file would harm the machine.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    given = Path(path)
    target = Path(os.path.realpath(path))
    # The root of a file system has no name; it is refused as every folder is.
    beside = target.parent / f".irt-{secrets.token_hex(4)}{target.suffix}"
    try:
        if given.is_dir():
            raise IrtError(f"{path}: cannot be written: it is a folder; name a file")
        if given.exists() and not given.is_file():
            yield given
            return
        if not target.parent.is_dir():
            raise IrtError(f"{path}: cannot be written: there is no folder {target.parent}; make it first")
        yield beside
        beside.replace(target)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise IrtError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            beside.unlink()


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a new temporary folder that replaces ``path`` when the block completes.

    If the block raises, ``path`` is unchanged and the temporary folder is removed. One that a killed process
    has left is removed by `remove_unfinished`.
    """
    beside = path.with_name(f".irt-{secrets.token_hex(4)}")
    beside.mkdir()
    try:
        yield beside
        shutil.rmtree(path, ignore_errors=True)
        beside.replace(path)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def remove_unfinished(parent: Path) -> None:
    """Remove the temporary folders of `atomic_folder` inside a folder."""
    for beside in parent.glob(".irt-*"):
        shutil.rmtree(beside, ignore_errors=True)


def write_atomic(path: PathLike, data: bytes | str) -> None:
    """Write ``data`` to ``path`` atomically (text as UTF-8): readers see the old or the complete new file.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with atomic_path(path) as beside:
        beside.write_bytes(data.encode() if isinstance(data, str) else data)


def make_folder(path: PathLike) -> Path:
    """Create a folder for results, with its parents, unless it exists, and return it.

    Call it before long computations, so that an unwritable output fails at once.

    Raises
    ------
    IrtError
        If the folder cannot be created, or is not writable.
    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        taken = next((one for one in (path, *path.parents) if one.is_file()), path)
        raise IrtError(f"{path}: the folder cannot be made: {taken} is a file; choose another") from error
    except OSError as error:
        raise IrtError(f"{path}: the folder cannot be made: {error.strerror}") from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise IrtError(f"{path}: nothing can be written into this folder; choose another")
    return path


def read_toml(path: PathLike, expected: str = "") -> TomlTable:
    """Read a TOML file as a table; ``expected`` as for `read_text`.

    Raises
    ------
    IrtError
        If the file cannot be read, or is invalid TOML (the message contains line and column).
    """
    return parse_toml(f"{path}", read_text(path, expected))


def parse_toml(where: str, text: str | bytes) -> TomlTable:
    """Return TOML text, or its bytes in UTF-8, as a table; ``where`` is its place, for messages.

    Raises
    ------
    IrtError
        If it is invalid TOML (the message contains line and column).
    """
    try:
        content = tomllib.loads(text if isinstance(text, str) else text.decode())
    # Besides its own errors, the parser raises these two for thousands of digits or brackets.
    except (ValueError, RecursionError) as error:
        raise IrtError(f"{where}: broken TOML: {error}") from error
    return TomlTable(where, content)


class TomlTable:
    """A table of a TOML file, read key by key; errors contain file, section and key.

    Parameters
    ----------
    where : str
        The file, and the section if the table is one.
    content : dict
        The values by key.
    """

    def __init__(self, where: str, content: dict[str, Any]) -> None:
        self.where = where
        self.content = content

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def error(self, key: str, message: str) -> IrtError:
        """Return an error with the location of the key."""
        return IrtError(f"{self.where}, {key}: {message}")

    def only(self, kind: str, possible: Sequence[str]) -> None:
        """Raise unless every key is one of ``possible``; ``kind`` is the noun for keys in the message."""
        for key in self.content:
            if key not in possible:
                raise IrtError(f"{self.where}: {unknown_name(kind, key, possible)}")

    def section(self, key: str) -> TomlTable:
        """Return the table under ``key``, empty if there is none."""
        content = self.content.get(key, {})
        if not isinstance(content, dict):
            raise self.error(key, f"expected a section [{key}], found {_shown(content)}")
        return TomlTable(f"{self.where}, [{key}]", content)

    def inline(self, key: str, form: str) -> TomlTable:
        """Return the inline table under ``key``; ``form`` describes it in the message."""
        content = self.content.get(key)
        if not isinstance(content, dict):
            raise self.error(key, f"expected {form}, found {_shown(content)}")
        return TomlTable(f"{self.where}, {key}", content)

    def sections(self, key: str) -> list[TomlTable]:
        """Return the array of tables under ``key``, empty if there is none."""
        content = self.content.get(key, [])
        if not isinstance(content, list) or not all(isinstance(item, dict) for item in content):
            raise self.error(key, f"expected sections [[{key}]], found {_shown(content)}")
        return [TomlTable(f"{self.where}, [[{key}]] {i}", item) for i, item in enumerate(content, start=1)]

    def number(self, key: str, *, infinite: bool = False) -> float:
        """Return the number under the required ``key``; ``infinite`` allows ``inf``."""
        if key not in self.content:
            raise IrtError(f"{self.where}: {key} is missing")
        return self._number(key, self.content[key], infinite=infinite)

    def numbers(self, *keys: str, infinite: bool = False) -> dict[str, float]:
        """Return the numbers under those of ``keys`` that are present."""
        return {key: self.number(key, infinite=infinite) for key in keys if key in self.content}

    def pair(self, key: str) -> tuple[float, float]:
        """Return the two numbers ``[a, b]`` under the required ``key``."""
        content = self.content.get(key)
        if not isinstance(content, list) or len(content) != 2:
            raise self.error(key, f"expected [low, high], found {_shown(content)}")
        return self._number(key, content[0]), self._number(key, content[1])

    def series(self, key: str) -> tuple[float, ...]:
        """Return the numbers ``[a, b, ...]`` under ``key``, which must be there."""
        content = self.content.get(key)
        if not isinstance(content, list):
            raise self.error(key, f"expected [a, b, ...], found {_shown(content)}")
        return tuple(self._number(key, one) for one in content)

    def word(self, key: str) -> str:
        """Return the text under the required ``key``."""
        if key not in self.content:
            raise IrtError(f"{self.where}: {key} is missing")
        content = self.content[key]
        if not isinstance(content, str):
            raise self.error(key, f"expected text in quotes, found {_shown(content)}")
        return content

    def flag(self, key: str) -> bool:
        """Return true or false under the required ``key``."""
        if key not in self.content:
            raise IrtError(f"{self.where}: {key} is missing")
        content = self.content[key]
        if not isinstance(content, bool):
            raise self.error(key, f"expected true or false, found {_shown(content)}")
        return content

    def _number(self, key: str, value: object, *, infinite: bool = False) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, f"expected a number, found {_shown(value)}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not (infinite and math.isinf(number)) and not math.isfinite(number):
            raise self.error(key, f"expected a finite number, found {_shown(value)}")
        return number


def _shown(value: object) -> str:
    """Return a value as short text on one line, for a message."""
    if value is None:
        return "nothing"
    text = f'"{value}"' if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
