"""`irt prove`: diagnose rigs of another engine, or a real one, blind; open the seals and score."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import whole
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.proof.results import Results

NAME = "prove"
HELP = "hide effects in rigs of another engine, diagnose them blind, open the seals, score"

#: Rigs with and without hidden physics of the quick proof; of the full one, `irt.proof.plan.FULL`.
_QUICK = (9, 3)
#: What tracks the marble in rendered pictures, and the share of the rigs of the quick proof that it tracks.
_TRACKER, _WATCHED = "irt.tracking:positions", "0.15"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt prove`."""
    parser.add_argument(
        "--full",
        action="store_true",
        help="300 rigs with hidden physics and 300 without, a third each in PyBullet, in MuJoCo and through "
        "a camera; other methods on the same rigs; by the commit of a clean git checkout, which is "
        "published; writes docs/proof.md (days; with --rigs and --nulls less, as the page then says)",
    )
    parser.add_argument(
        "--real",
        metavar="RIG",
        type=Path,
        help="prove on a real rig instead: its measured tilt is sealed, the diagnosis sees commands and "
        "marble alone, and DIR/report.html compares the predicted tilt with the measured one",
    )
    parser.add_argument(
        "--transfer",
        action="store_true",
        help="prove by the return of controllers instead: plan on tuned and on diagnosed models, and lead "
        "marbles on concealed rigs of MuJoCo; writes DIR/transfer.md (half an hour; from a checkout)",
    )
    parser.add_argument(
        "--rigs",
        metavar="N",
        type=whole(0),
        help=f"rigs with a hidden effect (default: {_QUICK[0]}; 10 with --transfer)",
    )
    parser.add_argument(
        "--nulls", metavar="N", type=whole(0), help=f"rigs without a hidden effect (default: {_QUICK[1]})"
    )
    parser.add_argument(
        "--seed", metavar="S", type=whole(0), help="random seed of the rigs (default: drawn and sealed)"
    )
    parser.add_argument(
        "--jobs", metavar="J", type=whole(1), help="diagnoses at the same time (default: one per core)"
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("irt-prove"),
        help="folder of the proof; an unfinished proof there is resumed (default: irt-prove)",
    )
    parser.add_argument(
        "--page",
        metavar="FILE",
        type=Path,
        help="scorecard to write (default: DIR/proof.md, or DIR/transfer.md)",
    )
    parser.add_argument(
        "--baselines",
        action="store_true",
        help="run other methods on the same rigs too, and record one more run for ties",
    )
    parser.add_argument(
        "--world",
        metavar="COMMAND",
        help="another program that makes the rigs; irt.proof.world describes its JSON-lines protocol",
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help='diagnose on an existing Ray cluster ("auto" finds a local one); the results are the same',
    )
    parser.add_argument(
        "--verify",
        action="store_true",
        help="only check the commitments, labels and answers of the proof in DIR",
    )
    parser.epilog = (
        "examples:\n"
        "  irt prove --out proof               12 rigs, minutes; the same command resumes after Ctrl-C\n"
        "  irt prove --full --out proof-full   all rigs, by one commit; writes docs/proof.md\n"
        "  irt prove --full --rigs 60 --nulls 60 --out proof-full   a smaller one\n"
        "  irt prove --out proof               once more: page and pictures again, from its files\n"
        "  irt prove --verify --out proof      check that nothing was altered\n"
        "  irt prove --rigs 20 --nulls 10 --jobs 2 --baselines --out proof\n"
        "  irt prove --real my-rig --out real   your recordings with a measured tilt, minutes\n"
        "  irt prove --transfer --out transfer  whether a diagnosis pays on a controller's return"
    )


def run(args: argparse.Namespace) -> None:
    """Prove, write the scorecard, and print the verdict."""
    if args.verify:
        print(f"{args.out}: {_verified(args.out)}")
        return
    if args.real is not None:
        _prove_real(args)
        return
    if args.transfer:
        _prove_transfer(args)
        return
    from irt.proof.scorecard import verdict

    results, page = _proved(args)
    print(verdict(results))
    print()
    for floor in results.floors:
        kept = "-" if floor.kept is None else "kept" if floor.kept else "SHORT" if floor.sure else "short?"
        value = f"{floor.value:.3f} ({floor.low:.3f} to {floor.high:.3f})" if floor.of else "not counted"
        print(f"{kept:<6} {floor.what}: {value}, floor {floor.promise}, over {floor.of}")
    print(f"\nwrote {page}")


def _verified(out: Path) -> str:
    """Check the proof in a folder, and return what was checked."""
    from irt.proof import hash_chain
    from irt.proof.real import seal

    if seal.is_real(out):
        return seal.verify(out)
    rigs = hash_chain.verify(out)
    if (out / "opened").is_dir():
        return f"{rigs} rigs: labels, recordings and answers are unchanged since they were committed to"
    return f"{rigs} rigs: plan, commitments, manifest and keys fit; recordings and answers are elsewhere"


#: Options of a proof by concealment alone, and those that a real rig has no use for besides.
_CONCEALED = ("full", "nulls", "baselines", "world", "cluster")
_SIMULATED = (*_CONCEALED, "rigs", "page", "transfer")


def _refuse(args: argparse.Namespace, options: Sequence[str], proof: str, instead: str) -> None:
    """Refuse options that belong to another kind of proof."""
    for option in options:
        if getattr(args, option) not in (None, False):
            raise IrtError(f"--{option} belongs to {proof}; leave it out with --{instead}")


def _prove_transfer(args: argparse.Namespace) -> None:
    """Prove by transfer, and name the page."""
    from irt.proof.transfer import prove

    _refuse(args, (*_CONCEALED, "seed"), "the proof by concealment", "transfer")
    if args.rigs == 0:
        raise IrtError("--rigs: a proof by transfer needs at least one rig")
    page = args.page or args.out / "transfer.md"
    try:
        prove(args.out, page, rigs=args.rigs, jobs=args.jobs or os.cpu_count() or 1)
    except KeyboardInterrupt:
        print(f"irt: finished work is kept in {args.out}; the same command resumes it", file=sys.stderr)
        raise
    print(f"\nwrote {page}")


def _prove_real(args: argparse.Namespace) -> None:
    """Prove on a real rig, write the page, and print what the tilt says of the diagnosis."""
    from irt.cli.progress import progress_bar
    from irt.proof.real.page import sentences, write_real_page
    from irt.proof.real.run import prove

    _refuse(args, _SIMULATED, "simulated rigs", "real")
    try:
        with progress_bar() as progress:
            found = prove(args.real, args.out, seed=args.seed or 0, threads=args.jobs, progress=progress)
    except KeyboardInterrupt:
        print(f"irt: finished work is kept in {args.out}; the same command resumes it", file=sys.stderr)
        raise
    page = write_real_page(found)
    for line in sentences(found):
        print(line)
    print(f"\nwrote {found.folders.results} and {page}")


def _proved(args: argparse.Namespace) -> tuple[Results, Path]:
    """Run the remaining steps; return the scores and their page."""
    from irt.cli.progress import progress_bar
    from irt.files import read_json
    from irt.proof.hash_chain import Places
    from irt.proof.plan import FULL, Plan
    from irt.proof.provenance import clean_commit, this_code
    from irt.proof.results import Results
    from irt.proof.run import Proof
    from irt.proof.scorecard import write_scorecard
    from irt.workers.choice import make_workers

    there = Places(args.out)
    if there.keys.exists() and args.rigs is None and args.nulls is None:
        # A finished proof is drawn again without its numbers of rigs.
        plan = Plan(**read_json(there.plan)["plan"])
    else:
        hidden, nulls = FULL if args.full else _QUICK
        plan = Plan.of(
            hidden if args.rigs is None else args.rigs, nulls if args.nulls is None else args.nulls
        )
    # A proof with nothing more to run may be scored again, after its own page has changed the checkout.
    finished = all(there.contest(name).exists() for name in plan.names())
    commit = clean_commit() if args.full and not finished else ""
    world = shlex.split(args.world) if args.world else _world(thirds=args.full)
    jobs = args.jobs or os.cpu_count() or 1
    try:
        with progress_bar() as progress:
            places = Proof(
                args.out,
                plan,
                world,
                make_workers(jobs, args.cluster),
                {"world": _recorder(args), "code": this_code(), "commit": commit},
                seed=args.seed,
                progress=progress,
                contest=args.baselines or args.full,
                hiders=jobs,
            ).run()
    except KeyboardInterrupt:
        print(f"irt: finished work is kept in {args.out}; the same command resumes it", file=sys.stderr)
        raise
    results = Results.of(places)
    page = args.page or (Path("docs/proof.md") if args.full else args.out / "proof.md")
    return results, write_scorecard(page, results, places, _settings(args), publish=args.full)


def _settings(args: argparse.Namespace) -> dict[str, str]:
    """Return the settings that reproduce the proof, as the page shows them."""
    words = ["irt", "prove", *(f"--{flag}" for flag in ("full", "baselines") if getattr(args, flag))]
    for option in ("rigs", "nulls", "seed"):
        if getattr(args, option) is not None:
            words += [f"--{option}", f"{getattr(args, option)}"]
    return {"command": f"`{shlex.join(words)}`"}


def _recorder(args: argparse.Namespace) -> str:
    """Return the name of the program that records the rigs."""
    from importlib.metadata import version

    if args.world is not None:
        return f"`{args.world}`"
    engines = f"PyBullet {version('pybullet')}"
    if args.full:
        others = f"in MuJoCo {version('mujoco')}, whose board turns, and in PyBullet through a camera"
        engines = f"a third each in {engines}, {others}"
    return f"{engines} (`irt.proof.pybullet_world`), in a separate process"


def _world(*, thirds: bool) -> list[str]:
    """Return the command of the program that hides effects and records the rigs.

    Raises
    ------
    IrtError
        If a package that it needs is missing.
    """
    from irt.extras import require

    for package in ("pybullet", "mujoco") if thirds else ("pybullet",):
        require(package, "irt prove")
    how = ("--thirds", _TRACKER) if thirds else ("--tracker", _TRACKER, _WATCHED)
    return [sys.executable, "-m", "irt.proof.pybullet_world", *how]
