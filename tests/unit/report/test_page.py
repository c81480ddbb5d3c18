import base64
import re
from html.parser import HTMLParser

import pytest
from jinja2 import UndefinedError

from irt.errors import IrtError
from irt.report import plots, style
from irt.report.page import Picture, Table, render, write_page

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


@pytest.fixture(scope="module")
def pictures(tmp_path_factory, recording, predictions, result):
    folder = tmp_path_factory.mktemp("pictures")
    plots.plot_fit(folder / "fit.svg", recording, predictions)
    plots.plot_parameters(folder / "parameters.svg", result)
    plots.plot_paths(folder / "paths.png", [(recording, predictions[0])])
    return [Picture(path, f"caption of {path.name}") for path in sorted(folder.iterdir())]


def tuning(**content):
    """A page of `tuning.html` with nothing but what is given."""
    empty = {
        "title": "title",
        "lead": "lead",
        "stamped": True,
        "parameters": Table("caption", ["head"], []),
        **dict.fromkeys(("warnings", "unidentifiable", "notes"), ()),
        **dict.fromkeys(("fit", "tilt", "heldout", "history")),
        "settings": {},
    }
    return render("tuning.html", **(empty | content))


def table(*args, **kwargs):
    return Outline(tuning(parameters=Table(*args, **kwargs)))


@pytest.fixture(scope="module")
def full(pictures):
    return tuning(
        notes=["bullet"],
        history=pictures,
        parameters=Table("caption", ["head", "number"], [["row", "1"], ["all", "2"]], total=True),
        settings={"name": "value"},
    )


def test_page_holds_all_its_parts_and_closes_what_it_opens(full):
    outline = Outline(full)
    for text in ("title", "lead", "bullet", "caption", "head", "row", "name", "value"):
        assert text in outline.text
    assert len(outline.named("svg")) + len(outline.named("img")) == 3


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
    assert policy == "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def test_every_text_is_escaped():
    html = tuning(
        title=HOSTILE,
        lead=HOSTILE,
        warnings=[HOSTILE],
        notes=[HOSTILE],
        unidentifiable=[HOSTILE],
        parameters=Table(HOSTILE, [HOSTILE], [[HOSTILE]]),
        settings={HOSTILE: HOSTILE},
    )
    outline = Outline(html)
    assert outline.named("script") == []
    assert outline.text.count(HOSTILE) == 11
    nothing = {"timing": {}, "geometry": {}, "settings": {}, "path": (), "confidence": (), "lost": None}
    tracked = {"title": "t", "lead": "l", "stopped": HOSTILE, "key_figures": [(HOSTILE, HOSTILE)]}
    errors = Table(HOSTILE, [HOSTILE], [[HOSTILE]])
    outline = Outline(render("tracking.html", **tracked, **nothing, doubts=[HOSTILE], errors=errors))
    assert outline.named("script") == []
    assert outline.text.count(HOSTILE) == 7


def test_what_a_template_needs_and_does_not_get_is_an_error():
    with pytest.raises(UndefinedError, match="lead"):
        render("tuning.html", title="title")


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_captions_and_labels_are_escaped(tmp_path, recording, predictions, suffix):
    path = tmp_path / f"a.{suffix}"
    hostile = plots.Prediction(HOSTILE, predictions[0].marble, predictions[0].model)
    plots.plot_fit(path, recording, [hostile])
    outline = Outline(tuning(history=[Picture(path, HOSTILE)]))
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
        rows = table("caption", ["a"], [["1"], ["2"]], total=total).named("tr")
        assert [row.get("class") for row in rows].count("total") == total
        assert len(table("empty", ["a"], [], total=total).named("tr")) == 1


def test_columns_of_words_differ_from_numbers():
    outline = table("caption", ["a", "b"], [["1", "2"]], words=(1,))
    assert [cell.get("class") for cell in outline.named("td")] == ["words"]
    assert [cell.get("class") for cell in outline.named("th")] == [None, "words", None]


def test_only_a_table_longer_than_a_page_may_break_on_paper():
    for rows, kind in ((5, "table"), (50, "table long")):
        outline = table("caption", ["a"], [["1"]] * rows)
        assert [box["class"] for box in outline.named("figure")] == [kind]


def test_a_table_scrolls_by_keyboard_and_says_what_it_is():
    (box,) = (box for box in table("caption", ["a"], []).named("div") if box["class"] == "scroll")
    assert (box["tabindex"], box["role"], box["aria-label"]) == ("0", "region", "caption")


def test_page_is_written_whole(tmp_path):
    content = {
        "title": "t",
        "lead": "\u00b1 5 %",
        "stopped": "",
        "lost": None,
        **dict.fromkeys(("key_figures", "path", "confidence", "doubts"), ()),
        "errors": Table("standard errors", ["by", "error"], [["noise", "0.1 mm"]]),
        "timing": {},
        "geometry": {},
        "settings": {},
    }
    write_page(tmp_path / "report.html", "tracking.html", **content)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == render("tracking.html", **content)
    with pytest.raises(IrtError, match="nowhere"):
        write_page(tmp_path / "nowhere" / "report.html", "tracking.html", **content)


def test_inlined_picture_is_drawn_to_a_hundredth_of_a_point_and_keeps_its_proportions(tmp_path):
    drawn = '<path d="M 1.23456 -7.999 L 10.5 2"/><use x="4.3219" y="5"/><text>1.2345</text><g id="a"/>'
    path = tmp_path / "a name.svg"
    path.write_text(f'<?xml version="1.0"?><svg width="3pt" viewBox="0 0 3 2">{drawn}</svg>')
    picture = Picture(path, "caption")
    assert picture.view_box == "0 0 3 2"
    assert picture.drawing == (
        '<path d="M 1.23 -7.99 L 10.5 2"/><use x="4.32" y="5"/><text>1.2345</text><g id="a-name-a"/>'
    )
