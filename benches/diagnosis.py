"""Diagnose rigs with hidden effects, then open their labels and score.

    .venv/bin/python benches/diagnosis.py ../shared/rigs --out diagnosed

A rig is a folder of recordings ``train-*.csv``, which a diagnosis sees, and ``test-*.csv``, which it does
not. ``labels.json`` beside them is read only after all answers are written: ``kind`` (an effect, two,
``none``, ``outliers`` or ``unlisted_...``), the errors ``base`` and ``oracle`` on the test runs, and the
``truth``.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import shutil
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import irt
from irt.residual import free_run_error

NOTHING = ("none", "outliers")
#: What other labels call our parameters, and the factor to our unit.
ALIASES = {
    "rolling_friction": ("c_rr", 1.0),
    "time_scale": ("dt", 240.0),
    "observation_scale": ("scale", 1.0),
}


def main() -> None:
    """Answer, then score."""
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
    """Diagnose a rig from its training recordings alone; write ``diagnosis.json`` and ``model.toml``."""
    folder = out / name
    folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as seen:
        for path in (rigs / name).iterdir():
            if path.name == "rig.toml" or path.name.startswith("train-"):
                shutil.copy(path, seen)
        began = time.perf_counter()
        found = irt.diagnose(irt.load_rig(seen), seed=seed, threads=threads)
        seconds = time.perf_counter() - began
    irt.save_model(folder / "model.toml", found.model)
    told = {**found.as_dict(), "seconds": seconds, "bench_seconds": seconds}
    (folder / "diagnosis.json").write_text(json.dumps(told, indent=1), encoding="utf-8")
    ties = {one.name: list(one.confusable_with) for one in found.effects if one.confusable_with}
    return f"{name}: {found.verdict} {[one.name for one in found.effects]} {ties or ''} {seconds:.1f} s"


def score(rigs: Path, out: Path, name: str, label: dict[str, Any]) -> dict[str, Any]:
    """Compare an answer with its label."""
    told = json.loads((out / name / "diagnosis.json").read_text(encoding="utf-8"))
    model = irt.load_model(out / name / "model.toml")
    tests = [irt.load_recording(path) for path in sorted((rigs / name).glob("test-*.csv"))]
    final = float(np.mean([free_run_error(model, test) for test in tests]))
    kinds = label["kind"] if isinstance(label["kind"], list) else [label["kind"]]
    named = {one["name"]: {one["name"], *one["confusable_with"]} for one in told["effects"]}
    ties = [len(alike) for alike in named.values()]
    return {
        "rig": name,
        "kind": kinds,
        "verdict": told["verdict"],
        "named": list(named),
        "ties": {key: sorted(alike - {key}) for key, alike in named.items()},
        "exact": set(kinds) == set(named),
        "found": len(named) == len(kinds) and all(any(k in alike for alike in named.values()) for k in kinds),
        "contains": all(any(k in alike for alike in named.values()) for k in kinds),
        "tie_size": float(np.mean(ties)) if ties else None,
        "final": final,
        "base": label["base"],
        "oracle": label["oracle"],
        "closed": (label["base"] - final) / (label["base"] - label["oracle"]),
        "intervals": intervals(told, label["truth"]),
        "seconds": told["bench_seconds"],
    }


def intervals(told: dict[str, Any], truth: dict[str, Any]) -> dict[str, bool]:
    """Return for each parameter, of the base and of effects rightly named, whether its interval holds."""
    held = {}
    for name, one in told["parameters"].items():
        alias, factor = ALIASES.get(name, (name, 1.0))
        held[name] = _holds(one, truth[name] if name in truth else factor * truth[alias])
    hidden = {one["name"]: one for one in truth.get("effects", [])}
    for effect in told["effects"]:
        for name, one in effect["parameters"].items():
            if name in hidden.get(effect["name"], {}):
                held[f"{effect['name']}.{name}"] = _holds(one, hidden[effect["name"]][name])
    return held


def _holds(one: dict[str, Any], value: float) -> bool:
    low, high = (math.nan if end is None else end for end in (one["low"], one["high"]))
    return not (value < low or value > high)


def summary(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Return the scored table."""
    nothing = [row for row in rows if row["kind"][0] in NOTHING]
    unlisted = [row for row in rows if row["kind"][0].startswith("unlisted")]
    single = [row for row in rows if len(row["kind"]) == 1 and row not in nothing and row not in unlisted]
    pairs = [row for row in rows if len(row["kind"]) == 2]

    def rate(what: str, among: list[Any], good: list[Any]) -> str:
        return f"{what:<46} {len(good):>3} of {len(among):>3}" + (
            f"  {100.0 * len(good) / len(among):.0f} %" if among else ""
        )

    yield rate("false alarms", nothing, [row for row in nothing if row["verdict"] != "sufficient"])
    yield rate("single effects named, or in a tie", single, [row for row in single if row["found"]])
    yield rate("single effects named exactly", single, [row for row in single if row["exact"]])
    sizes = [row["tie_size"] for row in single if row["tie_size"]]
    yield f"{'mean size of a tie':<46} {np.mean(sizes) if sizes else float('nan'):.2f}"
    yield rate("pairs, both named", pairs, [row for row in pairs if row["found"]])
    yield rate("unlisted told so", unlisted, [row for row in unlisted if row["verdict"] == "unlisted"])
    for what, among in (("gap closed", single + pairs), ("gap closed, unlisted", unlisted)):
        # Delays that differ by chance differ in the test runs too: no answer closes that gap.
        closed = [row["closed"] for row in among if "delay_jitter" not in row["kind"]]
        if closed:
            middle, low = np.median(closed), np.quantile(closed, 0.1)
            yield f"{what + ': median, 10th percentile':<46} {middle:.3f}, {low:.3f}"
    held = [holds for row in rows for holds in row["intervals"].values()]
    yield rate("95 % intervals that hold the truth", held, [holds for holds in held if holds])
    seconds = [row["seconds"] for row in rows]
    yield f"{'seconds a rig: median, largest':<46} {np.median(seconds):.1f}, {np.max(seconds):.1f}"
    for row in rows:
        right = row["verdict"] == "sufficient" if row in nothing else row["exact"]
        if row in unlisted:
            right = row["verdict"] == "unlisted"
        if not right or row["closed"] < 0.85:
            yield (
                f"  {row['rig']}: {'+'.join(row['kind'])} -> {row['verdict']} {'+'.join(row['named'])} "
                f"ties {row['ties']} closed {row['closed']:.3f}"
            )


if __name__ == "__main__":
    main()
