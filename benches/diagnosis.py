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
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import irt
from irt.diagnosis.result import UNLISTED
from irt.files import write_atomic
from irt.proof.failures import OPEN
from irt.proof.metrics import Rate, calibration, coverage, gaps, in_group, nulls, of_catalogue
from irt.proof.plan import NULLS, group_of
from irt.proof.score import Errors, RigScore, judged, matched, mean_error

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
    write_atomic(args.out / "scores.json", json.dumps([row.as_dict() for row in rows], indent=1))
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


@dataclass(frozen=True)
class Row:
    """The score of a rig, and what only labels of these rigs say.

    Attributes
    ----------
    score : RigScore
        As of a rig of `irt prove`; the seconds are those of all cores.
    right, false : tuple of str
        Hidden effects that were named, and false names.
    moves : dict
        Change of the path by each hidden effect [tracker noises].
    """

    score: RigScore
    right: tuple[str, ...] = ()
    false: tuple[str, ...] = ()
    moves: dict[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON content."""
        return {**self.score.as_dict(), "right": self.right, "false": self.false, "moves": self.moves}


def score(rigs: Path, out: Path, name: str, label: dict[str, Any]) -> Row:
    """Compare an answer with its label."""
    said = json.loads((out / name / "diagnosis.json").read_text(encoding="utf-8"))
    model = irt.load_model(out / name / "model.toml")
    final = mean_error(model, [irt.load_recording(path) for path in sorted((rigs / name).glob("test-*.csv"))])
    group, hidden = group_of(label)
    ties = {one["name"]: one["confusable_with"] for one in said["effects"]}
    right, false = compared(hidden, ties, [one["name"] for one in label.get("left_over", [])])
    errors = Errors(label["base"], final, label["oracle"], math.nan)
    plain = RigScore(name, group, hidden, said["verdict"], errors=errors, seconds=said["cpu_seconds"])
    return Row(
        judged(plain, said, renamed(label["truth"])), tuple(right), tuple(false), label.get("moves", {})
    )


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
    excused = {UNLISTED}.union(*(LIKE.get(effect, {effect}) for effect in left_over))
    right_names = {*stands_for.values()}
    false = [
        name for name, alike in named.items() if name not in right_names and not excused & {name, *alike}
    ]
    return right, false


def renamed(truth: dict[str, Any]) -> dict[str, Any]:
    """Return a truth with the names and units of this project."""
    known = {name: factor * truth[alias] for name, (alias, factor) in ALIASES.items() if alias in truth}
    return {**known, **truth}


def summary(rows: Sequence[Row]) -> Iterator[str]:
    """Return the scored table."""
    for what, value in figures(rows).items():
        yield f"{what:<46} {value}"
    for one in (row.score for row in rows):
        closed = one.closed
        if not one.exact or (closed is not None and closed < OPEN):
            yield (
                f"  {one.rig}: {'+'.join(one.kinds) or one.group} -> {one.verdict} {'+'.join(one.named)} "
                f"ties {one.ties} closed {'-' if closed is None else f'{closed:.3f}'}"
            )


def figures(rows: Sequence[Row]) -> dict[str, str]:
    """Return the figures of scored rigs by name; those without rigs are left out."""
    scores = [row.score for row in rows]
    single, pairs, unlisted = (in_group(scores, group) for group in ("single", "pair", UNLISTED))
    several = [row for row in rows if row.score.group != UNLISTED and len(row.score.kinds) > 1]
    found = {
        "false alarms": _rate(nulls(scores), lambda one: one.false_alarm),
        "nulls with a false name": _share([bool(row.false) for row in rows if row.score.group in NULLS]),
        "single effects named, or in a tie": _rate(single, lambda one: one.found),
        "single effects named exactly": _rate(single, lambda one: one.exact),
        "mean size of a tie": _mean([one.tie_size for one in single if one.tie_size]),
        "pairs, both named": _rate(pairs, lambda one: one.found),
        "several at once: effects named": _share(
            [effect in row.right for row in several for effect in row.score.kinds]
        ),
        **by_size(several),
        "several at once: false names a rig": _mean([len(row.false) for row in several]),
        "unlisted said so": _rate(unlisted, lambda one: one.exact),
        "false names a rig": _mean([len(row.false) for row in rows]),
        "gap closed: median, 10th percentile": _middle(gaps(of_catalogue(scores)), _low),
        "gap closed, unlisted": _middle(gaps(unlisted), _low),
        "95 % intervals that hold the truth": _counted(coverage(scores)[0]),
        **{
            f"inclusion, mean {one.mean:.3f}: true": _counted(one.rate)
            for one in calibration(scores)
            if one.rate.of >= ENOUGH
        },
        "CPU seconds a rig: median, largest": _middle([one.seconds for one in scores], np.max),
    }
    return {what: value for what, value in found.items() if value}


def by_size(rows: Sequence[Row]) -> dict[str, str]:
    """Return the shares of named effects, by bands of their own change of the path."""
    moves = [(moved, name in row.right) for row in rows for name, moved in row.moves.items()]
    return {
        f"several at once: named of {low:g} to {high:g} noises": _share(
            [right for moved, right in moves if low <= moved < high]
        )
        for low, high in pairwise(BANDS)
    }


def _rate(among: Sequence[RigScore], good: Callable[[RigScore], bool]) -> str:
    return _counted(Rate.over(among, good))


def _share(good: Sequence[bool]) -> str:
    return _counted(Rate(sum(good), len(good)))


def _counted(rate: Rate) -> str:
    return f"{rate.good:>3} of {rate.of:>3}  {100.0 * rate.share:.0f} %" if rate.of else ""


def _mean(values: Sequence[float]) -> str:
    return f"{np.mean(values):.2f}" if values else ""


def _middle(values: Sequence[float], other: Callable[[Sequence[float]], float]) -> str:
    return f"{np.median(values):.3g}, {other(values):.3g}" if values else ""


def _low(values: Sequence[float]) -> float:
    return float(np.quantile(values, 0.1))


if __name__ == "__main__":
    main()
