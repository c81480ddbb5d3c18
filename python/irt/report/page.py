"""Render HTML reports from the templates beside this file. A page is a single self-contained file.

Templates hold the prose and the structure, ``page.css`` the style. Python supplies numbers, tables and
pictures. jinja2 escapes all text.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from irt import display
from irt.files import PathLike, write_atomic
from irt.report import style, words

#: Rows of a table that still fit on one printed page; longer tables may break between rows.
_PRINTED_ROWS = 20
#: Filters of the templates.
_FILTERS = (
    words.commands,
    words.counted,
    display.listed,
    words.millimetres,
    words.percent,
    words.plain,
    words.with_interval,
)


@dataclass(frozen=True)
class Picture:
    """A picture file that is embedded in a page.

    Attributes
    ----------
    path : Path
        An SVG or PNG written by `irt.report.style.drawing`. File names are unique within a page.
    caption : str
        The caption.
    spoken : str
        The text for screen readers; the caption if it is empty.
    """

    path: Path
    caption: str
    spoken: str = ""

    @property
    def is_svg(self) -> bool:
        """Whether the picture is an SVG."""
        return self.path.suffix.lower() == ".svg"

    @property
    def data(self) -> str:
        """Content of a PNG in base64."""
        return base64.b64encode(self.path.read_bytes()).decode()

    @property
    def view_box(self) -> str:
        """View box of an SVG; the page sets the size."""
        found = re.search(r'viewBox="([\d. -]+)"', self.path.read_text(encoding="utf-8"))
        assert found is not None, self.path
        return found[1]

    @property
    def drawing(self) -> Markup:
        """Content of the SVG's root element.

        Ids are prefixed with the file's name to be unique within the page. Colours become the CSS variables
        of `irt.report.style.COLOURS`.
        """
        prefix = re.sub(r"[^A-Za-z0-9]", "-", self.path.stem)
        svg = self.path.read_text(encoding="utf-8")
        svg = svg[svg.index("<svg") :]
        svg = svg[svg.index(">") + 1 : svg.rindex("</svg>")]
        svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
        svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
        svg = re.sub(r'(href="|url\()#', rf"\g<1>#{prefix}-", svg)
        # 0.01 points is finer than any screen and halves the file.
        svg = re.sub(r'\b(?:d|x|y)="[^"]*"', lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), svg)
        for role, colour in style.COLOURS.items():
            svg = svg.replace(colour, f"var(--{role})")
        # matplotlib escapes the text that it writes.
        return Markup(svg.strip())


@dataclass(frozen=True)
class Table:
    """A table of a page.

    Attributes
    ----------
    caption : str
        Content and unit.
    header : sequence of str
        Titles of the columns; the first column names the rows.
    rows : sequence of sequence of str
        Cells.
    total : bool
        Whether the last row is a total.
    words : collection of int
        Indices of columns with text instead of numbers.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    total: bool = False
    words: Collection[int] = ()

    @property
    def is_long(self) -> bool:
        """Whether the table may break between rows in print."""
        return len(self.rows) > _PRINTED_ROWS


def render(template: str, /, *, scripts: Sequence[str] = (), **content: Any) -> str:
    """Return a page as HTML.

    Parameters
    ----------
    template : str
        Name of a file in ``templates``, one that extends ``page.html``.
    scripts : sequence of str
        Names of scripts in ``templates``, run once the page has loaded. The page's content security policy
        allows only these, by their hashes.
    content : mapping
        Variables of the template; at least ``title``. A missing variable is an error unless the template
        tests for it.
    """
    codes = [_source(name) for name in scripts]
    return _templates().get_template(template).render(scripts=codes, style=_source("page.css"), **content)


def write_page(path: PathLike, template: str, /, *, scripts: Sequence[str] = (), **content: Any) -> None:
    """Write a page; see `render`.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    write_atomic(path, render(template, scripts=scripts, **content))


@functools.cache
def _templates() -> Environment:
    """Return the jinja2 environment: text is escaped, and undefined variables are errors."""
    environment = Environment(
        loader=PackageLoader("irt.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    environment.filters |= {one.__name__: one for one in _FILTERS}
    environment.filters["sha256"] = _sha256
    environment.globals["change"] = words.change
    return environment


def _source(name: str) -> str:
    """Return the source of a file of ``templates``."""
    environment = _templates()
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]


def _sha256(code: str) -> str:
    return base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
