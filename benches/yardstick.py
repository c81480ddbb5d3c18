"""Measure the diagnosis on all sets: make new rigs, diagnose them, score; one table.

    OMP_NUM_THREADS=1 .venv/bin/python benches/yardstick.py measured --seed 7 --jobs 2
    .venv/bin/python benches/yardstick.py quick --share 0.1 --only nulls-mujoco several-rapier

Rigs and answers stay in the folder, and the same command resumes an interrupted run. Missing practice and
real rigs of `../shared` are left out. ``--beside`` adds a column with the figures of another folder.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import irt
from diagnosis import answer, diagnosed, figures, score
from hide_effects import Recipe, hide, read_labels, recipes, write_labels
from irt.files import write_atomic

SHARED = Path(__file__).resolve().parents[2] / "shared"
PUSHES = (0.05, 0.1, 0.2)


@dataclass(frozen=True)
class Rigs:
    """A set of generated rigs: number, common settings, and numbers of effects and pushes in turn."""

    count: int
    common: Recipe
    effects: tuple[int, ...]
    push: tuple[float, ...] = (0.0,)

    def recipes(self, share: float) -> list[Recipe]:
        """Return what to hide in each rig of a share of the set, at least one."""
        return recipes(max(1, round(share * self.count)), 0.0, self.common, self.effects, self.push)


RAPIER, MUJOCO = Recipe("rapier"), Recipe("mujoco")
SETS = {
    "rapier": Rigs(100, RAPIER, (1, 1, 2)),
    "mujoco": Rigs(60, MUJOCO, (1, 1, 1, 1, 2, 3)),
    "nulls-rapier": Rigs(100, RAPIER, (0,)),
    "nulls-mujoco": Rigs(100, MUJOCO, (0,)),
    "several-rapier": Rigs(20, RAPIER, (3, 4, 5)),
    "several-mujoco": Rigs(20, MUJOCO, (3, 4, 5)),
    "left-over-rapier": Rigs(20, replace(RAPIER, left_over=True), (2, 3, 4, 5), PUSHES),
    "left-over-mujoco": Rigs(20, replace(MUJOCO, left_over=True), (2, 3, 4, 5), PUSHES),
    "controlled-mujoco": Rigs(24, replace(MUJOCO, controlled=True), (0, 1, 2)),
}
PRACTICE = "practice"


@dataclass(frozen=True)
class Real:
    """A real rig: training runs, held-out runs, and length of the windows [s]."""

    train: tuple[str, ...]
    test: tuple[str, ...]
    window_s: float


REAL = {
    "labyrinth": Real(("run-1", "run-2", "run-3", "run-4"), ("run-5",), 1.0),
    "ball-table": Real(("run-1", "run-2", "run-3", "run-4"), ("run-5", "run-6"), 2.0),
}

#: Calls a function with each of many arguments, and yields the results.
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]


def main() -> None:
    """Make, diagnose, score, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", nargs="*", choices=[*SETS, PRACTICE, *REAL], help="sets (default: all)")
    parser.add_argument("--share", type=float, default=1.0, help="part of each set")
    parser.add_argument("--seed", type=int, default=1, help="of the rigs that are made")
    parser.add_argument("--jobs", type=int, default=1, help="rigs at a time; each then has one thread")
    parser.add_argument("--beside", type=Path, help="another folder whose figures stand beside these")
    args = parser.parse_args()
    threads = None if args.jobs == 1 else 1
    before = _figures(args.beside) if args.beside else {}
    found = _figures(args.out)
    with multiprocessing.get_context("spawn").Pool(args.jobs) if args.jobs > 1 else _Alone() as pool:
        for name in args.only or [*SETS, PRACTICE, *REAL]:
            if name in REAL:
                found |= real(args.out / name, name, threads)
            elif name == PRACTICE:
                found |= practice(args.out / name, args.share, threads, pool.imap_unordered)
            else:
                wanted = SETS[name].recipes(args.share)
                folder = args.out / f"{name}-{args.seed}"
                made(folder / "rigs", wanted, args.seed, pool.imap_unordered)
                names = [_name(args.seed, index) for index in range(len(wanted))]
                found[name] = scored(folder / "rigs", folder, names, threads, pool.imap_unordered)
            write_atomic(args.out / "figures.json", json.dumps(found, indent=1))
            print("\n".join(table({name: found[name]} if name in found else {})), flush=True)
    lines = "\n".join(table(found, before))
    write_atomic(args.out / "table.md", lines + "\n")
    print(f"\n{lines}")


def _figures(out: Path) -> dict[str, dict[str, str]]:
    """Return earlier figures of a folder, by set and figure."""
    path = out / "figures.json"
    found: dict[str, dict[str, str]] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return found


class _Alone:
    """The `map` of a pool of processes, in this process."""

    def __enter__(self) -> _Alone:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    imap_unordered = staticmethod(map)


def _name(seed: int, index: int) -> str:
    return f"own-{seed}-{index:03d}"


def made(rigs: Path, wanted: Sequence[Recipe], seed: int, each: Each) -> None:
    """Make missing rigs, and write their labels."""
    labels = read_labels(rigs)
    missing = [(index, recipe) for index, recipe in enumerate(wanted) if _name(seed, index) not in labels]
    for name, label in each(partial(_hidden, rigs, seed), missing):
        labels[name] = label
        write_labels(rigs, labels)
        print(name, label["kind"], flush=True)


def _hidden(rigs: Path, seed: int, wanted: tuple[int, Recipe]) -> tuple[str, dict[str, Any]]:
    index, recipe = wanted
    name = _name(seed, index)
    return name, hide(rigs / name, recipe, np.random.default_rng([seed, index]))


def scored(rigs: Path, out: Path, names: Sequence[str], threads: int | None, each: Each) -> dict[str, str]:
    """Diagnose rigs, then open their labels; return their figures, and write the scores."""
    answers = out / "answers"
    for line in each(partial(answer, rigs, answers, 0, threads), names):
        print(line, flush=True)
    labels = read_labels(rigs)
    rows = [score(rigs, answers, name, labels[name]) for name in names]
    write_atomic(out / "scores.json", json.dumps([row.as_dict() for row in rows], indent=1))
    return figures(rows)


def practice(out: Path, share: float, threads: int | None, each: Each) -> dict[str, dict[str, str]]:
    """Return the figures of the practice rigs."""
    rigs = SHARED / "rigs"
    if not rigs.is_dir():
        print(f"{PRACTICE}: left out, as there is no {rigs}", flush=True)
        return {}
    names = sorted(read_labels(rigs))
    names = names[: max(1, round(share * len(names)))]
    return {PRACTICE: scored(rigs, out, names, threads, each)}


def real(out: Path, name: str, threads: int | None) -> dict[str, dict[str, str]]:
    """Diagnose a real rig from its training runs without measured tilt; return its figures."""
    folder, plan = SHARED / "real" / name, REAL[name]
    if not folder.is_dir():
        print(f"{name}: left out, as there is no {folder}", flush=True)
        return {}
    rig = irt.load_rig(folder)
    runs = {one.name: one for one in rig.recordings}
    rig = replace(rig, recordings=tuple(replace(runs[one], tilt=None) for one in plan.train))
    if not (out / "diagnosis.json").exists():
        out.mkdir(parents=True, exist_ok=True)
        diagnosed(rig, out, 0, threads)
    said = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    model = irt.load_model(out / "model.toml")
    base = irt.tune(rig, threads=threads).model
    # Where a tilt was measured it would be played in place of the commands, and what makes it go unjudged.
    tests = [replace(runs[one], tilt=None) for one in plan.test]
    names = [
        "/".join([one["name"], *one["confusable_with"]])
        + (f" ({said['inclusion'].get(one['name'], 0.0):.2f})" if "inclusion" in said else "")
        for one in said["effects"]
    ]
    errors = [irt.evaluate(one, tests, plan.window_s).windowed for one in (base, model)]
    found = {
        "verdict": said["verdict"],
        "names": ", ".join(names) or "none",
        f"held out, {plan.window_s:g} s windows: base, final": ", ".join(
            f"{one.mae:.4f}" for one in errors if one is not None
        ),
        "CPU seconds": f"{said['cpu_seconds']:.3g}",
    }
    measured = [one for one in runs.values() if one.tilt is not None]
    if measured:
        found["tilt about x, y, after gain and zero [mrad]"] = ", ".join(
            f"{1e3 * one:.2f}" for one in tilt_errors(model, measured)
        )
    return {name: found}


def tilt_errors(model: irt.Model, recordings: Sequence[irt.Recording]) -> list[float]:
    """Return how far a model's tilt is from the measured one about x and y, after gain and zero [rad]."""
    predicted = np.concatenate([one.tilt_prediction for one in irt.evaluate(model, recordings).runs])
    measured = np.concatenate([one.tilt for one in recordings])
    errors = []
    for ours, theirs in zip(predicted.T, measured.T, strict=True):
        seen = np.isfinite(theirs)
        line = np.polynomial.Polynomial.fit(ours[seen], theirs[seen], 1)
        errors.append(float(np.abs(line(ours[seen]) - theirs[seen]).mean()))
    return errors


def table(found: dict[str, dict[str, str]], before: dict[str, dict[str, str]] | None = None) -> Iterator[str]:
    """Return a Markdown table of figures by set, beside earlier ones if there are any."""
    columns = ["set", "figure", *(["before"] if before else []), "now"]
    yield f"| {' | '.join(columns)} |"
    yield f"| --- | --- |{' ---: |' * (len(columns) - 2)}"
    for name, of_set in found.items():
        for what, value in of_set.items():
            earlier = [before.get(name, {}).get(what, "")] if before else []
            yield f"| {' | '.join([name, what, *earlier, value])} |"


if __name__ == "__main__":
    main()
