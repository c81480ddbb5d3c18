"""`irt diagnose`: find the missing physics, model it, and validate it on held-out recordings."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irt.cli.inputs import (
    TIME_UNKNOWN,
    parameter_line,
    print_warnings,
    results_folder,
    row_seconds,
    rows_for_fit,
    whole,
)
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.diagnosis import Diagnosis
    from irt.fitting.unfinished import Unfinished
    from irt.rig import Rig

NAME = "diagnose"
HELP = "locate the mismatch, name the missing physics, model it, and prove it"

#: Name of the cache of an unfinished diagnosis, in the folder of its results.
UNFINISHED = "unfinished.jsonl"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt diagnose`."""
    parser.add_argument(
        "rigs",
        metavar="RIG",
        type=Path,
        nargs="+",
        help="a folder of recordings (*.csv); several rigs are diagnosed one by one",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="folder for diagnosis.json, model.toml and report.html (default: irt-diagnose-NAME for a rig "
        "NAME); DIR/NAME if there are several rigs",
    )
    parser.add_argument(
        "--same-rig",
        action="store_true",
        help="the folders are sessions of one rig: diagnose their recordings together, and report what "
        "differs between them",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="random seed (default: 0)")
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="simulator threads (default: one per core)"
    )
    parser.add_argument(
        "--jobs", metavar="J", type=whole(1), help="rigs diagnosed at the same time (default: one per core)"
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help='diagnose on an existing Ray cluster ("auto" finds a local one); the results are the same',
    )
    parser.epilog = (
        "examples:\n"
        "  irt diagnose my-rig --out diagnosed\n"
        "  irt diagnose lab/* --out diagnosed   one folder per rig\n"
        "  irt diagnose day-1 day-2 --same-rig --out diagnosed\n\n"
        "After Ctrl-C, the same command resumes the diagnosis."
    )


def run(args: argparse.Namespace) -> None:
    """Diagnose, write the model, the numbers and the report, and print the findings."""
    from irt.rig import load_rig

    if args.same_rig:
        _diagnose_sessions(args)
        return
    # Load all rigs first, so that a broken file fails before the first diagnosis.
    rigs, notes = {}, {}
    for path in args.rigs:
        rigs[path.resolve().name], notes[path.resolve().name] = rows_for_fit(load_rig(path))
    if len(rigs) < len(args.rigs):
        raise IrtError("two of the rigs have the same name: their results would share a folder; rename one")
    if len(rigs) == 1 and args.cluster is None:
        ((name, rig),) = rigs.items()
        _diagnose_one(args, rig, args.out or Path(f"irt-diagnose-{name}"), notes[name])
        return
    folders = {name: _folder(args.out, name, alone=len(rigs) == 1) for name in rigs}
    _diagnose_many(args, rigs, folders)


def _diagnose_sessions(args: argparse.Namespace) -> None:
    """Diagnose the recordings of several sessions of one rig together."""
    from irt.rig import load_rig
    from irt.sessions import pool

    if len(args.rigs) < 2:
        raise IrtError("--same-rig: name the folders of two sessions or more")
    if args.cluster is not None:
        raise IrtError("--cluster: sessions of one rig are one diagnosis, which runs here; leave it out")
    rig, notes = rows_for_fit(pool([load_rig(path) for path in args.rigs]))
    _diagnose_one(args, rig, args.out or Path(f"irt-diagnose-{rig.path.name}"), notes)


def _folder(out: Path | None, name: str, *, alone: bool) -> Path:
    """Return the results folder of a rig."""
    if out is None:
        return Path(f"irt-diagnose-{name}")
    return out if alone else out / name


def _diagnose_one(args: argparse.Namespace, rig: Rig, folder: Path, notes: Sequence[str]) -> None:
    """Diagnose a rig in this process, with a progress bar."""
    from irt.cli.progress import progress_bar
    from irt.diagnosis import diagnose
    from irt.report.diagnosed import write_diagnosis

    print_warnings(rig, args.threads)
    with_marbles = rig.of_marbles(with_tilt=True)
    folder = results_folder(folder, ("model.toml", "diagnosis.json", "report.html"))
    unfinished = _unfinished(folder / UNFINISHED, with_marbles, args.seed)
    try:
        with unfinished.used():
            with progress_bar() as progress:
                found = diagnose(rig, seed=args.seed, threads=args.threads, progress=progress)
            page = write_diagnosis(folder, with_marbles, found, notes)
    except KeyboardInterrupt:
        print("irt: no result was written; the same command resumes the diagnosis", file=sys.stderr)
        raise
    for line in _answer(found, rig):
        print(line)
    print(f"\nwrote {folder / 'model.toml'}, {folder / 'diagnosis.json'} and {page}")


def _unfinished(path: Path, rig: Rig, seed: int) -> Unfinished:
    """Return the cache of an interrupted diagnosis, and print whether it is used."""
    from irt.fitting.unfinished import Unfinished

    found = Unfinished.of(path, rig.digest, seed)
    if found.stale:
        print(
            f"note: {path} is of another {' and '.join(found.stale)}: the diagnosis starts over", flush=True
        )
    elif len(found):
        print(f"note: resumes an interrupted diagnosis from {path}", flush=True)
    return found


def _diagnose_many(args: argparse.Namespace, rigs: Mapping[str, Rig], folders: Mapping[str, Path]) -> None:
    """Diagnose each rig in its own process; skip rigs that have a result already."""
    from contextlib import closing

    from irt.cli.progress import progress_bar
    from irt.files import make_folder, write_atomic
    from irt.workers import FAILED
    from irt.workers.choice import make_workers

    workers = make_workers(args.jobs, args.cluster)
    for folder in folders.values():
        make_folder(folder)
    left = [
        name
        for name, rig in rigs.items()
        if not _is_done(folders[name], rig.of_marbles(with_tilt=True), args.seed)
    ]
    inputs = {name: _files(rigs[name].path) for name in left}
    failed = {}
    try:
        with (
            progress_bar() as progress,
            closing(workers.each("irt.report.diagnosed", inputs, [str(args.seed)])) as answers,
        ):
            for done, (name, files) in enumerate(answers, start=1):
                progress(done, len(left), f"{name} is done")
                if FAILED in files:
                    failed[name] = json.loads(files[FAILED])["error"]
                    continue
                # diagnosis.json comes last: its presence marks a complete result.
                for file in sorted(files, key="diagnosis.json".__eq__):
                    write_atomic(folders[name] / file, files[file])
    except KeyboardInterrupt:
        print("irt: finished rigs are kept; the same command resumes the rest", file=sys.stderr)
        raise
    for line in _table({name: folders[name] for name in rigs if name not in failed}):
        print(line)
    if failed:
        raise IrtError("; ".join(f"{name}: {error}" for name, error in failed.items()))


def _files(path: Path) -> dict[str, bytes]:
    """Return the files of a rig that a process needs, and the rig's path for its messages."""
    from irt.workers.processes import files_of

    files = {**files_of(path, "rig.toml"), **files_of(path, "*.[cC][sS][vV]")}
    return {"path": str(path).encode(), **{f"rig/{name}": data for name, data in files.items()}}


def _is_done(folder: Path, rig: Rig, seed: int) -> bool:
    """Whether a folder holds a complete result for these recordings, this seed and this release."""
    from importlib.metadata import version

    try:
        settings = dict(json.loads((folder / "diagnosis.json").read_bytes())["settings"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False
    wanted = {"recordings_sha256": rig.digest, "seed": seed, "version": version("labsim-irt")}
    return all(settings.get(key) == value for key, value in wanted.items())


def _table(folders: Mapping[str, Path]) -> Iterator[str]:
    """Yield a line for each rig: the verdict, the effects, the held-out error before and after."""
    width = max(map(len, ["rig", *folders]))
    yield f"{'rig':<{width}}  {'verdict':<10} {'held out':>17}  effects"
    for name, folder in folders.items():
        result = json.loads((folder / "diagnosis.json").read_bytes())
        named = " + ".join(_or_ties(one) for one in result["effects"])
        fit = result["fit"]
        errors = [fit["base_heldout_mae"], fit["final_heldout_mae"]]
        held_out = "-" if None in errors else " -> ".join(f"{100 * error:.2f} %" for error in errors)
        yield f"{name:<{width}}  {result['verdict']:<10} {held_out:>17}  {named or '-'}"
    yield f"\nwrote diagnosis.json, model.toml and report.html to {', '.join(map(str, folders.values()))}"


def _or_ties(effect: Mapping[str, Any]) -> str:
    """Return the name of an effect, joined with those that explain the recordings as well."""
    names: Sequence[str] = [effect["name"], *effect["confusable_with"]]
    return " or ".join(names)


def _answer(found: Diagnosis, rig: Rig) -> Iterator[str]:
    """Yield the lines of the printed summary."""
    from irt.diagnosis.dataset import horizon_row_s
    from irt.diagnosis.result import UNLISTED
    from irt.report.error_budget import bars, remainder
    from irt.report.learned import described
    from irt.report.words import probability, share

    row_s = row_seconds(rig, found.model)
    yield found.summary
    for effect in found.effects:
        if effect.name == UNLISTED:
            yield f"\n{effect.name}"
            yield from (f"  {line}" for line in described(effect, row_s))
            continue
        either = " or ".join([effect.name, *effect.confusable_with])
        yield f"\n{effect.name}: {_plain(probability(effect.probability))} probable that {either} acts"
        for name, parameter in effect.parameters.items():
            label, value = parameter_line(name, parameter, effect.units.get(name, ""), row_s)
            yield f"  {label:<22} {value}"
        if effect.reason:
            yield f"  {effect.reason}"
        if math.isfinite(effect.chosen_again):
            again = round(effect.chosen_again * len(found.runs))
            yield f"  selected again when one recording is left out: {again} of {len(found.runs)}"
    if row_s is not None:
        yield f"\n{TIME_UNKNOWN}"
    for bar in bars(found, horizon_row_s(rig)):
        yield f"\nerror budget: squared error on held-out runs, {bar.title}"
        yield from (f"  {part.name:<22} {_plain(share(part.share)):>6}" for part in bar.parts)
    if found.where:
        yield "\nwhere residuals exceed noise"
        yield from (f"- {one.kind}: {one.what} ({100 * one.strength:.0f} %)" for one in found.where)
    for title, sentences in (
        ("remaining error", [_plain(sentence) for sentence in remainder(found)]),
        ("not identifiable from these recordings", found.unidentifiable),
        ("notes", found.notes),
        ("next step", (found.suggestion,)),
    ):
        if sentences:
            yield f"\n{title}"
            yield from (f"- {sentence}" for sentence in sentences)


def _plain(text: str) -> str:
    """Return a text with plain spaces in place of no-break spaces, for terminals and searches."""
    return text.replace("\N{NO-BREAK SPACE}", " ")
