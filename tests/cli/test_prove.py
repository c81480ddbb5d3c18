"""`irt prove` as a user runs it, with a concealed world of a few rows."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORLD = f"{sys.executable} {ROOT / 'tests' / 'unit' / 'proof' / 'fake_world.py'}"
TINY = ("--rigs", "1", "--nulls", "1", "--seed", "3", "--jobs", "1", "--world", WORLD)


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder of a proof of two rigs, and what the command said."""
    out = tmp_path_factory.mktemp("proved") / "proof"
    done = subprocess.run(
        command(*TINY, "--out", out), capture_output=True, text=True, env=env(), check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    return out, done.stdout


def command(*words: str | Path) -> list[str]:
    return [sys.executable, "-m", "irt.cli", "prove", *(str(word) for word in words)]


def env() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT / "python"), "OMP_NUM_THREADS": "1"}


@pytest.mark.slow
def test_it_hides_diagnoses_and_scores(proved: tuple[Path, str]) -> None:
    out, said = proved
    assert said.startswith("1 rig with hidden physics and 1 without, diagnosed blind: ")
    assert "false alarms: 0.000 (0.000 to 0.793), floor at most 2 %, over 1\n" in said
    assert said.endswith(f"wrote {out / 'proof.md'}\n")
    scores = json.loads((out / "proof" / "scores.json").read_text())
    assert {one["group"]: one["verdict"] for one in scores["rigs"]} == {
        "single": "missing",
        "none": "sufficient",
    }
    (hidden,) = [one for one in scores["rigs"] if one["group"] == "single"]
    assert (hidden["named"], hidden["exact"]) == (["parallax"], True)
    assert hidden["closed"] > 0.9
    assert (out / "proof.md").read_text().startswith("# Proof by concealment\n")


@pytest.mark.slow
def test_the_same_command_keeps_what_is_there(irt, proved: tuple[Path, str]) -> None:
    out, said = proved
    answers = {path: path.stat().st_mtime_ns for path in (out / "answers").rglob("*.json")}
    done = irt("prove", *TINY, "--out", out)
    assert (done.status, done.out) == (0, said)
    assert {path: path.stat().st_mtime_ns for path in (out / "answers").rglob("*.json")} == answers


@pytest.mark.slow
def test_other_methods_and_another_place_for_the_page(irt, proved, monkeypatch, tmp_path: Path) -> None:
    out, _ = proved
    contest = import_module("irt.proof.contest")
    assert set(contest.METHODS) == {"alone", "single", "gaussian", "sindy", "whiteness"}
    page = tmp_path / "docs" / "card.md"
    done = irt("prove", *TINY, "--out", out, "--baselines", "--page", page)
    assert (done.status, done.err) == (0, "")
    text = page.read_text()
    assert "## Beside other methods" in text
    assert "best single effect by training error" in text
    assert len(json.loads((page.with_suffix("") / "scores.json").read_text())["baselines"]) == 10


@pytest.mark.slow
def test_rounds_end_on_one_page(irt, monkeypatch, tmp_path: Path) -> None:
    """Stopped in the second round, the page covers the first, and the same command resumes."""
    monkeypatch.chdir(tmp_path)
    words = ("--rounds", "2", "--rigs", "0", "--nulls", "1", "--jobs", "1", "--world", WORLD, "--out", "out")
    run = import_module("irt.proof.run").Proof.run

    def stopped(proof):
        if proof.places.out.name == "round-2":
            raise KeyboardInterrupt
        return run(proof)

    monkeypatch.setattr("irt.proof.run.Proof.run", stopped)
    assert irt("prove", *words).status == 130
    page = Path("out/proof.md")
    assert "| rounds | 1 of 2 are finished, and counted here |" in page.read_text()
    verified = irt("prove", "--verify", "--out", "out")
    assert (verified.status, verified.err) == (0, "")
    first, second = verified.out.splitlines()
    assert first.startswith("out: 1 rigs: labels, recordings and answers are unchanged since")
    assert second == (
        "out/round-2: not finished, and not checked: its rigs are not all hidden; the same command goes on"
    )
    monkeypatch.setattr("irt.proof.run.Proof.run", run)
    done = irt("prove", *words)
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith("0 rigs with hidden physics and 2 without, diagnosed blind: ")
    assert "| rounds | 2 of 2 are finished, and counted here |" in page.read_text()
    for number in (1, 2):
        assert f"| `keys.json`, round {number} |" in page.read_text()
    assert irt("prove", "--verify", "--out", "out").out.startswith("out: 2 rigs: ")
    # A page of two rounds never covers only one again.
    written, scorecard = [], import_module("irt.proof.scorecard")
    write = scorecard.write_scorecard
    monkeypatch.setattr(
        scorecard,
        "write_scorecard",
        lambda page, results, rounds, *rest, **more: (
            written.append(len(rounds)) or write(page, results, rounds, *rest, **more)
        ),
    )
    assert irt("prove", *words).status == 0
    assert written == [2]


@pytest.mark.slow
def test_rounds_of_another_day_are_added_to_a_page(irt, monkeypatch, tmp_path: Path) -> None:
    """Given again, the command counts nothing twice; what others have added since is not taken away."""
    monkeypatch.chdir(tmp_path)
    words = ("--rigs", "0", "--nulls", "1", "--jobs", "1", "--world", WORLD)
    page = Path("docs/proof.md")
    first = irt("prove", "--full", "--rounds", "1", *words, "--out", "one", "--page", page)
    assert (first.status, first.err) == (0, "")
    for _ in range(2):
        second = irt("prove", *words, "--out", "two", "--onto", page)
        assert (second.status, second.err) == (0, "")
        assert second.out.startswith("0 rigs with hidden physics and 2 without, diagnosed blind: ")
        scores = json.loads(Path("docs/proof/scores.json").read_text())
        assert [one["rig"] for one in scores["rigs"]] == ["rig-0001", "rig-0002"]
        assert [one["rigs"] for one in scores["rounds"]] == [1, 1]
    assert irt("prove", *words, "--out", "three", "--onto", page).out.startswith(
        "0 rigs with hidden physics and 3"
    )
    refused = irt("prove", *words, "--out", "two", "--onto", page)
    assert refused.status == 1
    assert refused.err == (
        "irt: docs/proof.md: another proof has been added since this one began; choose another --out\n"
    )
    assert (
        irt("prove", *words, "--onto", page, "--page", page).err
        == "irt: --onto names the page: leave --page out\n"
    )
    assert (
        irt("prove", *words, "--out", "four", "--onto", "none.md").err
        == "irt: none/scores.json: no such file\n"
    )


@pytest.mark.slow
def test_verify_finds_what_was_altered(irt, proved: tuple[Path, str]) -> None:
    out, _ = proved
    done = irt("prove", "--verify", "--out", out)
    assert (done.status, done.err) == (0, "")
    assert done.out == f"{out}: 2 rigs: labels, recordings and answers are unchanged since they were sealed\n"
    path = out / "answers" / "rig-0002" / "diagnosis.json"
    was = path.read_bytes()
    path.write_bytes(was.replace(b"sufficient", b"missing"))
    path.write_bytes(path.read_bytes() + b" ")
    for words in (("--verify",), TINY):
        done = irt("prove", *words, "--out", out)
        assert (done.status, done.out) == (1, "")
        assert done.err.startswith("irt: rig-0002: the answer is not the one of the manifest")
        assert done.err.count("\n") == 1
    path.write_bytes(was)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals of Unix")
def test_ctrl_c_leaves_what_is_done(tmp_path: Path) -> None:
    out = tmp_path / "proof"
    process = subprocess.Popen(
        command(*TINY, "--out", out), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env()
    )
    until = time.monotonic() + 60.0
    while not (out / "commitments.json").exists() and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, err = process.communicate(timeout=30)
    assert (process.returncode, said) == (130, "")
    assert err == f"irt: finished work is kept in {out}; the same command resumes it\nirt: stopped\n"
    assert len(list((out / "seals").iterdir())) == 2
    assert not (out / "keys.json").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--rigs", "0", "--nulls", "0"), "irt: a proof needs at least one rig"),
        (("--verify",), "irt: none/commitments.json: no such file"),
        (("--world", "no-such-program"), "irt: the concealed world cannot be started (no-such-program): "),
        (("--world", f"{sys.executable} -c pass"), "irt: the concealed world ended before it answered"),
    ],
)
def test_what_cannot_be_done(irt, monkeypatch, tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    done = irt("prove", "--rigs", "1", "--out", "none", *words)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(message)
    assert done.err.count("\n") == 1


@pytest.mark.parametrize(("missing", "title"), [("pybullet", "PyBullet"), ("cryptography", "cryptography")])
def test_a_missing_package_is_one_clear_line(
    irt, monkeypatch, tmp_path: Path, missing: str, title: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    done = irt("prove", "--out", tmp_path / "proof")
    assert (done.status, done.out) == (1, "")
    assert done.err == f"irt: irt prove needs {title}: pip install 'labsim-irt[prove]'\n"
    assert not (tmp_path / "proof").exists()


@pytest.mark.parametrize("words", [("--rigs", "-1"), ("--jobs", "0"), ("--seed", "x")])
def test_wrong_usage_of_prove(irt, words: tuple[str, ...]) -> None:
    done = irt("prove", *words)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("usage: irt prove")
