"""Is a run that `irt suggest` designs worth more than a random one?

    .venv/bin/python benches/suggested_run.py out --rigs 200

Each rig hides one effect or two in three short recordings of another engine (those of `hide_effects`). Where
the diagnosis is a tie or a miss, the rig is recorded once more, and diagnosed again: once with the run that
`irt suggest` designs from the plausible models, once with a random run from the same families and within the
same limits. A late command and a late picture count as one effect, because no marble distinguishes them.
Results are kept in the folder, and a run that was stopped goes on. Needs the extra prove.
"""

from __future__ import annotations

import argparse
import importlib
import json
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

import irt
from hide_effects import Setting
from irt.diagnosis.hypotheses import ALIKE
from irt.diagnosis.result import Diagnosis
from irt.files import read_json, write_atomic
from irt.proof import wording
from irt.proof.metrics import Rate
from irt.proof.propose import RANDOM, SUGGESTED, random_run
from irt.recording import Recording
from irt.rig import Rig
from irt.suggestion import suggest
from machine import machine
from write_table import fill

Array = NDArray[np.float64]

#: Recordings of a rig, and their rows: so few that ties and misses are frequent.
RUNS, ROWS = 3, 60
ENGINES = ("mujoco", "rapier")


def main() -> None:
    """Diagnose, record one more run, diagnose again, and count."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--page", type=Path, help="page whose block bench:suggested gets the table")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(args.jobs, multiprocessing.get_context("spawn")) as pool:
        tried = pool.map(partial(kept, args.out, args.seed), range(args.rigs))
        for number, one in enumerate(tried):
            before = one.get("refused") or _words(one["before"])
            after = "".join(f"; {kind}: {_words(again)}" for kind, again in one.get("after", {}).items())
            print(f"{number:4d} {' + '.join(one['hidden'])}: {before}{after}", flush=True)
    text = "\n".join(table(args.out))
    print(text)
    if args.page:
        page = fill(args.page.read_text(encoding="utf-8"), {"suggested": f"{text} Measured on {machine()}."})
        write_atomic(args.page, page)


def kept(out: Path, seed: int, index: int) -> dict[str, Any]:
    """Return the result for a rig, from its file if there is one."""
    path = out / f"{seed}-{index}.json"
    if not path.exists():
        write_atomic(path, json.dumps(of_rig(seed, index), indent=1))
    found: dict[str, Any] = read_json(path)
    return found


def of_rig(seed: int, index: int) -> dict[str, Any]:
    """Make a rig, and diagnose it before and after one more run if it needs one."""
    random = np.random.default_rng([seed, index])
    world = importlib.import_module(f"{ENGINES[index % len(ENGINES)]}_world")
    effects: list[dict[str, Any]] = []
    while not effects:
        setting = Setting.drawn(world, random)
        effects, _ = setting.effects(1 + index // len(ENGINES) % 2, random)
    hidden = sorted(one["name"] for one in effects)
    knobs = setting.knobs[:RUNS, :ROWS]
    rig = Rig.from_recordings(_recorded(setting, effects, knobs, None, random))
    try:
        before = irt.diagnose(rig, threads=1)
    except irt.IrtError as error:
        # A dead band may be larger than all commands.
        return {"hidden": hidden, "refused": str(error)}
    found: dict[str, Any] = {"hidden": hidden, "before": answer(before, hidden)}
    if not found["before"]["exact"]:
        found["after"] = {}
        noise = random.integers(2**32)
        for kind in (SUGGESTED, RANDOM):
            commands, start = _next(kind, rig, before, random)
            more = _recorded(setting, effects, commands[None], start[None], np.random.default_rng(noise))
            again = Rig.from_recordings([*rig.recordings, *more])
            found["after"][kind] = answer(irt.diagnose(again, threads=1), hidden)
    return found


def answer(found: Diagnosis, hidden: Sequence[str]) -> dict[str, Any]:
    """Return what a diagnosis names, with what ties, and whether that is what is hidden and nothing else."""
    named = [sorted({_one_name(name) for name in (one.name, *one.confusable_with)}) for one in found.effects]
    true = sorted([_one_name(name)] for name in hidden)
    return {"named": named, "exact": sorted(named) == true}


def _one_name(name: str) -> str:
    return min(ALIKE) if name in ALIKE else name


def _next(kind: str, rig: Rig, found: Diagnosis, random: np.random.Generator) -> tuple[Array, Array]:
    """Return the commands of one more run, and the place of the marble in its row 0."""
    if kind == SUGGESTED:
        models, chances = zip(*((one.model, one.probability) for one in found.plausible), strict=True)
        run = suggest(rig, models, found.noise, probabilities=chances, threads=1)
        return run.commands, run.start
    drawn = random_run(rig, random)
    return drawn.commands, drawn.start


def _recorded(
    setting: Setting,
    effects: Sequence[dict[str, Any]],
    knobs: Array,
    start: Array | None,
    random: np.random.Generator,
) -> list[Recording]:
    """Simulate recordings of the concealed rig under commands, as its tracker sees them."""
    paths = setting.simulate(effects, knobs, start)
    seen = paths + setting.noise * random.standard_normal(paths.shape)
    return [Recording("run", Path("run.csv"), *one) for one in zip(knobs, seen, strict=True)]


def table(out: Path) -> list[str]:
    """Return the table of all results of a folder, in lines."""
    every = [read_json(path) for path in sorted(out.glob("*.json"))]
    again = [one for one in every if "after" in one]
    wins = {
        kind: sum(one["after"][kind]["exact"] and not one["after"][other]["exact"] for one in again)
        for kind, other in ((SUGGESTED, RANDOM), (RANDOM, SUGGESTED))
    }
    lines = [
        f"{len(every)} rigs, {len(again)} of them tied or missed with {RUNS} runs of {ROWS} rows:",
        "",
        *wording.header(["one more run", "exactly what is hidden, without a tie", "where the other is not"]),
    ]
    for kind, alone in wins.items():
        rate = Rate(sum(one["after"][kind]["exact"] for one in again), len(again))
        lines.append(wording.row([kind, wording.rate_of(rate), str(alone)]))
    if sum(wins.values()):
        chance = binomtest(wins[SUGGESTED], sum(wins.values()), alternative="greater").pvalue
        lines += ["", f"Probability of so many more by chance (sign test): {chance:.2g}."]
    return lines


def _words(one: dict[str, Any]) -> str:
    names = [" or ".join(each) for each in one["named"]]
    return f"{' + '.join(names) or 'nothing'}{' (exact)' if one['exact'] else ''}"


if __name__ == "__main__":
    main()
