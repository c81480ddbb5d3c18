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

from irt.errors import IrtError

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
    assert "false alarms: 0.000 (0.000 to 0.793), floor at most 1 %, over 1\n" in said
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
def test_a_finished_proof_is_drawn_again_from_its_files(irt, proved: tuple[Path, str]) -> None:
    """Without the numbers of rigs, which its plan has, and without another run of anything."""
    out, _ = proved
    picture = out / "proof" / "power.png"
    drawn = picture.read_bytes()
    picture.unlink()
    (out / "proof.md").unlink()
    done = irt("prove", "--out", out, "--world", "no-such-program")
    assert (done.status, done.err) == (0, "")
    assert picture.read_bytes() == drawn
    assert (out / "proof.md").read_text().startswith("# Proof by concealment\n")


@pytest.mark.slow
def test_other_methods_and_another_place_for_the_page(irt, proved, monkeypatch, tmp_path: Path) -> None:
    out, _ = proved
    contest = import_module("irt.proof.contest")
    assert set(contest.METHODS) == {"alone", "single", "gaussian", "neural", "sysid", "sindy", "whiteness"}
    page = tmp_path / "docs" / "card.md"
    done = irt("prove", *TINY, "--out", out, "--baselines", "--page", page)
    assert (done.status, done.err) == (0, "")
    text = page.read_text()
    assert "## Beside other methods" in text
    assert "best single effect by training error" in text
    assert len(json.loads((page.with_suffix("") / "scores.json").read_text())["baselines"]) == 14


@pytest.mark.slow
def test_a_full_proof_names_its_commit_and_publishes_the_chain(irt, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr("irt.proof.provenance.clean_commit", lambda: "0123abc")
    page = tmp_path / "docs" / "proof.md"
    words = ("--rigs", "0", "--nulls", "1", "--jobs", "1", "--world", WORLD, "--out", tmp_path / "out")
    done = irt("prove", "--full", *words, "--page", page)
    assert (done.status, done.err) == (0, "")
    text = page.read_text()
    assert "| commit | 0123abc |" in text
    assert "With 0 rigs with hidden physics and 1 without, this proof is smaller than the full proof" in text

    def changed() -> str:
        raise IrtError("docs/proof.md was changed since")

    monkeypatch.setattr("irt.proof.provenance.clean_commit", changed)
    again = irt("prove", "--full", *words, "--page", page)
    assert (again.status, page.read_text()) == (0, text)
    fresh = irt("prove", "--full", *words[:-1], tmp_path / "fresh")
    assert (fresh.status, fresh.err) == (1, "irt: docs/proof.md was changed since\n")
    checked = irt("prove", "--verify", "--out", page.with_suffix(""))
    assert checked.out.endswith(
        "proof: 1 rigs: plan, commitments, manifest and keys fit; recordings and answers are elsewhere\n"
    )


@pytest.mark.slow
def test_verify_finds_what_was_altered(irt, proved: tuple[Path, str]) -> None:
    out, _ = proved
    done = irt("prove", "--verify", "--out", out)
    assert (done.status, done.err) == (0, "")
    assert (
        done.out
        == f"{out}: 2 rigs: labels, recordings and answers are unchanged since they were committed to\n"
    )
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
    until = time.monotonic() + 120.0
    while not (out / "commitments.json").exists() and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, err = process.communicate(timeout=120)
    assert (process.returncode, said) == (130, "")
    assert err == f"irt: finished work is kept in {out}; the same command resumes it\nirt: stopped\n"
    assert len(list((out / "vault").glob("rig-*.json"))) == 2
    assert not (out / "keys.json").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--rigs", "0", "--nulls", "0"), "irt: a proof needs at least one rig"),
        (("--verify",), "irt: none/plan.json: no such file"),
        (
            ("--world", "no-such-program"),
            "irt: the program that makes the rigs cannot be started (no-such-program): ",
        ),
        (
            ("--world", f"{sys.executable} -c pass"),
            "irt: the program that makes the rigs ended before it answered",
        ),
    ],
)
def test_what_cannot_be_done(irt, monkeypatch, tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    done = irt("prove", "--rigs", "1", "--out", "none", *words)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(message)
    assert done.err.count("\n") == 1


def test_a_missing_package_is_one_clear_line(irt, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    done = irt("prove", "--out", tmp_path / "proof")
    assert (done.status, done.out) == (1, "")
    assert done.err == "irt: irt prove needs PyBullet: pip install 'labsim-irt[prove]'\n"
    assert not (tmp_path / "proof").exists()


@pytest.mark.parametrize("words", [("--rigs", "-1"), ("--jobs", "0"), ("--seed", "x")])
def test_wrong_usage_of_prove(irt, words: tuple[str, ...]) -> None:
    done = irt("prove", *words)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("usage: irt prove")
