"""One HTML page that holds all it shows: nothing is fetched, and everything that is text is escaped."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from pathlib import Path

from irt.files import PathLike, write_atomic
from irt.report import style

# The policy makes the browser itself see to it that nothing is loaded, nor run but the page's own scripts.
_TEMPLATE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
  content="default-src 'none'; style-src 'unsafe-inline'; img-src data:{scripts_allowed}">
<title>{title}</title>
<style>
{css}</style>
</head>
<body>
<main>
{body}
</main>{scripts}
</body>
</html>
"""

#: Rows of a table that fit on a page whatever stands above it.
_SHORT = 20


@dataclass(frozen=True)
class Picture:
    """A picture file to be put into a page.

    Attributes
    ----------
    path : Path
        An SVG or PNG that `irt.report.plots` wrote.
    caption : str
        What there is to see; also what a screen reader says.
    """

    path: Path
    caption: str


class Page:
    """Collects the parts of a page from top to bottom, then writes them.

    Parameters
    ----------
    title : str
        Heading, and name of the browser's tab.
    lead : str
        The answer, in a sentence or two.
    """

    def __init__(self, title: str, lead: str) -> None:
        self._title = escape(title)
        self._parts = [f"<h1>{self._title}</h1>", f'<p class="lead">{escape(lead)}</p>']
        self._scripts: list[str] = []

    def heading(self, text: str) -> None:
        """Begin a section."""
        self._parts.append(f"<h2>{escape(text)}</h2>")

    def subheading(self, text: str) -> None:
        """Begin a part of a section."""
        self._parts.append(f"<h3>{escape(text)}</h3>")

    def paragraph(self, text: str) -> None:
        """Add a paragraph."""
        self._parts.append(f"<p>{escape(text)}</p>")

    def equation(self, text: str) -> None:
        """Add a line of mathematics, written as code is."""
        self._parts.append(f'<p class="equation"><code>{escape(text)}</code></p>')

    def callout(self, title: str, text: str) -> None:
        """Add what nobody who reads on may miss."""
        self._parts.append(f'<p class="callout"><strong>{escape(title)}</strong> {escape(text)}</p>')

    def key_figures(self, figures: Iterable[tuple[str, str]]) -> None:
        """Add a few numbers in large type, each with what it is."""
        items = "".join(
            f"<li><strong>{escape(number)}</strong> {escape(meaning)}</li>" for number, meaning in figures
        )
        self._parts.append(f'<ul class="key">{items}</ul>')

    def bullets(self, texts: Iterable[str]) -> None:
        """Add a list of sentences."""
        items = "".join(f"<li>{escape(text)}</li>" for text in texts)
        self._parts.append(f"<ul>{items}</ul>")

    def pictures(self, *pictures: Picture) -> None:
        """Add pictures, side by side where there is room."""
        figures = "".join(figure(picture) for picture in pictures)
        self._parts.append(f'<div class="figures">{figures}</div>')

    def table(
        self,
        caption: str,
        header: Sequence[str],
        rows: Iterable[Sequence[str]],
        *,
        total: bool = False,
        words: Collection[int] = (),
    ) -> None:
        """Add a table.

        Parameters
        ----------
        caption : str
            What is shown, and in which unit.
        header : sequence of str
            One for each column; the first column names the rows.
        rows : iterable of sequence of str
            Cells.
        total : bool
            Whether the last row sums up the others.
        words : collection of int
            Columns of sentences, not of numbers.
        """
        looks = [' class="words"' if column in words else "" for column in range(len(header))]
        head = "".join(
            f'<th scope="col"{look}>{escape(cell)}</th>' for cell, look in zip(header, looks, strict=True)
        )
        lines = [
            f'<th scope="row"{looks[0]}>{escape(first)}</th>'
            + "".join(f"<td{look}>{escape(cell)}</td>" for cell, look in zip(cells, looks[1:], strict=True))
            for first, *cells in rows
        ]
        body = [f"<tr>{line}</tr>" for line in lines]
        if total and lines:
            body[-1] = f'<tr class="total">{lines[-1]}</tr>'
        # On paper a short table stays whole, a long one may break between its rows.
        long = " long" if len(lines) > _SHORT else ""
        self._parts.append(
            f'<div class="table{long}"><table><caption>{escape(caption)}</caption>'
            f"<thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table></div>"
        )

    def facts(self, facts: Mapping[str, str]) -> None:
        """Add names with their values."""
        items = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts.items())
        self._parts.append(f"<dl>{items}</dl>")

    def markup(self, html: str) -> None:
        """Add elements as they are: whoever writes them has escaped what is text."""
        self._parts.append(html)

    def script(self, code: str) -> None:
        """Add a script that runs when the page is there; the policy allows it by its hash, and no other."""
        self._scripts.append(code)

    def html(self) -> str:
        """Return the whole page."""
        hashes = "".join(f" 'sha256-{_sha256(code)}'" for code in self._scripts)
        return _TEMPLATE.format(
            title=self._title,
            css=resources.files(__package__).joinpath("page.css").read_text(encoding="utf-8"),
            scripts_allowed=f"; script-src{hashes}" if hashes else "",
            body="\n".join(self._parts),
            scripts="".join(f"\n<script>{code}</script>" for code in self._scripts),
        )

    def write(self, path: PathLike) -> None:
        """Write the page.

        Raises
        ------
        IrtError
            If the file cannot be written.
        """
        write_atomic(path, self.html())


def add_warnings(page: Page, warnings: Sequence[str]) -> None:
    """Add what a check of the recordings warned of, if it did."""
    if warnings:
        page.heading("Warnings about the recordings")
        page.bullets(warnings)


def _sha256(code: str) -> str:
    return base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()


def figure(picture: Picture) -> str:
    """Return a picture with its caption as an element of a page, the file's content inside."""
    caption = escape(picture.caption)
    if picture.path.suffix.lower() == ".svg":
        image = inline_svg(picture.path.read_text(encoding="utf-8"), picture.path.stem, picture.caption)
    else:
        data = base64.b64encode(picture.path.read_bytes()).decode()
        image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def inline_svg(svg: str, name: str, caption: str) -> str:
    """Return a picture of `irt.report.plots` as an element of a page.

    Its ids get a prefix, so that two pictures in one page do not meet, and its colours become CSS variables.

    Parameters
    ----------
    svg : str
        The file's text.
    name : str
        Of the picture, no other in the page has it.
    caption : str
        Read aloud in its place.
    """
    prefix = re.sub(r"[^A-Za-z0-9]", "-", name)
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r'(href="|url\()#', rf"\g<1>#{prefix}-", svg)
    # A hundredth of a point is finer than any screen, and half the file.
    svg = re.sub(r'\b(?:d|x|y)="[^"]*"', lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), svg)
    for role, colour in style.COLOURS.items():
        svg = svg.replace(colour, f"var(--{role})")
    # The page sets the size; the view box keeps the proportions.
    tag = re.sub(r' (?:width|height|xmlns(?::xlink)?|version)="[^"]*"', "", svg[: svg.index(">")])
    return f'{tag} role="img" aria-label="{escape(caption)}"{svg[svg.index(">") :]}'.strip()
