"""A proof in rounds: each stands for itself, and together they are one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.proof.hash_chain import Places
from irt.proof.results import Results
from irt.proof.rounds import Checked, Rounds, verify_all


def test_rounds_share_neither_a_folder_nor_a_name_nor_a_seed(tmp_path: Path) -> None:
    rounds = list(Rounds(tmp_path, 3, hidden=6, nulls=4, seed=5))
    assert [one.places.out for one in rounds] == [tmp_path / f"round-{number}" for number in (1, 2, 3)]
    names = [name for one in rounds for name in one.plan.names()]
    assert names == [f"rig-{number:04d}" for number in range(1, 31)]
    assert len({one.seed for one in rounds}) == 3
    assert rounds[0].seed == 5


def test_the_only_round_is_the_proof_itself(tmp_path: Path) -> None:
    (only,) = Rounds(tmp_path, 1, hidden=2, nulls=1, seed=5)
    assert (only.places, only.seed, only.plan.names()[0]) == (Places(tmp_path), 5, "rig-0001")


def test_a_missing_seed_is_drawn_for_each(tmp_path: Path) -> None:
    assert [one.seed for one in Rounds(tmp_path, 2, hidden=2, nulls=1)] == [None, None]


def test_scores_of_rounds_are_scores_of_one_proof(score: Callable) -> None:
    results = Results.joined([Results((score(), score("none"))), Results((score("pair"),))])
    assert [one.group for one in results.scores] == ["single", "none", "pair"]


@pytest.fixture
def rounds(finished: Path, tmp_path: Path) -> Path:
    """Return the folder of a proof of two rounds that are finished."""
    for number in (1, 2):
        shutil.copytree(finished, tmp_path / f"round-{number}")
    return tmp_path


def test_every_round_is_checked(rounds: Path, finished: Path) -> None:
    assert verify_all(finished) == Checked(3)
    assert verify_all(rounds) == Checked(6)
    answer = next((rounds / "round-2" / "answers").rglob("*.json"))
    answer.write_bytes(answer.read_bytes() + b" ")
    with pytest.raises(IrtError, match="the answer is not the one of the manifest"):
        verify_all(rounds)


@pytest.mark.parametrize(
    ("gone", "words"),
    [
        (("opened/rig-0002",), "its seals are not all open"),
        (("opened", "keys.json"), "its keys are not released"),
        (("opened", "keys.json", "manifest.json", "answers/rig-0003"), "its rigs are not all diagnosed"),
        (
            ("opened", "keys.json", "manifest.json", "answers", "commitments.json"),
            "its rigs are not all hidden",
        ),
        ((".",), "its rigs are not all hidden"),
    ],
)
def test_a_last_round_that_is_unfinished_is_named(rounds: Path, gone: tuple[str, ...], words: str) -> None:
    """It used to fail the whole check: keys.json: no such file."""
    last = rounds / "round-2"
    remove(last, *gone)
    last.mkdir(exist_ok=True)
    line = f"{last}: not finished, and not checked: {words}; the same command goes on"
    assert verify_all(rounds) == Checked(3, line)
    answer = next((rounds / "round-1" / "answers").rglob("*.json"))
    answer.write_bytes(answer.read_bytes() + b" ")
    with pytest.raises(IrtError, match="the answer is not the one of the manifest"):
        verify_all(rounds)


@pytest.mark.parametrize(
    ("gone", "message"),
    [
        (("round-1/opened", "round-1/keys.json"), "round-1: its keys are not released, though .* began"),
        (("round-1",), "round-1: is not there, though .* began"),
        (("round-2/manifest.json",), "manifest.json: no such file"),
    ],
)
def test_what_only_an_alteration_leaves_is_an_error(
    rounds: Path, gone: tuple[str, ...], message: str
) -> None:
    """A round begins once the one before it is finished, and keys go out for a manifest alone."""
    remove(rounds, *gone)
    with pytest.raises(IrtError, match=message) as caught:
        verify_all(rounds)
    assert "\n" not in str(caught.value)


def test_nothing_finished_is_nothing_to_check(rounds: Path) -> None:
    remove(rounds, "round-2", "round-1/keys.json")
    for place in (rounds, rounds / "round-1"):
        with pytest.raises(
            IrtError, match="round-1: not finished, and not checked: its keys are not released"
        ):
            verify_all(place)


def test_what_lies_beside_rounds_is_no_round(rounds: Path) -> None:
    (rounds / "round-2.bak").mkdir()
    (rounds / "round-table").mkdir()
    (rounds / "round-3").write_text("")
    assert verify_all(rounds) == Checked(6)


def remove(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
