import base64
import hashlib
import json
import math
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest
from markupsafe import escape

from irt.catalogue import effect
from irt.diagnosis.result import RunProof
from irt.diagnosis.words import LEARNED
from irt.errors import IrtError
from irt.report.diagnosis_report import answers, write_diagnosis_report
from irt.report.words import change, percent, with_interval
from irt.rig import PARAMETERS

VERDICTS = ("sufficient", "missing", "unlisted")
HOSTILE = "<b>\"&'</b></script>"
SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
DATA = re.compile(r'<script type="application/json" id="animation-data">(.*?)</script>', re.DOTALL)


class Tags(HTMLParser):
    """All tags with their attributes, and the text outside of scripts and styles."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.text, self.last = [], "", ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.last = tag
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        self.last = ""

    def handle_data(self, data):
        if self.last not in ("script", "style"):
            self.text += data


@pytest.fixture(params=VERDICTS)
def verdict(request):
    return request.param


@pytest.fixture
def page(reports, verdict):
    return reports[verdict].read_text(encoding="utf-8")


@pytest.fixture
def missing(reports):
    return reports["missing"].read_text(encoding="utf-8")


def spaced(text):
    """The text with plain spaces."""
    return text.replace("\N{NO-BREAK SPACE}", " ").replace("&lt;", "<").replace("&gt;", ">")


def write(folder, labyrinth, diagnosis):
    return write_diagnosis_report(folder, labyrinth, diagnosis).read_text(encoding="utf-8")


def test_answer_comes_first(page, verdict, diagnosis_of):
    diagnosis = diagnosis_of(verdict)
    body = page.split("<main>")[1]
    assert body.index(escape(diagnosis.summary)) < body.index("<h2>")
    assert f"<strong>{percent(diagnosis.base_heldout_mae)}</strong>" in body


def test_errors_on_every_held_out_run_are_listed(missing, diagnosis_of):
    for run in diagnosis_of("missing").runs:
        cells = (percent(run.base_mae), percent(run.final_mae), change(run.base_mae, run.final_mae))
        assert "".join(f"<td>{cell}</td>" for cell in cells) in missing


def answer(page):
    """The text of the answers on the first screen, by their question."""
    (found,) = re.findall(r'<dl class="answers">(.*?)</dl>', page, re.DOTALL)
    assert page.index('<dl class="answers">') < page.index("<h2>")
    return dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", found, re.DOTALL))


def test_first_screen_says_how_sure_how_much_and_what_next(page, verdict, diagnosis_of):
    diagnosis = diagnosis_of(verdict)
    answers = answer(page)
    error = "How much of the error does it explain?" if diagnosis.effects else "How large is the error?"
    assert list(answers) == ["How sure is this?", error, "What remains?", "What to do next?"]
    assert answers["What to do next?"] == escape(diagnosis.suggestion)
    assert percent(diagnosis.base_heldout_mae) in answers[error]
    if diagnosis.effects:
        assert (
            f"on {len(diagnosis.runs)} of {len(diagnosis.runs)} held-out runs" in answers["How sure is this?"]
        )


def test_first_screen_says_how_often_the_choice_comes_back(missing, diagnosis_of):
    diagnosis = diagnosis_of("missing")
    count = len(diagnosis.runs)
    sure = spaced(answer(missing)["How sure is this?"])
    assert (
        "With each run in turn left out, the selection among the most probable sets contains backlash or "
        f"delay {count}" in sure
    )
    assert f"Its error on that run is {spaced(percent(diagnosis.nested_heldout_mae))} of the edge" in sure


def test_a_tie_stands_at_the_top_with_its_reason(missing, diagnosis_of):
    (one,) = diagnosis_of("missing").effects
    sure = answer(missing)["How sure is this?"]
    assert "Not unique: delay instead of backlash explains these recordings as well." in sure
    assert one.reason in sure


def test_the_next_best_hypothesis_neither_ties_nor_contains_the_answer(missing, diagnosis_of):
    diagnosis = diagnosis_of("missing")
    others = [
        one
        for one in diagnosis.candidates
        if one.effects and "backlash" not in one.effects and one.effects != ("delay",)
    ]
    evidence = {one.effects: one.gain - one.penalty for one in diagnosis.candidates}
    best = max(evidence[one.effects] for one in others)
    sure = answer(missing)["How sure is this?"]
    assert f"is {evidence['backlash',] - best:,.0f} nats behind" in sure


def test_an_effect_and_each_hypothesis_have_their_probability(missing):
    assert "backlash or delay 97 %" in spaced(answer(missing)["How sure is this?"])
    assert "<dt>Probability</dt><dd>97 % for backlash or delay, given these recordings" in spaced(missing)
    rows = re.findall(
        r'<tr><th scope="row">([\w ]+)</th>(?:<td>.*?</td>){2}<td>(.*?)</td><td', spaced(missing)
    )
    assert dict(rows)["backlash"] == "62 %"
    assert dict(rows)["lag"] == "< 0.1 %"


def test_effects_that_were_considered_are_listed_by_their_probability(missing, reports):
    (table,) = re.findall(r"Probability that an effect acts.*?</table>", spaced(missing), re.DOTALL)
    assert re.findall(r'<th scope="row">(.*?)</th><td>(.*?)</td><td>(.*?)</td>', table) == [
        ("backlash", "62 %", "named"),
        ("delay", "38 %", "ties with backlash"),
        ("lag", "3.4 %", "not named"),
    ]
    assert "Probability that an effect acts" not in reports["sufficient"].read_text(encoding="utf-8")


def test_the_error_budget_is_drawn_and_read_aloud_before_the_answers(missing):
    label = re.search(r'aria-label="(Error budget: parts.*?)"', spaced(missing))[1]
    assert missing.index("Error budget: parts") < missing.index('<dl class="answers">')
    assert "Whole runs: backlash 99.6 %, tracker noise < 1 %, not explained < 1 %" in unescape(label)
    # The recordings have no stamps: rows are those of the middle of the time scale's range.
    assert "10 rows ahead: backlash 55 %, tracker noise 35 %, not explained 10 %" in unescape(label)


def test_the_push_that_was_missing_is_drawn_where_one_was(missing, reports):
    needed = "acceleration of the marble that is missing in the simulator"
    assert needed in spaced(missing)
    assert needed not in spaced(reports["sufficient"].read_text(encoding="utf-8"))


def test_what_remains_is_said_with_its_stage_and_the_floor_of_the_log(reports, diagnosis_of):
    remains = spaced(answer(reports["unlisted"].read_text(encoding="utf-8"))["What remains?"])
    assert "40 % of the base model&#39;s squared error" in remains
    assert "on the board, between impacts" in remains
    assert "No dependence on anything that repeats" in remains
    floor = diagnosis_of("unlisted").remains.floor_of_the_log
    assert f"would have an error of {spaced(percent(floor))} of the edge" in remains
    assert "Less than 1 %" in spaced(answer(reports["missing"].read_text())["What remains?"])


@pytest.mark.slow
def test_where_nothing_was_held_out_there_is_no_budget(tmp_path, labyrinth, diagnosis_of):
    changed = replace(
        diagnosis_of("missing"),
        budget=(),
        remains=None,
        base_heldout_mae=math.nan,
        final_heldout_mae=math.nan,
    )
    page = write(tmp_path, labyrinth, changed)
    assert "What remains?" not in page
    assert "squared error" not in page
    assert not (tmp_path / "budget.svg").exists()


@pytest.mark.slow
def test_a_mismatch_without_a_name_is_not_said_to_repeat(tmp_path, labyrinth, diagnosis_of):
    changed = replace(diagnosis_of("unlisted"), effects=())
    by_chance = write(tmp_path / "chance", labyrinth, changed)
    assert "a mismatch that no effect of the catalogue explains" in by_chance
    assert "The residuals exceed noise." in by_chance
    assert "The residuals repeat." not in by_chance
    repeats = replace(changed, remains=replace(changed.remains, repeats=True))
    assert "The residuals repeat." in write(tmp_path / "repeats", labyrinth, repeats)


def test_named_effect_is_explained_from_the_catalogue_with_its_values(missing, diagnosis_of):
    (one,) = diagnosis_of("missing").effects
    info = effect(one.name)
    for text in (info.equation, info.does, info.matters, info.looks, *info.references, effect("delay").does):
        assert escape(text) in missing
    for parameter in info.parameters:
        assert f"{parameter.name} [{parameter.unit}]" in missing
        assert with_interval(one.parameters[parameter.name]) in missing


def test_rival_models_are_listed_with_their_values(missing, diagnosis_of):
    rows = 0.113 / (diagnosis_of("missing").model.parameters["time_scale"].value / 240)
    assert (
        f'<th scope="row">delay</th><td class="words">delay {rows:.3g}\N{NO-BREAK SPACE}rows</td>' in missing
    )
    diagnosis = diagnosis_of("missing")
    (one,) = diagnosis.effects
    _, ties = answers(replace(diagnosis, effects=(replace(one, confusable_with=()),)))
    assert ties == {frozenset({"delay"})}


def test_everything_of_the_diagnosis_is_on_the_page(page, verdict, diagnosis_of):
    diagnosis = diagnosis_of(verdict)
    text = Tags(page).text
    notes = [note.removeprefix(LEARNED).removesuffix(".") for note in diagnosis.notes]
    texts = [*diagnosis.unidentifiable, *notes, diagnosis.suggestion, "irt diagnose rig --out out"]
    texts += [finding.what for finding in diagnosis.where]
    texts += PARAMETERS
    for sentence in texts:
        assert sentence in text
    assert "nan" not in text.lower()
    assert "inf " not in text


def test_sufficient_shows_what_would_have_been_seen_and_no_after(reports, diagnosis_of):
    page = reports["sufficient"].read_text(encoding="utf-8")
    assert "What would have been detected?" in page
    for one in diagnosis_of("sufficient").power:
        # The recordings have no stamps.
        assert f"<td>{one.parameter.removesuffix('_s')}</td>" in page
    assert "<td>not detectable</td>" in page
    assert "What was left out" not in page
    assert not list(reports["sufficient"].parent.glob("*after*"))
    assert set(json.loads(DATA.search(page)[1])["runs"][0]) == {"t", "rows", "worst", "recorded", "after"}


def test_unlisted_says_where_it_was_found_and_how_large_its_correction_is(reports, diagnosis_of):
    page = reports["unlisted"].read_text(encoding="utf-8")
    callout = re.search(r'<p class="callout">(.*?)</p>', page)[1]
    assert "where the knobs change direction" in callout
    assert "nowhere in particular" not in callout  # its p-value is large
    row_s = diagnosis_of("unlisted").model.parameters["time_scale"].value / 240
    size = f"drag against the motion {1000 * 0.021 * row_s**2:.4g} mm/row² at {100 * row_s:.3g} mm/row"
    assert f"{size}, power 1.50  (1.30 to 1.70)" in page
    assert page.count("a = -(0.021) (v / 0.1 m/s)^1.5 along v") == 1
    assert "Physics that is not in the catalogue" in page


def test_page_is_one_small_file_that_fetches_nothing(page):
    assert len(page.encode()) < 2_000_000
    for tag, attributes in Tags(page).tags:
        assert tag not in {"link", "iframe", "object", "base", "embed"}
        for name, value in attributes.items():
            if name in {"src", "href", "xlink:href", "srcset", "action"}:
                assert value.startswith(("#", "data:image/png;base64,")), (tag, value)
            assert not name.startswith("on")
    assert re.findall(r"url\((?!#)", page) == []
    assert "@import" not in page


def test_policy_allows_the_one_script_by_its_hash(page):
    (code,) = SCRIPT.findall(page)
    expected = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    (policy,) = (tag["content"] for name, tag in Tags(page).tags if "http-equiv" in tag and name == "meta")
    assert re.findall(r"script-src ([^;]*)", policy) == [f"'sha256-{expected}'"]
    assert policy.startswith("default-src 'none'")


def test_animation_holds_the_runs_to_four_digits(missing, diagnosis_of):
    data = json.loads(DATA.search(missing)[1])
    runs = sorted(diagnosis_of("missing").runs, key=lambda run: -run.base_mae)
    assert data["series"] == ["recorded", "before", "after"]
    for shown, run in zip(data["runs"], runs, strict=True):
        np.testing.assert_allclose(shown["t"], run.times, atol=5.1e-4)
        np.testing.assert_allclose(shown["after"], run.final, atol=5.1e-5)
        assert [row for row, place in enumerate(shown["recorded"]) if place is None] == [30, 31, 32, 33]
        assert shown["worst"] == np.nanargmax(np.abs(run.base - run.observed).mean(axis=1))


def test_the_animation_has_walls_and_holes_where_pictures_have_them(reports, labyrinth, diagnosis_of):
    """An edge is 1000 units; pictures have y upwards and an SVG downwards."""
    text = reports["unlisted"].read_text(encoding="utf-8")
    per_m = (
        1000.0
        * diagnosis_of("unlisted").model.parameters["observation_scale"].value
        / labyrinth.board.edge_x_m
    )
    found = {
        name: {key: float(value) for key, value in tag.items() if key != "class"}
        for _, tag in Tags(text).tags
        if (name := tag.get("class")) in {"wall", "hole"}
    }
    wall, hole = found["wall"], found["hole"]
    places = [wall["x1"], wall["y1"], wall["x2"], wall["y2"], hole["cx"], hole["cy"]]
    np.testing.assert_allclose(places, per_m * np.array([-0.05, -0.02, 0.03, -0.06, 0.1, 0.04]), atol=0.051)
    sizes = [wall["stroke-width"], hole["r"]]
    np.testing.assert_allclose(sizes, per_m * np.array([0.005, 0.0075]), atol=0.051)


def test_still_pictures_stand_in_for_the_animation(missing):
    player, still = missing.index('<div class="player" hidden>'), missing.index('<div class="still figures">')
    assert player < still
    assert missing[still:].startswith('<div class="still figures">\n<figure><svg')


@pytest.mark.slow
def test_names_are_escaped_wherever_they_stand(tmp_path, labyrinth, diagnosis_of):
    diagnosis = diagnosis_of("missing")
    (one,) = diagnosis.effects
    path = labyrinth.path / HOSTILE
    page = write(
        tmp_path,
        replace(labyrinth, path=path),
        replace(
            diagnosis,
            summary=HOSTILE,
            effects=(replace(one, name=HOSTILE, stage=HOSTILE, reason=HOSTILE, confusable_with=(HOSTILE,)),),
            where=tuple(replace(finding, what=HOSTILE) for finding in diagnosis.where),
            candidates=tuple(
                replace(tried, effects=(HOSTILE,), outcome=HOSTILE) for tried in diagnosis.candidates
            ),
            runs=tuple(replace(run, recording=HOSTILE) for run in diagnosis.runs),
            notes=(HOSTILE,),
            unidentifiable=(HOSTILE,),
            suggestion=HOSTILE,
            settings={HOSTILE: HOSTILE},
        ),
    )
    assert HOSTILE not in page
    tags = Tags(page)
    assert "b" not in {tag for tag, _ in tags.tags}
    assert [tag for tag, _ in tags.tags].count("script") == 2
    json.loads(DATA.search(page)[1])


@pytest.mark.slow
def test_long_recordings_make_no_large_page(tmp_path, labyrinth, diagnosis_of):
    rng = np.random.default_rng(0)
    runs = []
    for number in range(20):
        times = 0.02 * np.arange(6000)
        path = 0.3 * np.sin(times[:, None] * [0.7, 1.1])
        observed = path + rng.normal(0, 1e-3, path.shape)
        models = diagnosis_of("missing").base, diagnosis_of("missing").model
        runs.append(RunProof(f"run-{number}", times, observed, 1.1 * path, path, 0.02, 8e-4, *models))
    page = write(tmp_path, labyrinth, replace(diagnosis_of("missing"), runs=tuple(runs)))
    assert len(page.encode()) < 2_000_000
    assert page.count("<option") == 20 + 6
    assert "The pictures show the first 8 of 20 runs." in page


@pytest.mark.slow
def test_recordings_without_noise_are_drawn_all_the_same(tmp_path, labyrinth, diagnosis_of):
    page = write(tmp_path, labyrinth, replace(diagnosis_of("missing"), noise=0.0))
    assert "nan" not in Tags(page).text.lower()


@pytest.mark.slow
def test_rows_and_runs_without_a_prediction_are_left_out(tmp_path, labyrinth, diagnosis_of):
    first, second, *others = diagnosis_of("missing").runs
    nothing = np.full_like(first.base, np.nan)
    begun = np.where(np.arange(len(first.base))[:, None] < 20, np.nan, first.base)
    runs = (
        replace(first, base=begun, final=begun),
        replace(second, base=nothing, final=nothing, base_mae=math.nan, final_mae=math.nan),
        *others,
    )
    page = write(tmp_path, labyrinth, replace(diagnosis_of("missing"), runs=runs))
    assert "nan" not in Tags(page).text.lower()
    assert "<td>-</td>" in page


def test_few_findings_make_a_short_page(tmp_path, labyrinth, diagnosis_of):
    bare = replace(
        diagnosis_of("sufficient"),
        where=(),
        candidates=(),
        runs=(),
        power=(),
        notes=(),
        unidentifiable=(),
        suggestion="",
        budget=(),
        remains=None,
        base_heldout_mae=math.nan,
        final_heldout_mae=math.nan,
    )
    page = write(tmp_path, labyrinth, bare)
    assert "<script" not in page
    assert "script-src" not in page
    assert "nan" not in Tags(page).text.lower()
    assert re.findall("<h2>(.*?)</h2>", page) == [
        "Which parameters were fitted?",
        "How to reproduce this page",
    ]


def test_answers_hold_each_tie_with_one_effect_replaced(diagnosis_of):
    diagnosis = diagnosis_of("missing")
    (one,) = diagnosis.effects
    two = replace(
        diagnosis, indistinguishable=(), effects=(one, replace(one, name="lag", confusable_with=()))
    )
    named, ties = answers(two)
    assert named == {"backlash", "lag"}
    assert ties == {frozenset({"delay", "lag"})}


@pytest.mark.slow
def test_a_marble_in_motion_is_said_to_be_predicted_in_windows(tmp_path, labyrinth, diagnosis_of):
    page = write(tmp_path, replace(labyrinth, start="moving"), diagnosis_of("missing"))
    assert "in windows, each from the state estimated on the rows before it" in page


@pytest.mark.slow
def test_same_diagnosis_gives_the_same_page(tmp_path, labyrinth, diagnosis_of, missing):
    assert write(tmp_path, labyrinth, diagnosis_of("missing")) == missing


def test_unwritable_folder_is_named(tmp_path, labyrinth, diagnosis_of):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(IrtError, match="file"):
        write_diagnosis_report(tmp_path / "file", labyrinth, diagnosis_of("missing"))
