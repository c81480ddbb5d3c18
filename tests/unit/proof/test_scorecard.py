"""The page that a proof leaves behind: the answer first, what falls short shown, pictures that are there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from irt.catalogue import hypothetical
from irt.proof import figures
from irt.proof.contest import METHODS
from irt.proof.contested import Contestant
from irt.proof.hash_chain import CHAIN, Places, verify
from irt.proof.metrics import power
from irt.proof.results import Results
from irt.proof.score import Budget
from irt.proof.scorecard import verdict, write_scorecard
from irt.proof.seal import digest

PICTURES = ("budget.png", "confusion.png", "coverage.png", "gaps.png", "power.png", "reliability.png")
SETTINGS = {"command": "`irt prove`"}


@pytest.fixture(scope="module")
def results(scores) -> Results:
    """Return some of everything."""
    score = scores()
    scores = [
        *[
            score(
                intervals={"gear_x": "yes", "delay.delay_s": "no"},
                inclusion={"delay": 0.95, "lag": 0.02},
                budget=Budget(0.9, 0.1, 0.95, 0.05),
                engine=engine,
                drive="mixed",
            )
            for engine in ["pybullet"] * 3
        ],
        score(inclusion={"lag": 0.95, "bump": 0.02}, engine="mujoco"),
        score(named=("lag",), ties={"lag": ["latency"]}, exact=False, found=False, drive="controller"),
        score(verdict="failed", found=False, exact=False, named=(), errors=None, reason="a | b"),
        score("pair", named=("delay",), found=False, through_camera=True),
        score("unlisted", verdict="unlisted", named=("unlisted",), inclusion={"lag": 0.05}),
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
    return write_scorecard(path, results, Places(finished), SETTINGS, publish=True)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the pictures, which take most of the time, where a test looks at the text."""
    for name in (one for one in vars(figures) if one.startswith("plot_")):
        monkeypatch.setattr(figures, name, lambda *_: None)


def test_it_opens_with_how_then_the_answer_then_what_failed(page: Path, results: Results) -> None:
    head = page.read_text().splitlines()[:14]
    assert head[0] == "# Proof by concealment"
    assert head[2].count(". ") == 4
    assert head[4].startswith("With 8 rigs with hidden physics and 2 without, this proof is smaller than ")
    assert head[6] == f"**{verdict(results)}**"
    assert "8 rigs with hidden physics and 2 without, diagnosed blind: " in head[6]
    assert "Missed: false alarms; " in head[6]
    assert any(line.startswith("| false alarms | at most 1 % | 50.0 % ") for line in head)
    assert sum("**no**" in line for line in head) >= 2
    titles = re.findall("^## (.*)", page.read_text(), re.MULTILINE)
    assert titles[:3] == ["What was found", "What failed", "Runs held out"]


@pytest.mark.usefixtures("undrawn")
def test_a_full_proof_is_not_called_smaller(score, places, tmp_path: Path) -> None:
    scores = (*(score(budget=None) for _ in range(300)), *(score("none") for _ in range(300)))
    page = write_scorecard(tmp_path / "proof.md", Results(scores), places, SETTINGS)
    assert "smaller" not in page.read_text()


def test_the_picture_of_power_says_how_many_rigs_a_point_stands_for(results: Results, tmp_path: Path) -> None:
    figures.plot_power(tmp_path / "power.svg", results.scores)
    texts = re.findall("<tspan[^>]*>([^<]+)<|<text[^>]*>([^<]+)<", (tmp_path / "power.svg").read_text())
    written = [one or other for one, other in texts]
    counts = [
        f"{one.rate.of} rig{'' if one.rate.of == 1 else 's'}" for one in power(results.scores) if one.rate.of
    ]
    assert counts
    assert [one for one in written if re.fullmatch(r"\d+ rigs?", one)] == counts
    assert not any("below" in one for one in written)


def test_answers_by_world(page: Path) -> None:
    lines = page.read_text().splitlines()
    assert "| hidden: right answers | PyBullet | MuJoCo | through a camera | all |" in lines
    cells = ("100.0 % (43.9 to 100.0) of 3", "100.0 % (20.7 to 100.0) of 1", "", "66.7 % (30.0 to 90.3) of 6")
    assert f"| one effect | {' | '.join(cells)} |" in lines
    assert "| x | 1 | 1 | 0.99 |" in lines
    assert "| commands drawn beforehand | 3 | 100.0 % (43.9 to 100.0) |" in lines
    assert "| commands of a controller that sees the marble | 1 | 0.0 % (0.0 to 79.3) |" in lines


def test_calibration_is_counted_by_decile_and_unlisted_rigs_stand_apart(page: Path) -> None:
    lines = page.read_text().splitlines()
    assert any(line.startswith("| 0.9 to 1.0 | 0.950 | 75.0 % ") for line in lines)
    (lowest,) = [line for line in lines if line.startswith("| 0.0 to 0.1 ")]
    count = len(hypothetical())
    assert lowest.startswith(f"| 0.0 to 0.1 | 0.000 | {400 / (8 * count - 4):.1f} % ")
    assert f" of {8 * count - 4} | 0.0 % " in lowest
    assert lowest.endswith(f" of {count} |")
    assert "| effects | 0.900 | 0.950 | 0.050 | 0.050 |" in lines


def test_what_failed_is_listed_with_its_reason(page: Path) -> None:
    text = page.read_text()
    cases = text[text.index("## What failed") : text.index("## Runs held out")]
    rows = [line for line in cases.splitlines() if line.startswith("| rig-")]
    reasons = [row.split(" | ")[-1].removesuffix(" |") for row in rows]
    assert reasons == ["a / b", "another effect named", "only some of them", "false alarm"]
    assert "4 of 10 rigs" in cases
    assert "| the diagnosis failed | 1 |" in cases
    assert "| false alarm | 1 |" in cases


@pytest.mark.usefixtures("undrawn")
def test_nothing_failed(score, places, tmp_path: Path) -> None:
    page = write_scorecard(tmp_path / "proof.md", Results((score(), score("none"))), places, SETTINGS)
    text = page.read_text()
    assert "Nothing: every answer was right" in text
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


@pytest.mark.usefixtures("undrawn")
def test_where_nothing_is_copied_the_files_are_those_of_the_proof(results: Results, places, tmp_path) -> None:
    page = write_scorecard(tmp_path / "one.md", results, places, SETTINGS)
    assert "| `keys.json` |" in page.read_text()
    assert not (tmp_path / "one" / "keys.json").exists()


@pytest.mark.usefixtures("undrawn")
def test_the_page_names_code_commit_and_seed(score, places, tmp_path: Path) -> None:
    provenance = {"world": "another engine", "code": "irt, code 12", "commit": "abc", "seed": "5"}
    results = Results((score(), score("none")), provenance=provenance)
    text = write_scorecard(tmp_path / "p.md", results, places, SETTINGS).read_text()
    for row in ("recorded by | another engine", "diagnosed by | irt, code 12", "commit | abc", "seed | 5"):
        assert f"| {row} |" in text
    assert "scored by" not in text
    results = Results((score(),), provenance={**provenance, "scorer": "irt, code 13"})
    text = write_scorecard(tmp_path / "q.md", results, places, SETTINGS).read_text()
    assert "| scored by | irt, code 13 |" in text


def test_no_rig_at_all_is_drawn_all_the_same(places, score, tmp_path: Path) -> None:
    """A proof of nulls alone has no power to show, no gaps and no intervals."""
    page = write_scorecard(tmp_path / "proof.md", Results((score("none"),)), places, SETTINGS)
    assert all((tmp_path / "proof" / name).stat().st_size > 1000 for name in PICTURES)
    assert "not counted" in page.read_text()
