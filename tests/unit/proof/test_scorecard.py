"""The page that a proof leaves behind: the answer first, what falls short shown, pictures that are there."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.proof.contest import METHODS
from irt.proof.contested import Contestant
from irt.proof.further import Resolved
from irt.proof.provenance import Made
from irt.proof.results import Results
from irt.proof.scorecard import verdict, write_scorecard
from irt.proof.seal import digest

PICTURES = ("confusion.png", "coverage.png", "gaps.png", "power.png")
SETTINGS = {"command": "`irt prove`", "seed": "drawn"}


@pytest.fixture
def results(score) -> Results:
    """Return some of everything."""
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


@pytest.fixture
def page(results: Results, places, tmp_path: Path) -> Path:
    return write_scorecard(tmp_path / "docs" / "proof.md", results, [places], SETTINGS, raw=True)


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
    assert reasons == ["a / b", "another effect named", "only one of two", "false alarm"]
    assert "4 of 10 rigs" in cases


def test_nothing_failed(score, places, tmp_path: Path) -> None:
    page = write_scorecard(tmp_path / "proof.md", Results((score(), score("none"))), [places], SETTINGS)
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
    again = write_scorecard(tmp_path / "again.md", Results((score(found=False),)), [places], SETTINGS)
    for name in PICTURES:
        assert (again.parent / "again" / name).read_bytes() != (page.parent / "proof" / name).read_bytes()


def test_every_link_on_the_page_leads_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        assert (page.parent / link).exists(), link


def test_the_chain_is_named(page: Path, places) -> None:
    text = page.read_text()
    for name in ("commitments", "manifest", "keys"):
        content = getattr(places, name).read_bytes()
        assert f"| `{name}-1.json` | `{digest(content)}` |" in text
        assert (page.parent / "proof" / f"{name}-1.json").read_bytes() == content


def test_the_folder_holds_what_the_page_names_and_no_more(page: Path, results: Results, places) -> None:
    """After the first round of several, files without a number used to stay beside those with one."""
    folder = page.with_suffix("")
    (folder / "keys.json").write_bytes(places.keys.read_bytes())
    (folder / "notes.txt").write_text("not ours")
    write_scorecard(page, results, [places, places], SETTINGS, raw=True)
    published = {f"{name}-{one}.json" for name in ("commitments", "keys", "manifest") for one in (1, 2)}
    expected = {*PICTURES, "scores.json", "notes.txt", *published}
    assert {path.name for path in folder.iterdir()} == expected
    assert set(re.findall(r"^\| `(.+?\.json)` \|", page.read_text(), re.MULTILINE)) == published


def test_where_nothing_is_copied_the_files_are_those_of_the_proof(results: Results, places, tmp_path) -> None:
    page = write_scorecard(tmp_path / "one.md", results, [places], SETTINGS)
    assert "| `keys.json` |" in page.read_text()
    page = write_scorecard(tmp_path / "two.md", results, [places, places], SETTINGS)
    for number in (1, 2):
        assert f"| `keys.json`, round {number} |" in page.read_text()


def test_no_rig_at_all_is_drawn_all_the_same(places, score, tmp_path: Path) -> None:
    """A proof of nulls alone has no power to show, no gaps and no intervals."""
    page = write_scorecard(tmp_path / "proof.md", Results((score("none"),)), [places], SETTINGS)
    assert all((tmp_path / "proof" / name).stat().st_size > 1000 for name in PICTURES)
    assert "not counted" in page.read_text()


def test_scores_are_read_back_as_they_were_written(results: Results, tmp_path: Path) -> None:
    made = Made(len(results.scores), "5", "another engine", "irt, code 12")
    results = replace(
        results, ties=(Resolved("rig-0002", 2.0, {"random": None}, {"random": True}),), made=(made,)
    )
    results.save(tmp_path / "scores.json")
    again = Results.load(tmp_path / "scores.json")
    # No number equals itself where there is none: compared as they are written.
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "scores.json").read_bytes()
    assert again.floors == results.floors
    assert again.made == (made,)


def test_scores_of_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scores.json"
    path.write_text('{"rigs": []}')
    with pytest.raises(IrtError, match=r"scores\.json: holds no scores of a proof: 'baselines'"):
        Results.load(path)


def test_a_page_tells_of_earlier_rounds_too(page: Path, results: Results, places) -> None:
    """Numbers go on after theirs, and nothing of them is withdrawn."""
    folder = page.with_suffix("")
    first = {path.name: path.read_bytes() for path in folder.glob("*-1.json")}
    made = (Made(10, "5", "another engine", "irt, code 12"), Made(10, "6", "another engine", "irt, code 34"))
    both = replace(Results.joined([results, results]), made=made)
    write_scorecard(page, both, [places], SETTINGS, raw=True, earlier=1)
    assert {name: (folder / name).read_bytes() for name in first} == first
    assert (folder / "keys-2.json").read_bytes() == places.keys.read_bytes()
    text = page.read_text()
    assert "| 2 | 10 | 6 | another engine | irt, code 34 |" in text
    for number in (1, 2):
        assert f"| `manifest-{number}.json` |" in text
    assert both.first(1).scores == results.scores
    (folder / "keys-1.json").unlink()
    with pytest.raises(
        IrtError, match=r"keys-1\.json: is not there, and belongs to a round that the page counts"
    ):
        write_scorecard(page, both, [places], SETTINGS, raw=True, earlier=1)
