"""`irt prove`: diagnose rigs of another engine, or a real one, blind; open the seals and score."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import whole
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.proof.hash_chain import Places
    from irt.proof.results import Results
    from irt.proof.rounds import Rounds
    from irt.proof.run import Progress

NAME = "prove"
HELP = "hide effects in rigs of another engine, diagnose them blind, open the seals, score"

#: Rigs with and without a hidden effect: of the quick proof, and of each round of the full proof.
_QUICK, _FULL, _ROUNDS = (9, 3), (25, 25), 12
_NEEDED = ("pybullet", "cryptography")
#: Share of the rigs whose marble is tracked in rendered pictures.
_WATCHED = "0.15"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt prove`."""
    parser.add_argument(
        "--full",
        action="store_true",
        help=f"{_ROUNDS} rounds of {_FULL[0]} rigs with a hidden effect and {_FULL[1]} without, other "
        "methods on the same rigs; docs/proof.md is updated after each round (hours)",
    )
    parser.add_argument(
        "--real",
        metavar="RIG",
        type=Path,
        help="prove on a real rig instead: its measured tilt is sealed, the diagnosis sees commands and "
        "marble alone, and DIR/report.html compares the predicted tilt with the measured one",
    )
    parser.add_argument(
        "--rigs", metavar="N", type=whole(0), help=f"rigs with a hidden effect (default: {_QUICK[0]})"
    )
    parser.add_argument(
        "--nulls", metavar="N", type=whole(0), help=f"rigs without a hidden effect (default: {_QUICK[1]})"
    )
    parser.add_argument(
        "--rounds",
        metavar="R",
        type=whole(1),
        help="number of rounds, run one after the other, each with its own rigs and seals "
        f"(default: 1; with --full: {_ROUNDS})",
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
        "--page", metavar="FILE", type=Path, help="scorecard to write (default: DIR/proof.md)"
    )
    parser.add_argument(
        "--onto",
        metavar="PAGE",
        type=Path,
        help="add the rounds to those of an existing page, instead of writing a new page",
    )
    parser.add_argument(
        "--baselines",
        action="store_true",
        help="run other methods on the same rigs too, and record one more run for ties",
    )
    parser.add_argument(
        "--world",
        metavar="COMMAND",
        help="another program that makes the rigs; irt.proof.sealing describes its JSON-lines protocol",
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help='diagnose on an existing Ray cluster ("auto" finds a local one); the results are the same',
    )
    parser.add_argument(
        "--verify", action="store_true", help="only check the seals, labels and answers of the proof in DIR"
    )
    parser.epilog = (
        "examples:\n"
        "  irt prove --out proof               12 rigs, minutes; the same command resumes after Ctrl-C\n"
        "  irt prove --full --out proof-full   writes docs/proof.md after each round\n"
        "  irt prove --full --rounds 1 --onto docs/proof.md --out more   one more round, by this version\n"
        "  irt prove --verify --out proof      check that nothing was altered\n"
        "  irt prove --rigs 20 --nulls 10 --jobs 2 --baselines --out proof\n"
        "  irt prove --real my-rig --out real   your recordings with a measured tilt, minutes"
    )


def run(args: argparse.Namespace) -> None:
    """Prove, write the scorecard, and print the verdict."""
    from irt.proof.real.seal import is_real, verify
    from irt.proof.rounds import verify_all

    if args.verify and is_real(args.out):
        count = verify(args.out)
        print(f"{args.out}: {count} recordings: seal, copy without tilt and answer are unchanged")
        return
    if args.real is not None and not args.verify:
        _prove_real(args)
        return
    if args.verify:
        checked = verify_all(args.out)
        said = "labels, recordings and answers are unchanged since they were sealed"
        print(f"{args.out}: {checked.rigs} rigs: {said}")
        if checked.unfinished:
            print(checked.unfinished)
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


#: Options of a proof on simulated rigs.
_SIMULATED = ("full", "rigs", "nulls", "rounds", "page", "onto", "baselines", "world", "cluster")


def _prove_real(args: argparse.Namespace) -> None:
    """Prove on a real rig, write the page, and print what the tilt says of the diagnosis."""
    from irt.cli.progress import progress_bar
    from irt.proof.real.page import sentences, write_real_page
    from irt.proof.real.run import prove

    for option in _SIMULATED:
        if getattr(args, option) not in (None, False):
            raise IrtError(f"--{option} belongs to simulated rigs; leave it out with --real")
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
    """Run the unfinished rounds; return the scores of all rounds, and their page."""
    from irt.cli.progress import progress_bar
    from irt.proof.hash_chain import unfinished
    from irt.proof.provenance import Made, note
    from irt.proof.results import Results
    from irt.proof.run import Proof
    from irt.proof.scorecard import write_scorecard
    from irt.workers.choice import make_workers

    earlier = Results(()) if args.onto is None else _earlier(args)
    rounds = _rounds(args, len(earlier.scores))
    each = list(rounds)
    page = args.onto or args.page or (Path("docs/proof.md") if args.full else args.out / "proof.md")
    world = shlex.split(args.world) if args.world else _world()
    jobs = args.jobs or os.cpu_count() or 1
    workers = make_workers(jobs, args.cluster)
    finished: list[Places] = []
    scored = [earlier]
    try:
        with progress_bar() as progress:
            for one, following in zip(each, [*each[1:], None], strict=True):
                proof = Proof(
                    one.places.out,
                    one.plan,
                    world,
                    workers,
                    seed=one.seed,
                    progress=_of_round(progress, len(finished), rounds.count),
                    contest=args.baselines or args.full,
                    hiders=jobs,
                )
                if unfinished(one.places):
                    note(one.places, _recorder(args))
                finished.append(proof.run())
                made = Made.of(one.places, one.plan.rigs)
                scored.append(Results.of(one.places, one.plan.names(), made))
                # The existing page covers the following round as well.
                if following and page.exists() and not unfinished(following.places):
                    continue
                results = Results.joined(scored)
                write_scorecard(
                    page,
                    results,
                    finished,
                    _settings(args, rounds, len(finished)),
                    raw=args.full or args.onto is not None,
                    earlier=len(earlier.made),
                )
    except KeyboardInterrupt:
        print(f"irt: finished work is kept in {args.out}; the same command resumes it", file=sys.stderr)
        raise
    return results, page


def _of_round(progress: Progress, done: int, count: int) -> Progress:
    """Return the progress callback of one round out of several."""
    if count == 1:
        return progress

    def report(steps: int, total: int, text: str) -> None:
        progress(done * total + steps, count * total, f"round {done + 1} of {count}, {text}")

    return report


def _settings(args: argparse.Namespace, rounds: Rounds, finished: int) -> dict[str, str]:
    """Return the settings that reproduce the proof, as the page shows them."""
    words = ["irt", "prove", *(f"--{flag}" for flag in ("full", "baselines") if getattr(args, flag))]
    for option in ("rigs", "nulls", "rounds", "seed", "onto"):
        if getattr(args, option) is not None:
            words += [f"--{option}", f"{getattr(args, option)}"]
    settings = {"command": f"`{shlex.join(words)}`"}
    if args.seed is None:
        settings["seeds"] = "drawn by the operating system"
    if rounds.count > 1:
        settings["rounds"] = f"{finished} of {rounds.count} are finished, and counted here"
    return settings


def _recorder(args: argparse.Namespace) -> str:
    """Return the name of the program that records the rigs."""
    from importlib.metadata import version

    if args.world is not None:
        return f"`{args.world}`"
    return f"PyBullet {version('pybullet')} (`irt.proof.pybullet_world`), in a separate process"


def _earlier(args: argparse.Namespace) -> Results:
    """Return the results that the page held when this proof began.

    Their count is stored, so that a resumed command does not count its own rounds twice.

    Raises
    ------
    IrtError
        If there is no such page, or another proof has been added to it since.
    """
    from irt.files import make_folder, read_json, write_atomic
    from irt.proof.results import Results

    if args.page is not None:
        raise IrtError("--onto names the page: leave --page out")
    results = Results.load(args.onto.with_suffix("") / "scores.json")
    kept = make_folder(args.out) / "onto.json"
    if not kept.exists():
        write_atomic(kept, json.dumps({"rounds": len(results.made)}) + "\n")
    count = int(read_json(kept)["rounds"])
    own = {read_json(path)["seed"] for path in args.out.rglob("keys.json")}
    if not {one.seed for one in results.made[count:]} <= {f"{seed}" for seed in own}:
        raise IrtError(
            f"{args.onto}: another proof has been added since this one began; choose another --out"
        )
    return results.first(count)


def _rounds(args: argparse.Namespace, before: int) -> Rounds:
    from irt.proof.rounds import Rounds

    hidden, nulls = _FULL if args.full else _QUICK
    return Rounds(
        args.out,
        args.rounds or (_ROUNDS if args.full else 1),
        hidden if args.rigs is None else args.rigs,
        nulls if args.nulls is None else args.nulls,
        args.seed,
        before,
    )


def _world() -> list[str]:
    """Return the command of the program that hides effects and records the rigs.

    Raises
    ------
    IrtError
        If a package that it needs is missing.
    """
    from irt.extras import require

    for package in _NEEDED:
        require(package, "irt prove")
    return [sys.executable, "-m", "irt.proof.pybullet_world", "--tracker", "irt.tracking:positions", _WATCHED]
