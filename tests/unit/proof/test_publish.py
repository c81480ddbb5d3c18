"""What of a proof lies beside its page: the files of its rounds, all of them and no others.

After the first of several rounds they used to have no number, and stayed beside those of the second.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from irt.proof.hash_chain import Places
from irt.proof.publish import publish, withdraw

NAMES = ("commitments", "keys", "manifest")


def names(*numbers: int) -> list[str]:
    return sorted(f"{name}-{number}.json" for name in NAMES for number in numbers)


def listed(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def republished(folder: Path, *rounds: Places) -> list[str]:
    """Publish as a page does, and return what lies there then."""
    withdraw(folder, publish(folder, rounds))
    return listed(folder)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "docs" / "proof"
    path.mkdir(parents=True)
    return path


def test_the_first_round_has_its_number_too(places: Places, folder: Path) -> None:
    assert republished(folder, places) == names(1)
    assert (folder / "keys-1.json").read_bytes() == places.keys.read_bytes()
    assert republished(folder, places, places) == names(1, 2)


def test_what_an_earlier_page_left_is_withdrawn(places: Places, folder: Path) -> None:
    """Without a number, as they once were called, or of rounds that this proof does not have."""
    for name in NAMES:
        for ending in ("", "-2", "-12"):
            (folder / f"{name}{ending}.json").write_bytes(getattr(places, name).read_bytes())
    assert republished(folder, places) == names(1)


def test_a_page_without_them_keeps_none(places: Places, folder: Path) -> None:
    publish(folder, [places])
    withdraw(folder, set())
    assert listed(folder) == []


def test_what_is_not_ours_stays(places: Places, folder: Path) -> None:
    content = places.keys.read_bytes()
    (folder / "keys.json").write_text('{"piano": 88}')
    (folder / "manifest.json").write_text("[]")
    (folder / "commitments.json").write_bytes(b"\xff")
    (folder / "manifest-3.json").mkdir()
    others = {"keys-old.json", "my-keys-2.json", "keys-2.json.bak", "keys-02x.json"}
    for name in others:
        (folder / name).write_bytes(content)
    stays = {"keys.json", "manifest.json", "commitments.json", "manifest-3.json", *others}
    assert republished(folder, places) == sorted({*stays, *names(1)})


def test_the_proof_itself_is_never_withdrawn(places: Places) -> None:
    """A page `proof.md` beside a proof in `proof/` has that folder for its own."""
    before = {name: getattr(places, name).read_bytes() for name in NAMES}
    assert {*names(1), "keys.json"} <= set(republished(places.out, places))
    assert {name: getattr(places, name).read_bytes() for name in NAMES} == before


def test_nothing_is_half_written(places: Places, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader sees the old file or the new one, however the writing ends."""
    publish(folder, [places])
    old = (folder / "keys-1.json").read_bytes()
    places.keys.write_text(json.dumps({"manifest": "", "keys": {}, "seed": 1}))

    def full(_path: Path, _data: bytes) -> int:
        raise OSError(28, "no space left")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(ValueError, match="cannot be written"):
        publish(folder, [places])
    assert (folder / "keys-1.json").read_bytes() == old
    assert listed(folder) == names(1)
