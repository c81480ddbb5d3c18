"""The sealing process: makes rigs, seals their labels, and releases the keys only for a manifest.

    python -m irt.proof.sealing VAULT PLAN SEED GENERATOR...

Requests and answers are lines of JSON on standard input and output (`irt.proof.pipe`):

``{"begin": {}}``
    creates the vault.
``{"make": {"index": 3, "folder": "..."}}``
    makes the generator write a rig's recordings into the folder; answers only with its seal.
``{"release": {"manifest": {...}}}``
    stores the SHA-256 of the manifest of all answers, then answers with the keys and the seed. It does so
    for one manifest only, so that answers cannot change afterwards.

The concealed world is a process of the same kind. For a request

``{"make": {"index": 3, "kind": "none|outliers|single|pair|unlisted", "folder": "...", "seed": 7}}``

it writes the rig's recordings and ``rig.toml`` into the folder, and answers ``{"label": {...}}``: ``kind``
(an effect, two effects, ``none``, ``outliers`` or ``unlisted_...``), ``truth`` (parameters by name,
``effects``), ``sigma`` of the tracker [board edges], ``noise``, ``through_camera``, and ``tests`` by name,
each with its ``csv`` and the ``clean`` path [board edges]. ``lost`` names the runs that its tracker could not
read, with the reasons; their cells are empty, and ``sigma`` is null if there is no other run. Such a rig is
sealed like any other. Its diagnosis fails, which counts.

A world may also record further runs of its rigs after the manifest is written. For a request
``{"record": {"index": 3, "kind": "...", "seed": 7, "csv": "..."}}`` with commands and a start in row 0 it
answers ``{"csv": "..."}``, the tracked run.

Keys are stored in the vault, so that a long proof can continue after a crash. No diagnosis receives its path.
"""

from __future__ import annotations

import json
import secrets
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.files import make_folder, read_json, write_atomic
from irt.proof.pipe import Pipe, serve
from irt.proof.plan import Plan, seed_of
from irt.proof.seal import Key, canonical, close, digest, digests


class Vault:
    """The folder of the seed and the keys, which stay secret until the manifest is written.

    Parameters
    ----------
    folder : Path
        Created if missing, readable only by its owner.
    plan : Plan
        The rigs of the proof.
    seed : int or None
        Seed of the whole proof; by default from the operating system.

    Raises
    ------
    IrtError
        If the vault belongs to another proof.
    """

    def __init__(self, folder: Path, plan: Plan, seed: int | None) -> None:
        self._folder = make_folder(folder)
        folder.chmod(0o700)
        secret = folder / "secret.json"
        if not secret.exists():
            drawn = secrets.randbits(64) if seed is None else seed
            write_atomic(secret, canonical({"seed": drawn, "plan": plan.as_dict()}))
        known = read_json(secret)
        if known["plan"] != plan.as_dict() or seed not in (None, known["seed"]):
            raise IrtError(f"{folder.parent}: holds a proof of another plan or seed; choose another --out")
        self.seed: int = known["seed"]

    @property
    def is_released(self) -> bool:
        """Whether the keys are released."""
        return (self._folder / "released.json").exists()

    def keep(self, rig: str, key: Key) -> None:
        """Store the key of a rig."""
        write_atomic(self._folder / f"{rig}.json", canonical(key.as_dict()))

    def release(self, manifest: Mapping[str, Any], rigs: Sequence[str]) -> dict[str, Any]:
        """Store the manifest's hash for which the keys are released, and return the keys.

        Raises
        ------
        IrtError
            If an answer is missing from the manifest, or the keys were released for another one.
        """
        missing = [rig for rig in rigs if rig not in manifest.get("answers", {})]
        if missing:
            raise IrtError(f"{missing[0]}: the manifest has no answer for it; no key is released")
        hashed = digest(canonical(manifest))
        released = self._folder / "released.json"
        if not released.exists():
            write_atomic(released, canonical({"manifest": hashed}))
        if read_json(released)["manifest"] != hashed:
            raise IrtError("the keys were released for other answers, which were changed since")
        keys = {rig: read_json(self._folder / f"{rig}.json") for rig in rigs}
        return {"manifest": hashed, "keys": keys, "seed": self.seed}


class Sealer:
    """Makes rigs through the concealed world, and seals them.

    Parameters
    ----------
    vault : Vault
        Storage of the keys.
    plan : Plan
        The rigs of the proof.
    generator : sequence of str
        The command of the concealed world.
    """

    def __init__(self, vault: Vault, plan: Plan, generator: Sequence[str]) -> None:
        self._vault, self._plan, self._command = vault, plan, generator
        self._kinds = plan.order(vault.seed)
        self._generator: Pipe | None = None

    def answer(self, request: dict[str, Any]) -> Mapping[str, Any]:
        """Answer a request."""
        if "begin" in request:
            return {}
        if "make" in request:
            return self._make(int(request["make"]["index"]), Path(request["make"]["folder"]))
        if "record" in request:
            return self._record(int(request["record"]["index"]), str(request["record"]["csv"]))
        if "release" in request:
            return self._vault.release(request["release"]["manifest"], self._plan.names())
        raise IrtError(f"unknown request: {', '.join(request)}")

    def close(self) -> None:
        """End the concealed world."""
        if self._generator is not None:
            self._generator.close()

    def _world(self) -> Pipe:
        if self._generator is None:
            self._generator = Pipe(self._command, "the concealed world", apart=False)
        return self._generator

    def _asked(self, index: int) -> dict[str, Any]:
        return {"index": index, "kind": self._kinds[index], "seed": seed_of(self._vault.seed, index)}

    def _record(self, index: int, csv: str) -> Mapping[str, Any]:
        if not self._vault.is_released:
            raise IrtError("no further run is recorded before the answers are written down")
        return {"csv": self._world().ask({"record": {**self._asked(index), "csv": csv}})["csv"]}

    def _make(self, index: int, folder: Path) -> Mapping[str, Any]:
        rig = self._plan.name_of(index)
        asked = {**self._asked(index), "folder": str(folder)}
        made = self._world().ask({"make": asked})
        label = {"rig": rig, "asked": asked["kind"], "recordings": digests(folder), "label": made["label"]}
        seal, key = close(rig, label)
        self._vault.keep(rig, key)
        return seal.as_dict()


def command(vault: Path, plan: Plan, seed: int | None, generator: Sequence[str]) -> list[str]:
    """Return the command that starts the process."""
    what = json.dumps(plan.as_dict())
    return [sys.executable, "-m", __name__, str(vault), what, "-" if seed is None else str(seed), *generator]


def main(words: Sequence[str]) -> None:
    """Answer requests until standard input ends."""
    folder, planned, seed, *generator = words
    plan = Plan(**json.loads(planned))
    try:
        vault = Vault(Path(folder), plan, None if seed == "-" else int(seed))
    except IrtError as error:
        message = str(error)

        def refuse(_: object) -> dict[str, str]:
            return {"error": message}

        return serve(refuse)
    sealer = Sealer(vault, plan, generator)
    try:
        serve(sealer.answer)
    finally:
        sealer.close()
    return None


if __name__ == "__main__":
    main(sys.argv[1:])
