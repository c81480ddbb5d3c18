"""Markdown extension of the docs site: formulas become MathML at build time, so no script renders them."""

from __future__ import annotations

import re
from html import unescape

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.postprocessors import Postprocessor

#: What pymdownx.arithmatex leaves of a formula: TeX between \( and \) or \[ and \].
FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\[(\[](?P<tex>.*?)\\[)\]]</(?P=tag)>', re.DOTALL
)


class _ToMathml(Postprocessor):  # type: ignore[misc]
    def run(self, text: str) -> str:
        def formula(found: re.Match[str]) -> str:
            is_inline = found["tag"] == "span"
            math = str(convert(unescape(found["tex"]).strip(), display="inline" if is_inline else "block"))
            return math if is_inline else f'<div class="formula">{math}</div>'

        return FORMULA.sub(formula, text)


class Mathml(Extension):  # type: ignore[misc]
    """Converts the formulas that pymdownx.arithmatex has found."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802
        """Add the conversion behind everything that still changes the text of formulas."""
        md.postprocessors.register(_ToMathml(md), "mathml", 1)


def makeExtension(**options: object) -> Mathml:  # noqa: N802
    """Return the extension, as Markdown asks for it."""
    return Mathml(**options)
