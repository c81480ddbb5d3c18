"""The page that a proof leaves behind: the answer first, what falls short shown, pictures that are there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from irt.proof.contest import METHODS
from irt.proof.contested import Contestant
from irt.proof.hash_chain import CHAIN, Places, verify
from irt.proof.results import Results
from irt.proof.scorecard import verdict, write_scorecard
from irt.proof.seal import digest

PICTURES = ("confusion.png", "coverage.png", "gaps.png", "power.png")
SETTINGS = {"command": "`irt prove`"}


@pytest.fixture(scope="module")
def results(scores) -> Results:
    """Return some of everything."""
    score = scores()
    scores = [
        *[score(intervals={"gear_x": "yes", "delay.delay_s": "no"}) for _ in range(4)],
        score(named=("lag",), ties={"lag": ["latency"]}, exact=False, found=False, noise="heavy"),
        score(verdict="failed", found=False, exact=False, named=(), errors=None, reason="a | b"),
        score("pair", named=("delay",), found=False, through_camera=True),
        score("unlisted", verdict="unlisted", named=("unlisted",)),
        score("none"),
        score("outliers", verdict="missing", named=("bump",), false_alarm=True, found=False),
    ]
    entries = [
        Contestant(one.rig, name, True, False, 0.01, 1.0, "not installed" if name == "sindy" else "")
        for one in scores
        for name in METHODS
    ]
    return Results(tuple(scores), tuple(entries))


@pytest.fixture(scope="module")
def page(results: Results, finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "docs" / "proof.md"
    return write_scorecard(path, results, Places(finished), SETTINGS, raw=True)


def test_the_first_ten_lines_say_the_answer(page: Path, results: Results) -> None:
    head = page.read_text().splitlines()[:10]
    assert head[0] == "# Proof by concealment"
    assert head[2] == f"**{verdict(results)}**"
    assert "8 rigs with hidden physics and 2 without, diagnosed blind: " in head[2]
    assert "Missed: false alarms; " in head[2]
    assert any(line.startswith("| false alarms | at most 2 % | 50.0 % ") for line in head)
    assert sum("**no**" in line for line in head) >= 2


def test_what_failed_is_listed_with_its_reason(page: Path) -> None:
    text = page.read_text()
    cases = text[text.index("## Cases that failed") : text.index("## How it was done")]
    rows = [line for line in cases.splitlines() if line.startswith("| rig-")]
    reasons = [row.split(" | ")[-1].removesuffix(" |") for row in rows]
    assert reasons == ["a / b", "another effect named", "only some of them", "false alarm"]
    assert "4 of 10 rigs" in cases


def test_nothing_failed(score, places, tmp_path: Path) -> None:
    page = write_scorecard(tmp_path / "proof.md", Results((score(), score("none"))), places, SETTINGS)
    text = page.read_text()
    assert "None: every answer was right" in text
    assert "Beside other methods" not in text
    assert "Missed" not in verdict(Results((score(), score("none"))))


def test_what_chance_could_do_is_said(score) -> None:
    said = verdict(Results((score(intervals={"gear_x": "yes"}), score("none"))))
    assert said.endswith("Missed, though not with 95 % confidence: 95 % intervals that contain the truth.")


def test_methods_stand_beside_each_other(page: Path) -> None:
    text = page.read_text()
    for title, _ in METHODS.values():
        assert f"| {title} | " in text
    assert "| PySINDy on smoothed data | not installed |" in text
    assert "| irt diagnose | 57.1 % (25.0 to 84.2) |" in text


def test_pictures_and_scores_lie_beside_the_page(page: Path, results: Results) -> None:
    text = page.read_text()
    for name in PICTURES:
        assert f"](proof/{name})" in text
        picture = (page.parent / "proof" / name).read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert len(picture) > 3000
    content = json.loads((page.parent / "proof" / "scores.json").read_text())
    assert [one["rig"] for one in content["rigs"]] == [one.rig for one in results.scores]
    assert len(content["baselines"]) == len(results.entries)


def test_pictures_show_the_scores(page: Path, score, places, tmp_path: Path) -> None:
    """Other scores draw other pictures; the same ones draw the same, byte by byte."""
    again = write_scorecard(tmp_path / "again.md", Results((score(found=False),)), places, SETTINGS)
    for name in PICTURES:
        assert (again.parent / "again" / name).read_bytes() != (page.parent / "proof" / name).read_bytes()


def test_every_link_on_the_page_leads_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        assert (page.parent / link).exists(), link


def test_the_chain_lies_beside_the_page_and_is_verified_there(page: Path, places) -> None:
    text, folder = page.read_text(), page.with_suffix("")
    for name in CHAIN:
        content = (places.out / name).read_bytes()
        assert f"| `{name}` | `{digest(content)}` |" in text
        assert (folder / name).read_bytes() == content
    assert {path.name for path in folder.iterdir()} == {*PICTURES, *CHAIN, "scores.json"}
    assert verify(folder) == 3


def test_where_nothing_is_copied_the_files_are_those_of_the_proof(results: Results, places, tmp_path) -> None:
    page = write_scorecard(tmp_path / "one.md", results, places, SETTINGS)
    assert "| `keys.json` |" in page.read_text()
    assert not (tmp_path / "one" / "keys.json").exists()


def test_the_page_names_code_commit_and_seed(score, places, tmp_path: Path) -> None:
    provenance = {"world": "another engine", "code": "irt, code 12", "commit": "abc", "seed": "5"}
    results = Results((score(), score("none")), provenance=provenance)
    text = write_scorecard(tmp_path / "p.md", results, places, SETTINGS).read_text()
    for row in ("recorded by | another engine", "diagnosed by | irt, code 12", "commit | abc", "seed | 5"):
        assert f"| {row} |" in text


def test_no_rig_at_all_is_drawn_all_the_same(places, score, tmp_path: Path) -> None:
    """A proof of nulls alone has no power to show, no gaps and no intervals."""
    page = write_scorecard(tmp_path / "proof.md", Results((score("none"),)), places, SETTINGS)
    assert all((tmp_path / "proof" / name).stat().st_size > 1000 for name in PICTURES)
    assert "not counted" in page.read_text()
