"""Diagnose rigs with hidden effects, then open their labels and score.

    .venv/bin/python benches/diagnosis.py ../shared/rigs --out diagnosed

A rig is a folder of recordings ``train-*.csv``, which the diagnosis uses, and ``test-*.csv``, which it does
not. ``labels.json`` beside the rigs is read only after all answers are written. It contains ``kind`` (an
effect, two effects, ``none``, ``outliers`` or ``unlisted_...``), the errors ``base`` and ``oracle`` on the
test runs, the ``truth``, and optionally ``left_over`` physics, which an answer may name or not. Existing
answers are reused.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import irt
from irt.files import write_atomic
from irt.proof.score import intervals, matched, mean_error, naming

NOTHING = ("none", "outliers")
#: Names of parameters in other labels, and the factor to this project's unit.
ALIASES = {
    "rolling_friction": ("c_rr", 1.0),
    "time_scale": ("dt", 240.0),
    "observation_scale": ("scale", 1.0),
}
#: Effects that resemble a left-over map of slopes or a sticky board.
LIKE = {
    "slope_map": {"slope_map", "bump", "board_warp", "point_field"},
    "static_friction": {"static_friction", "stribeck"},
}
#: Names of a diagnosis for unknown physics, which are neither right nor false.
NAMELESS = "unlisted"
#: Largest ratio of the truth's error to the base model's for a rig with a gap.
GAP = 0.9
#: Bands of the change of the path by a single effect [tracker noises].
BANDS = (3.0, 10.0, 30.0, math.inf)
#: Minimum number of inclusion probabilities in a decile for a share of true ones.
ENOUGH = 20


def main() -> None:
    """Diagnose, then score."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("rigs", type=Path)
    parser.add_argument("--out", type=Path, default=Path("diagnosed"))
    parser.add_argument("--only", nargs="*", default=[], help="names of rigs (default: all)")
    parser.add_argument("--jobs", type=int, default=1, help="rigs at a time; each then has one thread")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    names = args.only or sorted(path.name for path in args.rigs.iterdir() if path.is_dir())
    args.out.mkdir(parents=True, exist_ok=True)
    work = partial(answer, args.rigs, args.out, args.seed, None if args.jobs == 1 else 1)
    if args.jobs == 1:
        for name in names:
            print(work(name), flush=True)
    else:
        with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
            for line in pool.imap(work, names):
                print(line, flush=True)
    labels = json.loads((args.rigs / "labels.json").read_text(encoding="utf-8"))
    rows = [score(args.rigs, args.out, name, labels[name]) for name in names]
    (args.out / "scores.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    print("\n".join(summary(rows)))


def answer(rigs: Path, out: Path, seed: int, threads: int | None, name: str) -> str:
    """Diagnose a rig from its training recordings alone; write ``model.toml`` and ``diagnosis.json``."""
    folder = out / name
    if (folder / "diagnosis.json").exists():
        return f"{name}: as before"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as seen:
        for path in (rigs / name).iterdir():
            if path.name == "rig.toml" or path.name.startswith("train-"):
                shutil.copy(path, seen)
        found = diagnosed(irt.load_rig(seen), folder, seed, threads)
    ties = {one["name"]: one["confusable_with"] for one in found["effects"] if one["confusable_with"]}
    names = [one["name"] for one in found["effects"]]
    return f"{name}: {found['verdict']} {names} {ties or ''} {found['cpu_seconds']:.1f} CPU s"


def diagnosed(rig: irt.Rig, folder: Path, seed: int, threads: int | None) -> dict[str, Any]:
    """Diagnose a rig; write ``model.toml`` and, last, ``diagnosis.json``, and return its content."""
    began, spent = time.perf_counter(), cpu_seconds()
    found = irt.diagnose(rig, seed=seed, threads=threads)
    said = {
        **found.as_dict(),
        "bench_seconds": time.perf_counter() - began,
        "cpu_seconds": cpu_seconds() - spent,
    }
    irt.save_model(folder / "model.toml", found.model)
    write_atomic(folder / "diagnosis.json", json.dumps(said, indent=1))
    return said


def cpu_seconds() -> float:
    """Return the CPU time of this process so far, with its threads and ended children."""
    return sum(os.times()[:4])


def score(rigs: Path, out: Path, name: str, label: dict[str, Any]) -> dict[str, Any]:
    """Compare an answer with its label."""
    said = json.loads((out / name / "diagnosis.json").read_text(encoding="utf-8"))
    model = irt.load_model(out / name / "model.toml")
    final = mean_error(model, [irt.load_recording(path) for path in sorted((rigs / name).glob("test-*.csv"))])
    kinds = label["kind"] if isinstance(label["kind"], list) else [label["kind"]]
    hidden = [kind for kind in kinds if kind not in NOTHING]
    found = naming(NAMELESS if kinds[0].startswith(NAMELESS) else "", hidden, said)
    ties = {one["name"]: one["confusable_with"] for one in said["effects"]}
    right, false = compared(hidden, ties, [one["name"] for one in label.get("left_over", [])])
    return {
        "rig": name,
        "kind": kinds,
        "verdict": said["verdict"],
        **found,
        "named": list(ties),
        "right": right,
        "moves": label.get("moves", {}),
        "false": false,
        "final": final,
        "base": label["base"],
        "oracle": label["oracle"],
        "closed": (label["base"] - final) / (label["base"] - label["oracle"]),
        "intervals": {one: held != "no" for one, held in intervals(said, renamed(label["truth"])).items()},
        "inclusion": {
            effect: [probability, effect in kinds]
            for effect, probability in said.get("inclusion", {}).items()
        },
        "seconds": said["bench_seconds"],
        "cpu_seconds": said["cpu_seconds"],
    }


def compared(
    hidden: Sequence[str], named: Mapping[str, Collection[str]], left_over: Sequence[str] = ()
) -> tuple[list[str], list[str]]:
    """Return the named hidden effects, and the false names.

    Parameters
    ----------
    hidden : sequence of str
        The truth.
    named : mapping
        By each name of an answer, the effects tied with it. A name matches at most one hidden effect.
    left_over : sequence of str
        Additional hidden physics; names of similar effects are neither right nor false.
    """
    stands_for = matched(hidden, named)
    right = [effect for effect in hidden if effect in stands_for]
    excused = {NAMELESS}.union(*(LIKE.get(effect, {effect}) for effect in left_over))
    right_names = {*stands_for.values()}
    false = [
        name for name, alike in named.items() if name not in right_names and not excused & {name, *alike}
    ]
    return right, false


def renamed(truth: dict[str, Any]) -> dict[str, Any]:
    """Return a truth with the names and units of this project."""
    known = {name: factor * truth[alias] for name, (alias, factor) in ALIASES.items() if alias in truth}
    return {**known, **truth}


def summary(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Return the scored table."""
    for what, value in figures(rows).items():
        yield f"{what:<46} {value}"
    for row in rows:
        if not is_right(row) or row["closed"] < 0.85:
            yield (
                f"  {row['rig']}: {'+'.join(row['kind'])} -> {row['verdict']} {'+'.join(row['named'])} "
                f"ties {row['ties']} closed {row['closed']:.3f}"
            )


def is_right(row: dict[str, Any]) -> bool:
    """Return whether an answer equals the label, without a tie or a false name."""
    if row["kind"][0] in NOTHING:
        return bool(row["verdict"] == "sufficient")
    if row["kind"][0].startswith(NAMELESS):
        return bool(row["verdict"] == "unlisted")
    return bool(row["exact"])


def figures(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Return the figures of scored rigs by name; those without rigs are left out."""
    nothing = [row for row in rows if row["kind"][0] in NOTHING]
    unlisted = [row for row in rows if row["kind"][0].startswith(NAMELESS)]
    hidden = [row for row in rows if row not in nothing and row not in unlisted]
    single = [row for row in hidden if len(row["kind"]) == 1]
    pairs = [row for row in hidden if len(row["kind"]) == 2]
    several = [row for row in hidden if len(row["kind"]) > 1]
    found = {
        "false alarms": _rate(nothing, lambda row: row["verdict"] != "sufficient"),
        "nulls with a false name": _rate(nothing, lambda row: bool(row["false"])),
        "single effects named, or in a tie": _rate(single, lambda row: row["found"]),
        "single effects named exactly": _rate(single, is_right),
        "mean size of a tie": _mean([row["tie_size"] for row in single if row["tie_size"]]),
        "pairs, both named": _rate(pairs, lambda row: row["found"]),
        "several at once: effects named": _share(
            [effect in row["right"] for row in several for effect in row["kind"]]
        ),
        **by_size(several),
        "several at once: false names a rig": _mean([len(row["false"]) for row in several]),
        "unlisted said so": _rate(unlisted, is_right),
        "false names a rig": _mean([len(row["false"]) for row in rows]),
        "gap closed: median, 10th percentile": _closed(hidden),
        "gap closed, unlisted": _closed(unlisted),
        "95 % intervals that hold the truth": _share(
            [holds for row in rows for holds in row["intervals"].values()]
        ),
        **calibration(rows),
        "CPU seconds a rig: median, largest": _middle([row["cpu_seconds"] for row in rows], np.max),
    }
    return {what: value for what, value in found.items() if value}


def by_size(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Return the shares of named effects, by bands of their own change of the path."""
    moves = [(moved, name in row["right"]) for row in rows for name, moved in row["moves"].items()]
    return {
        f"several at once: named of {low:g} to {high:g} noises": _share(
            [right for moved, right in moves if low <= moved < high]
        )
        for low, high in pairwise(BANDS)
    }


def calibration(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Return the share of true effects for each decile of inclusion probabilities with enough of them."""
    pairs = [pair for row in rows for pair in row["inclusion"].values()]
    found = {}
    for decile in range(10):
        among = [pair for pair in pairs if min(int(10 * pair[0]), 9) == decile]
        if len(among) >= ENOUGH:
            mean = np.mean([probability for probability, _ in among])
            what = f"inclusion {decile / 10:.1f} to {(decile + 1) / 10:.1f}, mean {mean:.3f}: true"
            found[what] = _share([true for _, true in among])
    return found


def _rate(among: list[dict[str, Any]], good: Callable[[dict[str, Any]], bool]) -> str:
    return _share([good(row) for row in among])


def _share(good: list[bool]) -> str:
    return f"{sum(good):>3} of {len(good):>3}  {100.0 * sum(good) / len(good):.0f} %" if good else ""


def _mean(values: list[float]) -> str:
    return f"{np.mean(values):.2f}" if values else ""


def _middle(values: list[float], other: Callable[[list[float]], float]) -> str:
    return f"{np.median(values):.3g}, {other(values):.3g}" if values else ""


def _closed(rows: list[dict[str, Any]]) -> str:
    # Delays that differ by chance differ in the test runs too: no answer closes that gap. Nor is there one
    # where a random push hides what the truth would win.
    closed = [
        row["closed"]
        for row in rows
        if "delay_jitter" not in row["kind"] and row["oracle"] < GAP * row["base"]
    ]
    return _middle(closed, lambda values: float(np.quantile(values, 0.1)))


if __name__ == "__main__":
    main()
