"""A full proof is of one commit, which is found or refused."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.proof.provenance import clean_commit


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    def git(*words: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@b")
        subprocess.run(["git", "-C", str(tmp_path), *who, *words], check=True, capture_output=True)

    git("init")
    (tmp_path / "code.py").write_text("1\n")
    git("add", ".")
    git("commit", "-m", "one")
    return tmp_path


def test_a_clean_checkout_has_a_commit(checkout: Path) -> None:
    (checkout / "notes.txt").write_text("not tracked")
    assert len(clean_commit(checkout)) == 40


def test_a_changed_file_is_named(checkout: Path) -> None:
    (checkout / "code.py").write_text("2\n")
    with pytest.raises(IrtError, match=r"one commit; code\.py was changed since: commit it first"):
        clean_commit(checkout)


def test_without_git_there_is_no_commit(tmp_path: Path) -> None:
    with pytest.raises(IrtError, match="no git checkout"):
        clean_commit(tmp_path)
