"""The docs site: every page is reached from the menu, and every public name is on the page of the API."""

import re
import tomllib
from pathlib import Path

import irt

ROOT = Path(__file__).resolve().parents[2]


def pages(entry: object) -> list[str]:
    """Return the pages of a menu entry and of all below it."""
    if isinstance(entry, dict | list):
        return [page for one in (entry.values() if isinstance(entry, dict) else entry) for page in pages(one)]
    return [str(entry)]


def test_menu_holds_every_page_once() -> None:
    menu = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]["nav"]
    assert sorted(pages(menu)) == sorted(page.name for page in (ROOT / "docs").glob("*.md"))


def test_api_page_holds_every_public_name_once() -> None:
    api = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^::: irt\.(\w+)$", api, re.MULTILINE)) == sorted(irt.__all__)
