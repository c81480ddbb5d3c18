"""A tracker that loses the marble costs the rig, and not the proof; nobody keeps it quiet.

An `IrtError` of the tracker used to be the whole answer of the concealed world, and a recording without a
marble ended the proof where other methods or the scores came to read it.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from irt.errors import IrtError
from irt.proof.hash_chain import Places, verify, write_folder
from irt.proof.plan import Plan
from irt.proof.pybullet_world import camera
from irt.proof.pybullet_world.__main__ import serve
from irt.proof.pybullet_world.physics import EDGE_X_M
from irt.proof.results import Results
from irt.proof.run import Proof
from irt.proof.scorecard import verdict, write_scorecard
from irt.rig import load_rig
from irt.workers import FAILED, Files

REASON = "two marbles move on the board"
PROVENANCE = {"world": "a small world", "code": "this code", "commit": ""}


def ask(request: Mapping[str, object]) -> dict:
    """Return the concealed world's answer to a request for a rig that is seen through a camera."""
    answers = io.StringIO()
    asked = {"index": 1, "kind": "none", "seed": 1, "tracker": "irt.tracking:positions", **request}
    serve([json.dumps({"record" if "csv" in request else "make": asked})], answers)
    answer: dict = json.loads(answers.getvalue())
    return answer


@pytest.fixture
def track(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Return what has runs, counted from 0, refused by the tracker or seen without a marble at first."""
    pytest.importorskip("pybullet", reason="PyBullet has wheels up to Python 3.11 only")
    monkeypatch.setattr(camera, "pictures", lambda spec, run, played: iter(played.places))

    def among(refused: tuple[int, ...] = (), late: tuple[int, ...] = ()) -> None:
        runs = iter(range(100))

        def watch(calibration, empty, pictures, edges, radius):
            run = next(runs)
            if run in refused:
                raise IrtError(REASON)
            seen = np.array(list(pictures)) / EDGE_X_M * edges[0]
            seen[:1] = math.nan if run in late else seen[:1]
            return seen

        monkeypatch.setattr("irt.tracking.positions", watch)

    return among


@pytest.mark.slow
def test_the_tracker_of_a_rig_may_fail(track, tmp_path: Path) -> None:
    """Readable runs are recorded; the others are empty, and the label names them with the reasons."""
    track(refused=(2, 9), late=(4,))
    label = ask({"folder": f"{tmp_path / 'rig'}"})["label"]
    late = "no marble in the first picture, where every prediction starts"
    assert label["lost"] == {"train-3": REASON, "train-5": late, "test-2": REASON}
    rows = (tmp_path / "rig" / "train-3.csv").read_text().splitlines()
    assert len(rows) == 121
    assert all(row.endswith(",,") for row in rows[1:])
    assert 0.0 < label["sigma"] < 0.01
    with pytest.raises(IrtError, match=r"train-3\.csv: the marble is lost in every row"):
        load_rig(tmp_path / "rig")


@pytest.mark.slow
def test_a_tracker_that_reads_nothing_at_all(track, tmp_path: Path) -> None:
    """Its noise is unknown, and the label has no NaN, which cannot be sealed."""
    track(refused=tuple(range(12)))
    label = ask({"folder": f"{tmp_path / 'rig'}", "kind": "outliers"})["label"]
    assert (len(label["lost"]), label["sigma"], label["signal"]) == (12, None, None)
    assert json.dumps(label, allow_nan=False)
    # A rig with outliers has none without any tracked row.
    texts = [test["csv"] for test in label["tests"].values()]
    texts += [path.read_text() for path in (tmp_path / "rig").glob("*.csv")]
    assert len(texts) == 12
    assert all(row.endswith(",,") for text in texts for row in text.splitlines()[1:])


@pytest.mark.slow
def test_a_further_run_may_be_lost(track, tmp_path: Path) -> None:
    """The other runs of its rig were read: one diagnosis fails, and other ties are not affected."""
    track()
    assert ask({"folder": f"{tmp_path / 'rig'}"})["label"]["lost"] == {}
    csv = (tmp_path / "rig" / "train-1.csv").read_text()
    track(refused=(0,))
    rows = ask({"csv": csv})["csv"].splitlines()
    assert len(rows) == 121
    assert all(row.endswith(",,") for row in rows[1:])


@pytest.mark.slow
def test_a_tracker_that_is_broken_is_no_tracker_that_loses(
    track, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An error before the first picture is an error of the world."""
    track()
    monkeypatch.setattr(camera, "pictures", lambda spec, run, played: (_ for _ in ["x"] if int("x")))
    assert ask({"folder": f"{tmp_path / 'rig'}"})["error"].startswith("ValueError: invalid literal")


class Diagnoses:
    """Workers that answer like `irt.proof.blind`: with a diagnosis, or the reason for none."""

    def __init__(self, place: Path, answered: Callable[[Path], Files]) -> None:
        self._place, self._answered = place, answered

    def each(self, module: str, inputs: Mapping[str, Files]) -> Iterator[tuple[str, Files]]:
        for name, files in inputs.items():
            folder = self._place / module / name
            folder.parent.mkdir(parents=True, exist_ok=True)
            write_folder(folder, files)
            try:
                load_rig(folder)
                yield name, self._contested(folder) if module.endswith("contest") else self._answered(folder)
            except IrtError as error:
                yield name, {FAILED: json.dumps({"error": str(error)}).encode()}

    @staticmethod
    def _contested(folder: Path) -> Files:
        """Predict all tests in the folder, since every method is scored on them."""
        tests = sorted(path.stem for path in (folder / "tests").glob("*.csv"))
        paths = dict.fromkeys(tests, [[0.0, 0.0]] * 50)
        entry = {"told": False, "named": [], "predictions": paths, "seconds": 1.0, "missing": ""}
        return {"baselines.json": json.dumps({"alone": entry}).encode()}


@pytest.fixture
def lose(world, answered, tmp_path: Path) -> Callable[..., tuple[Places, Results]]:
    """Return what runs a proof of three rigs with a tracker that loses some runs, and scores it."""

    def run(*lost: str) -> tuple[Places, Results]:
        plan = Plan(single=3)
        workers = Diagnoses(tmp_path / "seen", answered)
        places = Proof(tmp_path / "proof", plan, [*world, *lost], workers, PROVENANCE, seed=5).run()
        return places, Results.of(places)

    return run


def test_a_lost_rig_costs_the_proof_one_rig(lose, tmp_path: Path) -> None:
    places, results = lose("1/train-2")
    assert verify(places.out) == 3
    assert [one.verdict for one in results.scores] == ["missing", "failed", "missing"]
    rig = results.scores[1]
    assert (rig.unread, rig.found, rig.reason) == (
        ("train-2",),
        False,
        f"the tracker lost the marble in train-2: {REASON}",
    )
    assert {one.rig for one in results.entries} == {"rig-0001", "rig-0003"}
    assert results.standings[0].seconds == 1.5
    assert "The tracker lost the marble in 1 rig, counted as failed." in verdict(results)
    page = write_scorecard(tmp_path / "p.md", results, places, {}).read_text()
    assert f"| rig-0002 |  | parallax | failed |  |  |  | white | {rig.reason} |" in page
    assert "The tracker lost the marble in 1 rig (rig-0002)" in page
    assert json.dumps(rig.as_dict(), allow_nan=False)


def test_a_lost_held_out_run_is_left_out_and_reported(lose, tmp_path: Path) -> None:
    places, results = lose("0/test-2", "2/test-1", "2/test-2")
    first, whole, last = results.scores
    assert [one.verdict for one in results.scores] == ["missing"] * 3
    assert (first.left_out, last.left_out) == (("test-2",), ("test-1", "test-2"))
    assert first.errors is not None
    assert first.errors.oracle == pytest.approx(whole.errors.oracle, rel=0.3)
    assert last.errors is None
    # With nothing to predict, other methods are not asked either.
    errors = {one.rig: one.error for one in results.entries}
    assert set(errors) == {"rig-0001", "rig-0002"}
    assert errors["rig-0001"] is not None
    assert "tracker lost" not in verdict(results)
    page = write_scorecard(tmp_path / "p.md", results, places, {}).read_text()
    assert (
        "The tracker lost the marble in 3 runs held out, which are left out of all errors: "
        "rig-0001 test-2, rig-0003 test-1, rig-0003 test-2." in page
    )


def test_nothing_is_said_where_nothing_was_lost(places: Places, tmp_path: Path) -> None:
    page = write_scorecard(tmp_path / "p.md", Results.of(places), places, {}).read_text()
    assert "tracker lost" not in page


def test_a_run_held_out_that_begins_unseen_is_scored_from_the_true_start(places: Places) -> None:
    """Row 0 is true in any case; a world that does not say that it was lost ends no proof by that."""
    results = Results.of(places)
    path = places.opened("rig-0001") / "test-1.csv"
    header, first, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, f"{first.rsplit(',', 2)[0]},,", *rows]) + "\n")
    again = Results.of(places)
    assert again.scores[0].errors == results.scores[0].errors
    path.write_text("\n".join([header, first.replace("0", "x"), *rows]) + "\n")
    with pytest.raises(IrtError, match=r'test-1\.csv, line 2, column step: expected a number, found "x"'):
        Results.of(places)
