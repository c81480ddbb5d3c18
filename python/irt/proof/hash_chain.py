"""The files of a proof, each with the SHA-256 of the one before it, and their verification.

``plan.json`` (the list of rigs, the code, a commitment to the seed) is written before the first rig,
``commitments.json`` (the commitment to each label, the SHA-256 of each recording) before the first diagnosis,
``manifest.json`` (the SHA-256 of each answer) after the last one, and ``keys.json`` (the seed, and the nonce
of all commitments) after that.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.files import atomic_folder, make_folder, read_json, read_toml, write_atomic
from irt.proof.blind import CODE
from irt.proof.plan import Plan, group_of
from irt.proof.seal import canonical, commitment, digest, digests
from irt.rig import read_start

#: The files of the chain, in their order; they are published.
CHAIN = ("plan.json", "commitments.json", "manifest.json", "keys.json")


class Places:
    """The paths of a proof in the folder `out`: the files of the chain, and folders by the name of a rig.

    ``vault`` holds seed, nonce and labels until the last answer is written, and is closed to other users.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self.plan, self.commitments, self.manifest, self.keys = (out / name for name in CHAIN)
        self.secret = out / "vault" / "secret.json"

    def rig(self, name: str) -> Path:
        """Return the folder of a rig's recordings."""
        return self.out / "rigs" / name

    def start(self, name: str) -> str:
        """Return the start state of a rig's recordings: "rest" or "moving"."""
        # Not from the rig as a whole, because a recording without a marble has no start state.
        return read_start(read_toml(self.rig(name) / "rig.toml"))

    def label(self, name: str) -> Path:
        """Return the file of a rig's label before the seals are opened."""
        return self.out / "vault" / f"{name}.json"

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


@dataclass(frozen=True)
class Secret:
    """Seed of the proof, and the nonce of the commitments to it and to the labels."""

    seed: int
    nonce: str

    @property
    def commitment(self) -> str:
        """The commitment to the seed."""
        return commitment(self.nonce, "seed", self.seed)


def begin(places: Places, plan: Plan, seed: int | None, provenance: Mapping[str, str]) -> Secret:
    """Publish the plan of a new proof, or check that of an existing one; return its secret.

    `seed` is by default from the operating system; `provenance` holds ``world``, ``code`` and ``commit``.

    Raises
    ------
    IrtError
        If the folder holds a proof of another plan or seed, or an unfinished one of another code.
    """
    make_folder(places.secret.parent).chmod(0o700)
    if not places.plan.exists():
        secret = Secret(secrets.randbits(64) if seed is None else seed, secrets.token_hex(32))
        write_atomic(places.secret, canonical(vars(secret)))
        content = {"plan": plan.as_dict(), "seed": secret.commitment, **provenance}
        write_atomic(places.plan, canonical(content))
    secret, published = Secret(**read_json(places.secret)), read_json(places.plan)
    if published["plan"] != plan.as_dict() or seed not in (None, secret.seed):
        raise IrtError(f"{places.out}: holds a proof of another plan or seed; choose another --out")
    if published["code"] != provenance["code"] and not places.keys.exists():
        raise IrtError(
            f"{places.out}: an unfinished proof of {published['code']}, and this is {provenance['code']}; "
            "resume it with that version, or choose another --out"
        )
    return secret


def commit(places: Places, names: list[str], secret: Secret) -> None:
    """Write the commitments to all rigs."""
    content = {
        "plan": digest(places.plan.read_bytes()),
        "commitments": {
            name: commitment(secret.nonce, name, read_json(places.label(name))) for name in names
        },
        "recordings": {name: digests(places.rig(name)) for name in names},
    }
    write_atomic(places.commitments, canonical(content))


def release(places: Places, names: list[str], secret: Secret) -> None:
    """Write the manifest of all answers, then seed and nonce for this manifest, open the labels, and verify.

    Raises
    ------
    IrtError
        If an answer is missing, or any part of the proof was altered.
    """
    if not places.manifest.exists():
        if missing := [name for name in names if not places.answer(name).exists()]:
            raise IrtError(f"{missing[0]}: there is no answer; the key is not released")
        for name in names:
            _check_code(places, name)
        answers = {name: digests(places.answer(name)) for name in names}
        before = digest(places.commitments.read_bytes())
        write_atomic(places.manifest, canonical({"commitments": before, "answers": answers}))
    if not places.keys.exists():
        hashed = digest(places.manifest.read_bytes())
        write_atomic(places.keys, canonical({"manifest": hashed, **vars(secret)}))
    make_folder(places.out / "opened")
    for name in names:
        if not places.opened(name).exists():
            write_folder(places.opened(name), _opened(read_json(places.label(name))))
    verify(places.out)


def verify(out: Path) -> int:
    """Check a proof, and return its number of rigs; without ``opened/``, check the published chain alone.

    Raises
    ------
    IrtError
        If it is not finished, or a plan, label, recording, commitment, answer or seed was altered.
    """
    places = Places(out)
    published = read_json(places.plan, "the folder of a proof with --out")
    plan = Plan(**published["plan"])
    names = plan.names()
    for path in (places.commitments, places.manifest, places.keys):
        if not path.exists():
            done = sum(places.answer(name).exists() for name in names)
            raise IrtError(
                f"{out}: not finished: no {path.name} yet, {done} of {plan.rigs} rigs are diagnosed"
            )
    for before, path in pairwise(places.out / name for name in CHAIN):
        if read_json(path)[before.stem] != digest(before.read_bytes()):
            raise IrtError(f"{before}: not the one that {path.name} is of: one of them was altered")
    if names != list(read_json(places.commitments)["commitments"]):
        raise IrtError(f"{places.commitments}: not the rigs of the plan: one of them was altered")
    keys = read_json(places.keys)
    secret = Secret(keys["seed"], keys["nonce"])
    if published["seed"] != secret.commitment:
        raise IrtError(f"{places.keys}: not the seed that the plan is committed to: it was altered")
    if places.opened(names[0]).parent.is_dir():
        for name, kind in zip(names, plan.order(secret.seed), strict=True):
            _check_rig(places, name, kind, secret)
    return plan.rigs


def _check_rig(places: Places, name: str, kind: str, secret: Secret) -> None:
    """Raise unless label, held-out runs, recordings and answer of a rig are those of the chain."""
    committed, answers = read_json(places.commitments), read_json(places.manifest)["answers"]
    label = read_json(places.opened(name) / "label.json")
    if answers.get(name) != digests(places.answer(name)):
        raise IrtError(f"{name}: the answer is not the one of the manifest: it was altered afterwards")
    if committed["commitments"][name] != commitment(secret.nonce, name, label):
        raise IrtError(f"{name}: the label does not fit its published commitment: one of them was altered")
    if digests(places.opened(name)) != {one: digest(data) for one, data in _opened(label).items()}:
        raise IrtError(f"{name}: the held-out runs are not those of the label: they were altered")
    if committed["recordings"][name] != digests(places.rig(name)):
        raise IrtError(f"{name}: its recordings are not those that were committed to: they were altered")
    _check_code(places, name)
    if group_of(label)[0] != kind:
        raise IrtError(f"{name}: its label is not of the kind that plan and seed give it")


def _check_code(places: Places, name: str) -> None:
    """Raise unless the code of the plan found the answer of a rig; a diagnosis that failed names none."""
    said, planned = places.answer(name) / CODE, read_json(places.plan)["code"]
    if said.exists() and (found := read_json(said)["code"]) != planned:
        raise IrtError(f"{name}: diagnosed by {found}, and the plan is of {planned}: the code was changed")


def _opened(label: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the files of an opened label: itself, and the held-out runs."""
    runs = {f"{run}.csv": test["csv"].encode() for run, test in label["tests"].items()}
    return {"label.json": canonical(label), **runs}


def write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a temporary folder beside their own, and rename it."""
    with atomic_folder(folder) as beside:
        for name, data in files.items():
            (beside / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomic(beside / name, data)
