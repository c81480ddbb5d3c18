"""Read columns of numbers by name from a CSV file, a data frame, a mapping or a structured array."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.files import PathLike, read_text

Array = NDArray[np.float64]
#: Function of the header's location and the header; raises an error if the header is invalid.
CheckHeader = Callable[[str, list[str]], None]

#: Text of missing values in data frames; NaN reads as a number.
_UNKNOWN = ("", "None", "<NA>", "NaT")


@dataclass(frozen=True)
class Columns:
    """Values by column, with the location of each row.

    Attributes
    ----------
    source : str
        The file, or the name of the table.
    cells : mapping
        The values of each column, text or numbers.
    lines : tuple of int or None
        The line of the file on which each row ends; None for a table in memory.
    """

    source: str
    cells: Mapping[str, Sequence[Any]]
    lines: tuple[int, ...] | None = None

    @classmethod
    def read(cls, path: PathLike, check_header: CheckHeader, expected: str = "") -> Columns:
        """Read a CSV file with a header; blank lines are skipped, ``expected`` is as for `read_text`.

        Raises
        ------
        IrtError
            If the file cannot be read, is invalid CSV, or has no rows.
        """
        reader = csv.reader(io.StringIO(read_text(path, expected), newline=""), strict=True)
        rows: list[list[str]] = []
        lines: list[int] = []
        try:
            for cells in reader:
                stripped = [cell.strip() for cell in cells]
                if any(stripped):
                    rows.append(stripped)
                    lines.append(reader.line_num)
        except csv.Error as error:
            raise IrtError(f"{path}, line {reader.line_num}: broken CSV: {error}") from error
        if not rows:
            raise IrtError(f"{path}: the file is empty")
        header = rows.pop(0)
        check_header(f"{path}, line {lines[0]}", header)
        for cells, line in zip(rows, lines[1:], strict=True):
            if len(cells) != len(header):
                raise IrtError(f"{path}, line {line}: {len(cells)} cells, but the header has {len(header)}")
        if not rows:
            raise IrtError(f"{path}: the file has a header, but no rows")
        return cls(f"{path}", dict(zip(header, zip(*rows, strict=True), strict=True)), tuple(lines[1:]))

    @classmethod
    def of(cls, table: Any, source: str, check_header: CheckHeader) -> Columns:
        """Return the columns of a table in memory (see `is_table`).

        Raises
        ------
        IrtError
            If the header is invalid, or columns differ in length.
        """
        names = [str(name) for name in _names(table)]
        check_header(source, names)
        cells = {}
        for name in names:
            column = table[name]
            # Columns without an array interface, such as those of some data frames.
            cells[name] = column if hasattr(column, "__array__") else list(column)
        lengths = {name: len(column) for name, column in cells.items()}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise IrtError(f"{source}: columns must have the same number of rows, but have {listed}")
        if not any(lengths.values()):
            raise IrtError(f"{source}: the table has no rows")
        return cls(source, cells)

    def __contains__(self, column: str) -> bool:
        return column in self.cells

    def __len__(self) -> int:
        return len(next(iter(self.cells.values())))

    @property
    def names(self) -> list[str]:
        """Names of the columns, in order."""
        return list(self.cells)

    def where(self, row: int, column: str) -> str:
        """Return the location of a value, for messages."""
        place = f"row {row}" if self.lines is None else f"line {self.lines[row]}"
        return f"{self.source}, {place}, column {column}"

    def numbers(self, column: str, *, empty: str = "") -> Array:
        """Return a column as numbers; ``empty`` is the text read for empty cells.

        Raises
        ------
        IrtError
            If a cell is not a number; the message contains its location.
        """
        cells = self.cells[column]
        dtype = getattr(cells, "dtype", None)
        if isinstance(dtype, np.dtype) and dtype.kind in "iuf":
            return np.array(cells, dtype=np.float64)
        values = np.empty(len(cells))
        for row, cell in enumerate(cells):
            text = str(cell).strip()
            text = "" if text in _UNKNOWN else text
            try:
                values[row] = _number(text or empty)
            except ValueError:
                found = f'found "{text[:40]}"' if text else "found an empty cell"
                raise IrtError(f"{self.where(row, column)}: expected a number, {found}") from None
        return values


def is_table(value: object) -> bool:
    """Whether an object is a table.

    A table is a mapping of columns, a data frame (an object with ``columns``, indexed by their names), or a
    structured array.
    """
    if isinstance(value, Mapping):
        return True
    if isinstance(value, np.ndarray):
        return value.dtype.names is not None
    return hasattr(value, "columns") and hasattr(value, "__getitem__") and not isinstance(value, type)


def _names(table: Any) -> Iterable[Any]:
    if isinstance(table, Mapping):
        return table.keys()
    names: Iterable[Any] = table.dtype.names if isinstance(table, np.ndarray) else table.columns
    return names


def is_number(text: str) -> bool:
    """Whether a cell is a number."""
    try:
        _number(text)
    except ValueError:
        return False
    return True


def _number(text: str) -> float:
    # Python accepts digit groups such as 1_000; in a file they are a mistake.
    if "_" in text:
        raise ValueError(text)
    return float(text)
