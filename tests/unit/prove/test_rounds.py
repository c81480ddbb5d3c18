"""A proof in rounds: each stands for itself, and together they are one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.prove.chain import Places
from irt.prove.results import Results
from irt.prove.rounds import Rounds, verify_all


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


def test_a_seed_that_nobody_told_is_drawn_for_each(tmp_path: Path) -> None:
    assert [one.seed for one in Rounds(tmp_path, 2, hidden=2, nulls=1)] == [None, None]


def test_scores_of_rounds_are_scores_of_one_proof(score: Callable) -> None:
    results = Results.joined([Results((score(), score("none"))), Results((score("pair"),))])
    assert [one.group for one in results.scores] == ["single", "none", "pair"]


def test_every_round_is_checked(finished: Path, tmp_path: Path) -> None:
    for number in (1, 2):
        shutil.copytree(finished, tmp_path / f"round-{number}")
    assert verify_all(tmp_path) == 2 * verify_all(finished) == 6
    answer = next((tmp_path / "round-2" / "answers").rglob("*.json"))
    answer.write_bytes(answer.read_bytes() + b" ")
    with pytest.raises(IrtError, match="the answer is not the one of the manifest"):
        verify_all(tmp_path)
