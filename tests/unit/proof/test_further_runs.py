"""Ties, and what one more run makes of them."""

from __future__ import annotations

import json
import shutil
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from irt.model import Effect, Model, save_model
from irt.proof import further, propose
from irt.proof.further import all_resolved, in_a_tie, recorded
from irt.proof.hash_chain import write_folder
from irt.proof.plan import Plan
from irt.proof.world import World
from irt.recording import load_commands, load_recording
from irt.rig import load_rig

VALUES = (0.06, 0.05, 4e-4, 15.0, 1.03)


def diagnosis(*effects: str, **ties: list[str]) -> str:
    named = [{"name": name, "confusable_with": ties.get(name, [])} for name in effects]
    return json.dumps({"verdict": "missing", "effects": named, "fit": {"noise": 1e-3}})


@pytest.fixture
def tied(places, tmp_path: Path) -> Path:
    """Return a rig's folder with the models of a diagnosis that ended in a tie."""
    folder = tmp_path / "tied"
    shutil.copytree(places.rig("rig-0001"), folder)
    (folder / "models").mkdir()
    rig = load_rig(folder)
    for name, effect in (
        ("plausible-1", Effect("delay", {"delay_s": 0.08})),
        ("plausible-2", Effect("lag", {"time_constant_s": 0.08})),
    ):
        model = Model.from_rig(rig, VALUES, effects=[effect], time_step="continuous")
        save_model(folder / "models" / f"{name}.toml", model)
    (folder / "models" / "plausible.json").write_text('{"probabilities": [0.6, 0.4]}')
    (folder / "models" / "diagnosis.json").write_text(diagnosis("delay", delay=["lag"]))
    return folder


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search less: how good the outcome is belongs to other tests."""
    search = import_module("irt.suggestion.search")
    monkeypatch.setattr(search, "_DRAWN", 4)
    monkeypatch.setattr(search, "_ROUNDS", 1)


def test_two_runs_to_play(tied: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    assert propose.main([str(tied), str(out)]) == 0
    runs = [load_commands(out / f"{kind}.csv") for kind in further.KINDS]
    largest = np.max([np.abs(one.knobs).max(axis=0) for one in load_rig(tied).recordings], axis=0)
    for run in runs:
        assert run.knobs.shape == (50, 2)
        assert run.start is not None
        assert (np.abs(run.knobs).max(axis=0) <= largest).all()
    assert not np.array_equal(runs[0].knobs, runs[1].knobs)


def test_no_answer_is_one_line(tmp_path: Path, capsys) -> None:
    assert propose.main([str(tmp_path / "none"), str(tmp_path)]) == 1
    assert "no such folder" in capsys.readouterr().err


def test_a_tie_is_a_name_with_others_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    assert not in_a_tie(tmp_path)
    for text, tie in ((diagnosis("delay", delay=["lag"]), True), (diagnosis("delay"), False)):
        path.write_text(text)
        assert in_a_tie(tmp_path) is tie


def test_a_further_run_is_of_the_same_rig(world, tmp_path: Path) -> None:
    asked = {"index": 0, "kind": "single", "seed": 7}
    with World(world) as one:
        one.ask({"make": {**asked, "folder": str(tmp_path / "rig")}})
        csv = (tmp_path / "rig" / "train-1.csv").read_bytes()
        seen = recorded(one, asked, {f"{kind}.csv": csv for kind in further.KINDS})
    assert seen is not None
    (tmp_path / "next.csv").write_text(seen["suggested"])
    before, after = (
        load_recording(path) for path in (tmp_path / "rig" / "train-1.csv", tmp_path / "next.csv")
    )
    assert np.array_equal(before.knobs, after.knobs)
    assert 0.0 < np.abs(before.marble - after.marble).mean() < 0.01


def test_a_world_that_records_no_further_runs_is_left_alone(tmp_path: Path) -> None:
    silent = 'import sys\nfor line in sys.stdin: print(\'{"error": "KeyError: make"}\', flush=True)'
    with World([sys.executable, "-c", silent]) as one:
        assert recorded(one, {"index": 0}, {"suggested.csv": b"", "random.csv": b""}) is None


def test_what_became_of_ties(score, tmp_path: Path) -> None:
    scores = [
        score(ties={"delay": ["lag"]}, exact=True, tie_size=2.0),
        score(named=("lag",), ties={"lag": ["delay", "latency"]}, exact=False, tie_size=3.0),
        score(),
    ]
    for one, suggested in zip(
        scores[:2], (diagnosis("delay"), diagnosis("delay", delay=["lag"])), strict=True
    ):
        for kind, text in (("suggested", suggested), ("random", diagnosis("lag", lag=["delay"]))):
            folder = tmp_path / one.rig / kind
            folder.mkdir(parents=True)
            (folder / "diagnosis.json").write_text(text)
    (first, second) = all_resolved(scores, tmp_path)
    assert (first.before, first.after) == (2.0, {"suggested": 1.0, "random": 2.0})
    assert (first.exact, second.exact) == (
        {"suggested": True, "random": False},
        {"suggested": False, "random": False},
    )
    assert second.after["suggested"] == 2.0


def test_a_proof_with_a_tie_gets_one_more_run(prove, answered, tmp_path: Path) -> None:
    """The hat names parallax or perspective at first, and parallax alone with a run that was suggested."""
    asked: list[tuple[str, str]] = []

    class Tied:
        def each(self, module, inputs):
            for name, files in inputs.items():
                asked.append((module.rpartition(".")[2], name))
                folder = tmp_path / f"hat-{len(asked)}"
                write_folder(folder, files)
                if module == "irt.proof.propose":
                    csv = files["train-1.csv"]
                    yield name, {"suggested.csv": csv, "random.csv": csv}
                elif module == "irt.proof.contest":
                    yield name, {"failed.json": b'{"error": "not asked"}'}
                else:
                    answer = answered(folder)
                    content = json.loads(answer["diagnosis.json"])
                    alike = [] if name.endswith("suggested") else ["perspective"]
                    content["effects"][0]["confusable_with"] = alike
                    yield name, {**answer, "diagnosis.json": json.dumps(content).encode()}

    places = prove(Tied(), contest=True, plan=Plan(single=2))
    assert [one for one in asked if one[0] == "propose"] == [("propose", "rig-0001"), ("propose", "rig-0002")]
    again = [name for module, name in asked if module == "blind"][2:]
    assert sorted(again) == [
        "rig-0001 random",
        "rig-0001 suggested",
        "rig-0002 random",
        "rig-0002 suggested",
    ]
    results = import_module("irt.proof.results").Results.of(places)
    assert [one.exact for one in results.ties] == [{"suggested": True, "random": False}] * 2
    page = import_module("irt.proof.scorecard").write_scorecard(tmp_path / "p.md", results, places, {})
    assert "| suggested | 100.0 % (34.2 to 100.0) of 2 | 2.00 | 1.00 |" in page.read_text()
    count = len(asked)
    prove(Tied(), contest=True, plan=Plan(single=2))
    assert len(asked) == count
