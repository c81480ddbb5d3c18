"""The hash chain of a proof: seals, answers, manifest and keys, and their verification.

``keys.json`` contains the SHA-256 of ``manifest.json``. The manifest contains the hashes of each answer and
of ``commitments.json``, which contains the hashes of each label and of each recording.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.files import make_folder, read_json, read_toml, write_atomic
from irt.proof.seal import Key, Seal, canonical, digest, digests, open_seal
from irt.rig import read_start


@dataclass(frozen=True)
class Places:
    """The paths of a proof.

    Attributes
    ----------
    out : Path
        The folder of the proof.
    """

    out: Path

    @property
    def vault(self) -> Path:
        """The folder of seed and keys, which only the sealing process reads before the manifest exists."""
        return self.out / "vault"

    @property
    def commitments(self) -> Path:
        """The commitments, published before the first diagnosis."""
        return self.out / "commitments.json"

    @property
    def manifest(self) -> Path:
        """The manifest, written after the last diagnosis and before the release of a key."""
        return self.out / "manifest.json"

    @property
    def keys(self) -> Path:
        """The keys, released for the manifest."""
        return self.out / "keys.json"

    def rig(self, name: str) -> Path:
        """Return the folder of a rig's recordings."""
        return self.out / "rigs" / name

    def start(self, name: str) -> str:
        """Return the start state of a rig's recordings: "rest" or "moving"."""
        # Not from the rig as a whole, because a recording without a marble has no start state.
        return read_start(read_toml(self.rig(name) / "rig.toml"))

    def seal(self, name: str) -> Path:
        """Return the file of a rig's seal."""
        return self.out / "seals" / f"{name}.json"

    def answer(self, name: str) -> Path:
        """Return the folder of the diagnosis' output."""
        return self.out / "answers" / name

    def opened(self, name: str) -> Path:
        """Return the folder of a rig's opened label and held-out runs."""
        return self.out / "opened" / name

    def further(self, name: str) -> Path:
        """Return the folder of the diagnosis' output with one more run."""
        return self.out / "further" / name

    def contest(self, name: str) -> Path:
        """Return the folder of the other methods' output."""
        return self.out / "baselines" / name


def commitments(places: Places, names: Sequence[str]) -> dict[str, Any]:
    """Return the content of the commitments: commitment and recordings' hashes of each rig."""
    seals = {name: read_json(places.seal(name)) for name in names}
    return {
        "commitments": {name: seal["commitment"] for name, seal in seals.items()},
        "recordings": {name: digests(places.rig(name)) for name in names},
    }


def manifest(places: Places, names: Sequence[str]) -> dict[str, Any]:
    """Return the content of the manifest: the SHA-256 of all answers and of the commitments."""
    return {
        "commitments": digest(places.commitments.read_bytes()),
        "answers": {name: digests(places.answer(name)) for name in names},
    }


def check_answers(places: Places, names: Sequence[str]) -> None:
    """Raise unless answers and commitments are those of the manifest.

    Raises
    ------
    IrtError
        With one line that contains the rig's name.
    """
    written = read_json(places.manifest)
    if digest(places.commitments.read_bytes()) != written["commitments"]:
        raise IrtError(f"{places.commitments}: not what the manifest says: it was altered after publication")
    for name in names:
        if written["answers"].get(name) != digests(make_folder(places.answer(name))):
            raise IrtError(f"{name}: the answer is not the one of the manifest: it was altered afterwards")


def open_all(places: Places, names: Sequence[str]) -> None:
    """Open the seals with the released keys, and write labels and held-out runs.

    Raises
    ------
    IrtError
        If any part of the chain was altered; one line with the rig's name.
    """
    for name, content in opened(places, names).items():
        label = content["label"]
        files = {"label.json": canonical(label)}
        files.update({f"{run}.csv": test["csv"].encode() for run, test in label["tests"].items()})
        shutil.rmtree(places.opened(name), ignore_errors=True)
        write_folder(places.opened(name), files)


def unfinished(places: Places) -> str:
    """Return the missing step of an unfinished proof as a phrase; empty if it can be checked.

    After the release of its keys only labels can be missing, which the keys open. Any other missing file was
    removed, and `verify` reports it.
    """
    if places.keys.exists():
        names = read_json(places.commitments)["commitments"] if places.commitments.exists() else ()
        are_open = all((places.opened(name) / "label.json").exists() for name in names)
        return "" if are_open else "its seals are not all open"
    if not places.commitments.exists():
        return "its rigs are not all hidden"
    return "its keys are not released" if places.manifest.exists() else "its rigs are not all diagnosed"


def verify(out: Path) -> int:
    """Check a proof from end to end, and return its number of rigs.

    Raises
    ------
    IrtError
        If it is not finished, or a label, a recording, a commitment or an answer was altered.
    """
    places = Places(out)
    names = list(read_json(places.commitments)["commitments"])
    for name, content in opened(places, names).items():
        path = places.opened(name) / "label.json"
        if not path.exists() or path.read_bytes() != canonical(content["label"]):
            raise IrtError(f"{name}: the label that was opened is not the one that was sealed")
    return len(names)


def opened(places: Places, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the sealed labels after a check of the whole chain."""
    keys, published = read_json(places.keys), read_json(places.commitments)
    if digest(canonical(read_json(places.manifest))) != keys["manifest"]:
        raise IrtError(f"{places.manifest}: not the one that the keys were released for: it was altered")
    check_answers(places, names)
    found = {}
    for name in names:
        seal = Seal(**read_json(places.seal(name)))
        content = open_seal(seal, Key(**keys["keys"][name]), published["commitments"][name])
        if content["rig"] != name:
            raise IrtError(f"{name}: its seal holds the label of {content['rig']}: the two were swapped")
        if content["recordings"] != digests(places.rig(name)):
            raise IrtError(f"{name}: its recordings are not those that were sealed: they were altered")
        found[name] = content
    return found


def write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a temporary folder beside their own, and rename it."""
    beside = folder.with_name(f".irt-{secrets.token_hex(4)}")
    beside.mkdir()
    for name, data in files.items():
        (beside / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomic(beside / name, data)
    beside.replace(folder)
