"""The whole proof: hide, publish commitments, diagnose blind, write the answers down, open, check.

Everything lies in one folder, and a step that is done is not done again: after Ctrl-C or a crash the same
command goes on. `verify` goes through the chain once more, for anyone who is given the folder:

``keys.json`` names the SHA-256 of ``manifest.json``, which names that of each answer and of
``commitments.json``, which names that of each label and of each recording.
"""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np

from irt.errors import IrtError
from irt.files import make_folder, read_text, write_atomic
from irt.prove import sealing
from irt.prove.pipe import Pipe
from irt.prove.plan import Plan
from irt.prove.score import held_out, label_of
from irt.prove.seal import Key, Seal, canonical, digest, digests, open_seal
from irt.prove.workers import Files, Workers, files_of
from irt.recording import Recording
from irt.rig import load_rig
from irt.segments import LEAD_ROWS

Progress = Callable[[int, int, str], None]

BLIND = "irt.prove.blind"
CONTEST = "irt.prove.contest"
#: What a step of each kind takes for one rig, relative to the others, for the progress bar alone.
_WEIGHTS = {"hidden": 1, "diagnosed": 40, "contested": 20}


@dataclass(frozen=True)
class Places:
    """Where everything of a proof lies.

    Attributes
    ----------
    out : Path
        The folder of the proof.
    """

    out: Path

    @property
    def vault(self) -> Path:
        """Seed and keys until the answers are written down; only the sealing process reads it."""
        return self.out / "vault"

    @property
    def commitments(self) -> Path:
        """Published before the first diagnosis."""
        return self.out / "commitments.json"

    @property
    def manifest(self) -> Path:
        """Written after the last diagnosis, before a key is given out."""
        return self.out / "manifest.json"

    @property
    def keys(self) -> Path:
        """Given out for the manifest."""
        return self.out / "keys.json"

    def rig(self, name: str) -> Path:
        """Return the folder of a rig's recordings."""
        return self.out / "rigs" / name

    def start(self, name: str) -> str:
        """Return how a rig's recordings begin: "rest" or "moving"."""
        return load_rig(self.rig(name)).start

    def seal(self, name: str) -> Path:
        """Return the file of a rig's seal."""
        return self.out / "seals" / f"{name}.json"

    def answer(self, name: str) -> Path:
        """Return the folder of what the diagnosis wrote."""
        return self.out / "answers" / name

    def opened(self, name: str) -> Path:
        """Return the folder of a label and of the runs held out, once it is open."""
        return self.out / "opened" / name

    def contest(self, name: str) -> Path:
        """Return the folder of what other methods wrote."""
        return self.out / "baselines" / name


class Proof:
    """A proof, step by step.

    Parameters
    ----------
    out : Path
        Its folder, new or begun by the same command.
    plan : Plan
        Which rigs.
    generator : sequence of str
        The command of the concealed world.
    workers : Workers
        Who runs the diagnoses.
    seed : int, optional
        Of what is hidden; by default drawn by the operating system.
    progress : callable, optional
        Called with (done, total, text).
    contest : bool
        Whether other methods get the same rigs.
    hiders : int
        How many rigs are made at a time, each by a sealing process of its own.

    Raises
    ------
    IrtError
        If the folder holds another proof or cannot be written, or something was altered.
    """

    def __init__(
        self,
        out: Path,
        plan: Plan,
        generator: Sequence[str],
        workers: Workers,
        *,
        seed: int | None = None,
        progress: Progress | None = None,
        contest: bool = True,
        hiders: int = 1,
    ) -> None:
        self.places, self.plan, self._workers = Places(make_folder(out)), plan, workers
        self._generator, self._seed, self._contest = generator, seed, contest
        self._hiders = hiders
        self._progress = progress or (lambda *_: None)
        self._done = 0

    def run(self) -> Places:
        """Go all the way, from where it was left."""
        with self._sealer() as sealer:
            self._hide(sealer)
            self._diagnose()
            self._release(sealer)
        open_all(self.places, self.plan.names())
        if self._contest:
            self._compare()
        self._tell(self._total, "done")
        return self.places

    def _sealer(self) -> Pipe:
        vault = self.places.vault.resolve()
        return Pipe(sealing.command(vault, self.plan, self._seed, self._generator), "the sealing process")

    def _hide(self, sealer: Pipe) -> None:
        """Have the rigs made, and publish the commitments to all of them."""
        names = self.plan.names()
        for kind in ("rigs", "seals", "answers", "opened", "baselines"):
            make_folder(self.places.out / kind)
        if self.places.commitments.exists():
            self._step("hidden", "", len(names))
            return
        left = [index for index, name in enumerate(names) if not self.places.seal(name).exists()]
        already = len(names) - len(left)
        self._step("hidden", f"hidden: {already} of {len(names)}", already)
        # The first one has the vault made; the others find it there.
        sealer.ask({"begin": {}})
        with ExitStack() as stack:
            others = min(self._hiders, len(left)) - 1
            idle: Queue[Pipe] = Queue()
            pipes = [sealer, *(stack.enter_context(self._sealer()) for _ in range(others))]
            for pipe in pipes:
                idle.put(pipe)
            pool = stack.enter_context(ThreadPoolExecutor(self._hiders))
            tasks = [pool.submit(self._make, idle, index, names[index]) for index in left]
            try:
                for done, task in enumerate(as_completed(tasks), start=already + 1):
                    task.result()
                    self._step("hidden", f"hidden: {done} of {len(names)}")
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for pipe in pipes:
                    pipe.stop()
                raise
        write_atomic(self.places.commitments, canonical(commitments(self.places, names)))

    def _make(self, idle: Queue[Pipe], index: int, name: str) -> None:
        """Have one rig made by a sealing process that is idle, and publish its seal."""
        folder = self.places.rig(name)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        pipe = idle.get()
        try:
            made = pipe.ask({"make": {"index": index, "folder": str(folder.resolve())}})
        finally:
            idle.put(pipe)
        write_atomic(self.places.seal(name), canonical(made))

    def _diagnose(self) -> None:
        names = self.plan.names()
        inputs = {
            name: files_of(self.places.rig(name)) for name in names if not self.places.answer(name).exists()
        }
        if inputs and self.places.manifest.exists():
            raise IrtError(f"{next(iter(inputs))}: its answer is gone, and the manifest is written")
        self._work("diagnosed", BLIND, inputs, self.places.answer)

    def _release(self, sealer: Pipe) -> None:
        """Write down what was answered, and only then have the keys given out."""
        names = self.plan.names()
        if not self.places.manifest.exists():
            write_atomic(self.places.manifest, canonical(manifest(self.places, names)))
        check_answers(self.places, names)
        told = sealer.ask({"release": {"manifest": _json(self.places.manifest)}})
        write_atomic(self.places.keys, canonical(told))

    def _compare(self) -> None:
        """Give the same rigs to other methods, with the commands of the runs held out."""
        names = self.plan.names()
        left = [name for name in names if not self.places.contest(name).exists()]
        inputs = {name: self._contest_files(name) for name in left}
        self._work("contested", CONTEST, inputs, self.places.contest)

    def _contest_files(self, name: str) -> Files:
        """Return what another method may see: recordings, the base model, and what to predict."""
        files = files_of(self.places.rig(name))
        files.update({f"models/{key}": data for key, data in files_of(self.places.answer(name)).items()})
        folder, start = self.places.opened(name), self.places.start(name)
        for test in held_out(folder, label_of(folder), start)[0]:
            files[f"tests/{test.name}.csv"] = commands_alone(test, start).encode()
        return files

    def _work(self, step: str, module: str, inputs: dict[str, Files], place: Callable[[str], Path]) -> None:
        already = self.plan.rigs - len(inputs)
        self._step(step, f"{step}: {already} of {self.plan.rigs}", already)
        # Closed at once where this stops: its processes must not outlive it.
        with closing(self._workers.each(module, inputs)) as answers:
            for done, (name, files) in enumerate(answers, start=already + 1):
                _write_folder(place(name), files)
                self._step(step, f"{step}: {done} of {self.plan.rigs}")

    @property
    def _total(self) -> int:
        kinds = _WEIGHTS if self._contest else {**_WEIGHTS, "contested": 0}
        return self.plan.rigs * sum(kinds.values())

    def _step(self, kind: str, text: str, count: int = 1) -> None:
        self._done += count * _WEIGHTS[kind]
        self._tell(self._done, text)

    def _tell(self, done: int, text: str) -> None:
        self._progress(min(done, self._total), self._total, text)


def commitments(places: Places, names: Sequence[str]) -> dict[str, Any]:
    """Return what is published before the first diagnosis: a commitment and the recordings of each rig."""
    seals = {name: _json(places.seal(name)) for name in names}
    return {
        "commitments": {name: seal["commitment"] for name, seal in seals.items()},
        "recordings": {name: digests(places.rig(name)) for name in names},
    }


def manifest(places: Places, names: Sequence[str]) -> dict[str, Any]:
    """Return what is written down before a key is given out: the SHA-256 of everything that was answered."""
    return {
        "commitments": digest(places.commitments.read_bytes()),
        "answers": {name: digests(places.answer(name)) for name in names},
    }


def check_answers(places: Places, names: Sequence[str]) -> None:
    """Raise unless answers and commitments are those of the manifest.

    Raises
    ------
    IrtError
        With one line that names the rig.
    """
    written = _json(places.manifest)
    if digest(places.commitments.read_bytes()) != written["commitments"]:
        raise IrtError(f"{places.commitments}: not what the manifest says: it was altered after publication")
    for name in names:
        if written["answers"].get(name) != digests(make_folder(places.answer(name))):
            raise IrtError(f"{name}: the answer is not the one of the manifest: it was altered afterwards")


def open_all(places: Places, names: Sequence[str]) -> None:
    """Open the seals with the keys given out, and write labels and runs held out.

    Raises
    ------
    IrtError
        If anything of the chain was altered; one line that names the rig.
    """
    for name, content in opened(places, names).items():
        label = content["label"]
        files = {"label.json": canonical(label)}
        files.update({f"{run}.csv": test["csv"].encode() for run, test in label["tests"].items()})
        shutil.rmtree(places.opened(name), ignore_errors=True)
        _write_folder(places.opened(name), files)


def verify(out: Path) -> int:
    """Check a proof from end to end, and return how many rigs it has.

    Raises
    ------
    IrtError
        If it is not finished, or a label, a recording, a commitment or an answer was altered.
    """
    places = Places(out)
    names = list(_json(places.commitments)["commitments"])
    for name, content in opened(places, names).items():
        path = places.opened(name) / "label.json"
        if not path.exists() or path.read_bytes() != canonical(content["label"]):
            raise IrtError(f"{name}: the label that was opened is not the one that was sealed")
    return len(names)


def opened(places: Places, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return what was sealed, once the whole chain has been checked."""
    keys, published = _json(places.keys), _json(places.commitments)
    if digest(canonical(_json(places.manifest))) != keys["manifest"]:
        raise IrtError(f"{places.manifest}: not what the keys were given out for: it was altered afterwards")
    check_answers(places, names)
    found = {}
    for name in names:
        seal = Seal(**_json(places.seal(name)))
        content = open_seal(seal, Key(**keys["keys"][name]), published["commitments"][name])
        if content["rig"] != name:
            raise IrtError(f"{name}: its seal holds the label of {content['rig']}: they were exchanged")
        if content["recordings"] != digests(places.rig(name)):
            raise IrtError(f"{name}: its recordings are not those that were sealed: they were altered")
        found[name] = content
    return found


def commands_alone(test: Recording, start: str) -> str:
    """Return a recording as CSV without what came of it: only rows where a prediction starts stay."""
    marble = test.marble.copy()
    marble[LEAD_ROWS if start == "moving" else 1 :] = np.nan
    return Recording(test.name, test.path, test.knobs, marble, test.stamps).to_csv()


def _write_folder(folder: Path, files: Files) -> None:
    """Write files beside their folder, and move the whole there."""
    beside = folder.with_name(f".irt-{secrets.token_hex(4)}")
    beside.mkdir()
    for name, data in files.items():
        write_atomic(beside / name, data)
    beside.replace(folder)


def _json(path: Path) -> dict[str, Any]:
    text = read_text(path)
    try:
        content: dict[str, Any] = json.loads(text)
    except ValueError as error:
        raise IrtError(f"{path}: broken JSON: {error}") from error
    return content
