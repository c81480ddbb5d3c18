"""A proof from start to end: conceal, publish commitments, diagnose blind, write the manifest, open, check.

All files are in one folder. Finished steps are not repeated: after Ctrl-C or a crash the same command
continues.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, closing
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np

from irt.errors import IrtError
from irt.files import atomic_folder, make_folder, remove_unfinished, write_atomic
from irt.proof import further
from irt.proof.hash_chain import Places, Secret, begin, commit, release, write_folder
from irt.proof.plan import Plan, seed_of
from irt.proof.score import held_out, label_of
from irt.proof.seal import canonical
from irt.proof.world import World
from irt.recording import Recording
from irt.segments import LEAD_ROWS
from irt.workers import Files, Workers
from irt.workers.processes import files_of

Progress = Callable[[int, int, str], None]

BLIND = "irt.proof.blind"
CONTEST = "irt.proof.contest"
#: Relative durations of the steps for one rig, for the progress bar.
_WEIGHTS = {"hidden": 1, "diagnosed": 40, "contested": 20}


class Proof:
    """A proof, step by step.

    Parameters
    ----------
    out : Path
        Its folder, new or started by the same command.
    plan : Plan
        Its rigs.
    world : sequence of str
        The command of the concealed world.
    workers : Workers
        Workers that run the diagnoses.
    provenance : mapping
        ``world``, ``code`` and ``commit``, which are published with the plan.
    seed : int, optional
        Seed of the hidden physics; by default from the operating system.
    progress : callable, optional
        Called with (done, total, text).
    contest : bool
        Whether other methods run on the same rigs.
    hiders : int
        Number of rigs made at a time, each by its own world.

    Raises
    ------
    IrtError
        If the folder holds another proof or cannot be written, or a file was altered.
    """

    def __init__(
        self,
        out: Path,
        plan: Plan,
        world: Sequence[str],
        workers: Workers,
        provenance: Mapping[str, str],
        *,
        seed: int | None = None,
        progress: Progress | None = None,
        contest: bool = True,
        hiders: int = 1,
    ) -> None:
        self.places, self.plan, self._workers = Places(make_folder(out)), plan, workers
        self._world, self._provenance, self._seed, self._contest = world, provenance, seed, contest
        self._hiders = hiders
        self._progress = progress or (lambda *_: None)
        self._done = 0

    def run(self) -> Places:
        """Run all remaining steps."""
        names = self.plan.names()
        secret = begin(self.places, self.plan, self._seed, self._provenance)
        self._hide(secret)
        self._diagnose()
        release(self.places, names, secret)
        if self._contest:
            self._resolve(secret)
            self._compare()
        self._report(self._total, "done")
        return self.places

    def _asked(self, index: int, secret: Secret) -> dict[str, Any]:
        """Return what the world needs to know to make a rig."""
        kind = self.plan.order(secret.seed)[index]
        return {"index": index, "kind": kind, "seed": seed_of(secret.seed, index)}

    def _hide(self, secret: Secret) -> None:
        """Make the rigs, and publish the commitments to all of them."""
        names = self.plan.names()
        for kind in ("rigs", "answers", "baselines", "further"):
            remove_unfinished(make_folder(self.places.out / kind))
        left = [index for index, name in enumerate(names) if not self.places.label(name).exists()]
        if self.places.commitments.exists():
            left = []
        already = len(names) - len(left)
        self._step("hidden", f"hidden: {already} of {len(names)}", already)
        with ExitStack() as stack:
            idle: Queue[World] = Queue()
            worlds = [stack.enter_context(World(self._world)) for _ in range(min(self._hiders, len(left)))]
            for world in worlds:
                idle.put(world)
            pool = stack.enter_context(ThreadPoolExecutor(self._hiders))
            tasks = [pool.submit(self._make, idle, index, secret) for index in left]
            try:
                for done, task in enumerate(as_completed(tasks), start=already + 1):
                    task.result()
                    self._step("hidden", f"hidden: {done} of {len(names)}")
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for world in worlds:
                    world.stop()
                raise
        if not self.places.commitments.exists():
            commit(self.places, names, secret)

    def _make(self, idle: Queue[World], index: int, secret: Secret) -> None:
        """Make one rig in an idle world, and keep its label in the vault."""
        name = self.plan.names()[index]
        world = idle.get()
        try:
            with atomic_folder(self.places.rig(name)) as folder:
                asked = {**self._asked(index, secret), "folder": str(folder.resolve())}
                label = world.ask({"make": asked})["label"]
        finally:
            idle.put(world)
        write_atomic(self.places.label(name), canonical(label))

    def _diagnose(self) -> None:
        names = self.plan.names()
        inputs = {
            name: files_of(self.places.rig(name)) for name in names if not self.places.answer(name).exists()
        }
        if inputs and self.places.manifest.exists():
            raise IrtError(f"{next(iter(inputs))}: its answer is gone, and the manifest is written")
        self._work("diagnosed", BLIND, inputs, self.places.answer)

    def _compare(self) -> None:
        """Run the other methods on the same rigs, with the commands of the held-out runs."""
        names = self.plan.names()
        left = [name for name in names if not self.places.contest(name).exists()]
        inputs = {name: self._contest_files(name) for name in left}
        self._work("contested", CONTEST, inputs, self.places.contest)

    def _resolve(self, secret: Secret) -> None:
        """Record one more run for each tie and repeat the diagnosis, if the world supports it."""
        names = self.plan.names()
        tied = {
            name: self.places.rig(name)
            for name in names
            if further.in_a_tie(self.places.answer(name)) and not self.places.further(name).exists()
        }
        if not tied:
            return
        runs = {}
        answers = {name: self.places.answer(name) for name in tied}
        with World(self._world) as world:
            for name, commands in further.propose(self._workers, tied, answers).items():
                seen = further.recorded(world, self._asked(names.index(name), secret), commands)
                if seen is None:
                    return
                runs[name] = seen
        collected: dict[str, dict[str, Files]] = {}
        for name, kind, files in further.diagnosed(self._workers, tied, runs):
            collected.setdefault(name, {})[kind] = files
            self._report(self._done, f"one more run: {name}")
            if len(collected[name]) == len(further.KINDS):
                both = {
                    f"{each}/{file}": data
                    for each, files in collected[name].items()
                    for file, data in files.items()
                }
                write_folder(self.places.further(name), both)

    def _contest_files(self, name: str) -> Files:
        """Return the input of another method: recordings, base model, and runs to predict."""
        files = files_of(self.places.rig(name))
        files.update({f"models/{key}": data for key, data in files_of(self.places.answer(name)).items()})
        folder, start = self.places.opened(name), self.places.start(name)
        for test in held_out(folder, label_of(folder), start)[0]:
            files[f"tests/{test.name}.csv"] = commands_alone(test, start).encode()
        return files

    def _work(self, step: str, module: str, inputs: dict[str, Files], place: Callable[[str], Path]) -> None:
        already = self.plan.rigs - len(inputs)
        self._step(step, f"{step}: {already} of {self.plan.rigs}", already)
        # Closed at once on an interruption, so that no process outlives this one.
        with closing(self._workers.each(module, inputs)) as answers:
            for done, (name, files) in enumerate(answers, start=already + 1):
                write_folder(place(name), files)
                self._step(step, f"{step}: {done} of {self.plan.rigs}")

    @property
    def _total(self) -> int:
        kinds = _WEIGHTS if self._contest else {**_WEIGHTS, "contested": 0}
        return self.plan.rigs * sum(kinds.values())

    def _step(self, kind: str, text: str, count: int = 1) -> None:
        self._done += count * _WEIGHTS[kind]
        self._report(self._done, text)

    def _report(self, done: int, text: str) -> None:
        self._progress(min(done, self._total), self._total, text)


def commands_alone(test: Recording, start: str) -> str:
    """Return a recording as CSV with positions only in the rows where a prediction starts."""
    marble = test.marble.copy()
    marble[LEAD_ROWS if start == "moving" else 1 :] = np.nan
    return Recording(test.name, test.path, test.knobs, marble, test.stamps).to_csv()
