import base64
import hashlib
import re
from html.parser import HTMLParser

import pytest

from irt.errors import IrtError
from irt.report import page as pages
from irt.report import plots, style
from irt.report.page import Page, Picture

HOSTILE = "<script>alert('&\"')</script>"
VOID = {"meta", "link", "img", "br", "hr", "input"}


class Outline(HTMLParser):
    """Tags with their attributes, the text outside of styles, and whether every tag was closed in order."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.text, self.open = [], "", []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data

    def named(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture
def pictures(tmp_path, recording, predictions, result):
    plots.plot_fit(tmp_path / "fit.svg", recording, predictions)
    plots.plot_parameters(tmp_path / "parameters.svg", result)
    plots.plot_paths(tmp_path / "paths.png", [(recording, predictions[0])])
    return [Picture(path, f"caption of {path.name}") for path in sorted(tmp_path.iterdir())]


@pytest.fixture
def full(pictures):
    page = Page("title", "lead")
    page.heading("heading")
    page.paragraph("paragraph")
    page.bullets(["bullet"])
    page.pictures(*pictures)
    page.table("caption", ["head", "number"], [["row", "1"], ["all", "2"]], total=True)
    page.facts({"name": "value"})
    return page.html()


def test_page_holds_all_its_parts_and_closes_what_it_opens(full):
    outline = Outline(full)
    for text in (
        "title",
        "lead",
        "heading",
        "paragraph",
        "bullet",
        "caption",
        "head",
        "row",
        "name",
        "value",
    ):
        assert text in outline.text
    assert len(outline.named("figure")) == 3


def test_page_fetches_and_runs_nothing(full):
    outline = Outline(full)
    assert not {tag for tag, _ in outline.tags} & {"script", "link", "iframe", "object", "base"}
    for tag, attributes in outline.tags:
        for name, value in attributes.items():
            if name in {"src", "href", "xlink:href"}:
                assert value.startswith(("#", "data:image/png;base64,")), (tag, value)
            assert not name.startswith("on")
    assert "@import" not in full
    assert re.findall(r"url\((?!#)", full) == []
    (policy,) = (meta["content"] for meta in outline.named("meta") if "http-equiv" in meta)
    assert policy.startswith("default-src 'none'")


def test_whatever_is_text_is_escaped():
    page = Page(HOSTILE, HOSTILE)
    page.heading(HOSTILE)
    page.paragraph(HOSTILE)
    page.bullets([HOSTILE])
    page.table(HOSTILE, [HOSTILE], [[HOSTILE]])
    page.facts({HOSTILE: HOSTILE})
    page.subheading(HOSTILE)
    page.equation(HOSTILE)
    page.callout(HOSTILE, HOSTILE)
    page.key_figures([(HOSTILE, HOSTILE)])
    outline = Outline(page.html())
    assert outline.named("script") == []
    assert outline.text.count(HOSTILE) == 17


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_captions_and_labels_are_escaped(tmp_path, recording, predictions, suffix):
    path = tmp_path / f"a.{suffix}"
    hostile = plots.Prediction(HOSTILE, predictions[0].marble, predictions[0].model)
    plots.plot_fit(path, recording, [hostile])
    page = Page("title", "lead")
    page.pictures(Picture(path, HOSTILE))
    outline = Outline(page.html())
    assert outline.named("script") == []
    spoken = [attributes.get("aria-label", attributes.get("alt")) for _, attributes in outline.tags]
    assert HOSTILE in spoken


def test_ids_of_pictures_do_not_meet_and_all_are_found(full):
    ids = re.findall(r'\bid="([^"]+)"', full)
    assert len(ids) == len(set(ids))
    used = re.findall(r'(?:href="|url\()#([^")]+)', full)
    assert len(used) > 10
    assert set(used) <= set(ids)


def test_colours_follow_the_page(full):
    css, body = full.split("</style>", maxsplit=1)
    assert not [colour for colour in style.COLOURS.values() if colour in body]
    assert "var(--tuned)" in body
    light, dark = css.split("prefers-color-scheme: dark")
    for role in set(re.findall(r"var\(--([a-z]+)\)", full)):
        assert f"--{role}:" in light
        assert f"--{role}:" in dark


def test_png_travels_inside_the_page(full, pictures):
    (image,) = Outline(full).named("img")
    assert image["alt"] == "caption of paths.png"
    data = base64.b64decode(image["src"].removeprefix("data:image/png;base64,"))
    assert data == next(picture.path for picture in pictures if picture.path.suffix == ".png").read_bytes()


def test_pictures_scale_with_the_page_and_speak(full):
    for svg in Outline(full).named("svg"):
        assert set(svg) == {"viewbox", "role", "aria-label"}
        assert svg["aria-label"].startswith("caption of ")


def test_total_row_stands_out_only_where_there_is_one():
    for total in (True, False):
        page = Page("title", "lead")
        page.table("caption", ["a"], [["1"], ["2"]], total=total)
        page.table("empty", ["a"], [], total=total)
        rows = [attributes.get("class") for attributes in Outline(page.html()).named("tr")]
        assert rows.count("total") == total


def test_columns_of_words_are_told_from_numbers():
    page = Page("title", "lead")
    page.table("caption", ["a", "b"], [["1", "2"]], words=(1,))
    outline = Outline(page.html())
    assert [cell.get("class") for cell in outline.named("td")] == ["words"]
    assert [cell.get("class") for cell in outline.named("th")] == [None, "words", None]


def test_only_a_table_longer_than_a_page_may_break_on_paper():
    page = Page("title", "lead")
    for rows in (5, 50):
        page.table("caption", ["a"], [["1"]] * rows)
    kinds = [box["class"] for box in Outline(page.html()).named("div")]
    assert kinds == ["table", "table long"]


def test_the_policy_allows_the_scripts_of_the_page_alone():
    page = Page("title", "lead")
    assert "script-src" not in page.html()
    codes = ["let a = 1 < 2;\n", "let b = 'ä';"]
    for code in codes:
        page.script(code)
    html = page.html()
    (policy,) = (meta["content"] for meta in Outline(html).named("meta") if "http-equiv" in meta)
    hashes = [base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() for code in codes]
    assert policy.endswith("; script-src" + "".join(f" 'sha256-{one}'" for one in hashes))
    for code in codes:
        assert f"<script>{code}</script>" in html


def test_page_is_written_whole(tmp_path):
    page = Page("title", "lead: \u00b1 5 %")
    page.write(tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page.html()
    with pytest.raises(IrtError, match="nowhere"):
        page.write(tmp_path / "nowhere" / "report.html")


def test_inlined_picture_is_drawn_to_a_hundredth_of_a_point():
    drawn = '<path d="M 1.23456 -7.999 L 10.5 2"/><use x="4.3219" y="5"/><text>1.2345</text>'
    inlined = pages.inline_svg(f'<svg viewBox="0 0 3 2">{drawn}</svg>', "name", "caption")
    assert '<path d="M 1.23 -7.99 L 10.5 2"/><use x="4.32" y="5"/><text>1.2345</text>' in inlined


def test_inlined_picture_keeps_its_proportions():
    svg = '<?xml version="1.0"?><svg width="3pt" height="2pt" viewBox="0 0 3 2"><g id="a"/></svg>'
    inlined = pages.inline_svg(svg, "a name", "caption")
    assert inlined == '<svg viewBox="0 0 3 2" role="img" aria-label="caption"><g id="a-name-a"/></svg>'
