"""`irt diagnose`: what physics the simulator lacks, modelled, and proved on recordings held out."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irt.cli.inputs import whole

if TYPE_CHECKING:
    from irt.diagnose import Diagnosis

NAME = "diagnose"
HELP = "locate the mismatch, name the missing physics, model it, and prove it"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt diagnose`."""
    parser.add_argument("rig", metavar="RIG", type=Path, help="a folder of recordings (*.csv)")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="folder for diagnosis.json, model.toml and report.html (default: irt-diagnose-NAME, for a rig "
        "NAME)",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="of all draws (default: 0)")
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="of the simulator (default: one for each core)"
    )
    parser.epilog = "example:\n  irt diagnose my-rig --out diagnosed"


def run(args: argparse.Namespace) -> None:
    """Diagnose, write model, numbers and the report, and print the answer."""
    from irt.cli.progress import progress_bar
    from irt.diagnose import Interrupted, diagnose
    from irt.files import make_folder, write_atomic
    from irt.model import save_model
    from irt.report.diagnosis_report import write_diagnosis_report
    from irt.rig import load_rig

    rig = load_rig(args.rig)
    folder = make_folder(args.out or Path(f"irt-diagnose-{args.rig.resolve().name}"))
    try:
        with progress_bar() as progress:
            found = diagnose(rig, seed=args.seed, threads=args.threads, progress=progress)
    except Interrupted as stopped:
        partial = folder / "candidates.json"
        write_atomic(partial, _json({"interrupted": True, "candidates": stopped.candidates}))
        print(f"irt: what was tried so far is in {partial}", file=sys.stderr)
        raise
    save_model(folder / "model.toml", found.model)
    write_atomic(folder / "diagnosis.json", _json(found.as_dict()))
    page = write_diagnosis_report(folder, rig, found)
    for line in _answer(found):
        print(line)
    print(f"\nwrote {folder / 'model.toml'}, {folder / 'diagnosis.json'} and {page}")


def _answer(found: Diagnosis) -> Iterator[str]:
    """Yield what a user wants to know first."""
    from irt.report.words import with_interval

    yield found.summary
    for effect in found.effects:
        yield f"\n{effect.name}"
        for name, parameter in effect.parameters.items():
            yield f"  {name:<22} {with_interval(parameter)} {effect.units.get(name, '')}".rstrip()
        if effect.reason:
            yield f"  {effect.reason}"
    if found.where:
        yield "\nwhere the mismatch lives"
        yield from (f"- {one.kind}: {one.what} ({100 * one.strength:.0f} %)" for one in found.where)
    for title, sentences in (
        ("not pinned down by these recordings", found.unidentifiable),
        ("to know besides", found.notes),
        ("to record next", (found.suggestion,)),
    ):
        if sentences:
            yield f"\n{title}"
            yield from (f"- {sentence}" for sentence in sentences)


def _json(content: dict[str, Any]) -> str:
    return f"{json.dumps(content, indent=2, allow_nan=False)}\n"
