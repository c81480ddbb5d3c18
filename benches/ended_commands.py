"""End commands at random moments, run them again, and write what came of it into docs/reliability.md.

    python benches/ended_commands.py --moments 50 --page

Each command runs twice undisturbed. Then faults strike it at random moments, counted in its processor time,
which does not depend on what else the machine does:

- TERM, KILL: the signal;
- disk full: no file may grow beyond a random size;
- folders removed: the folders of results and of the cache are removed;
- clock set: the day's time jumps, by an hour or more than a year, forward or backward.

After each fault the same command runs again. Four things are looked at: files with a final name that differ
from those of the undisturbed run, processes and temporary files that are left, the error message, and
whether the second run gives the same files bit for bit. Each trial is a line of ``--log``, from which a
later call goes on; all commands get the same processor time, so that quick ones are disturbed more often.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ended_commands_inputs import CASES, Case
from machine import machine
from write_table import fill

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reliability.md"
CLOCK_SOURCE = ROOT / "tests" / "rig" / "clock.c"
DISK, FOLDERS, CLOCK = "disk full", "folders removed", "clock set"
KINDS = ("TERM", "KILL", DISK, FOLDERS, CLOCK)
HEAD = (
    "command",
    "processor time [s]",
    "fault",
    "met",
    "half-written",
    "left behind",
    "left after the second run",
    "same",
)
#: A file of results is never larger [bytes]; limits of a full disk are drawn below it, small ones as often
#: as large ones.
_LARGEST = 2**20
#: Jumps of the clock [s].
_JUMPS_S = (3600, 400 * 86400)
#: How long processes that a command started may outlive it [s].
_GRACE_S = 3.0
#: A command that takes so many times its processor time [s], and a minute, is taken for one that hangs.
_HANG = 100.0
#: What differs each time: a run's own duration, and the secrets of a proof's seals, with all digests.
_DIFFERENT = re.compile(
    rb'"seconds": ?[\d.e-]+|[\d.]+ s of computing|computing time.{0,60}?[\d.]+ s|<dt>time</dt><dd>[^<]+|'
    rb"A diagnosis took [^.]+|[0-9a-f]{64}"
)
#: Names of files that a later run goes on from, or that are kept, and that no reader takes for results.
_STATE = ("unfinished.jsonl", ".checkpoint.safetensors", ".partial")


@dataclass
class Trial:
    """What came of one fault.

    Attributes
    ----------
    case, kind : str
        The command and the fault.
    index : int
        Number of the moment.
    work_s : float
        Processor time of the command undisturbed [s].
    met : bool
        Whether the command failed: otherwise it was done before the fault.
    half : list of str
        Files with a final name that an undisturbed run does not write so.
    left : list of str
        Processes and temporary files that are left after the fault.
    after : list of str
        Those that are left after the second run.
    said : str
        The last line on standard error.
    lines : int
        Number of lines there.
    same : bool
        Whether the second run succeeded, and gave the files of an undisturbed one.
    """

    case: str
    kind: str
    index: int
    work_s: float
    met: bool = False
    half: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    after: list[str] = field(default_factory=list)
    said: str = ""
    lines: int = 0
    same: bool = False


@dataclass
class Reference:
    """A command undisturbed: its inputs, files, processor time [s], and the files that differ each time."""

    case: Case
    inputs: Path
    wanted: dict[str, bytes]
    differ: list[str]
    work_s: float


def main() -> None:
    """Run the trials, and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--moments", type=int, default=10, help="faults of each kind (default: 10)")
    parser.add_argument("--minutes", type=float, default=1e6, help="start no trial after (default: no end)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (default: 0)")
    parser.add_argument("--case", action="append", choices=[one.name for one in CASES], help="default: all")
    parser.add_argument(
        "--log",
        type=Path,
        default=ROOT / "out" / "ended_commands.jsonl",
        help="the trials so far; remove it once the sources have changed (default: out/ended_commands.jsonl)",
    )
    parser.add_argument("--page", action="store_true", help="write the table into docs/reliability.md")
    args = parser.parse_args()
    # As Ctrl-C: with nothing left behind.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    end = time.monotonic() + 60.0 * args.minutes
    args.log.parent.mkdir(parents=True, exist_ok=True)
    known = read(args.log)
    with tempfile.TemporaryDirectory(prefix="faults-") as place:
        clock = clock_library(Path(place))
        kinds = [kind for kind in KINDS if kind != CLOCK or clock]
        references: dict[str, Reference] = {}
        cases = [case for case in CASES if case.name in (args.case or [case.name]) and is_there(case)]
        for case, kind, index in schedule(cases, kinds, args.moments, known):
            if time.monotonic() > end:
                break
            if case.name not in references:
                references[case.name] = reference(case, Path(place) / str(len(references)))
            one = references[case.name]
            draw = random.Random(f"{args.seed} {case.name} {kind} {index}")
            found = trial(one, fault(kind, one.work_s, draw), index, clock)
            complain(found)
            known.append(found)
            with args.log.open("a", encoding="utf-8") as log:
                print(json.dumps(dataclasses.asdict(found)), file=log)
            if args.page:
                write(known)
    if args.page:
        write(known)
    print("\n".join(table(known)))


def read(log: Path) -> list[Trial]:
    """Return the trials of a log."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    return [Trial(**json.loads(line)) for line in lines]


def is_there(case: Case) -> bool:
    """Return whether a command can run; say so if not."""
    found = not case.needs or importlib.util.find_spec(case.needs) is not None
    if not found:
        print(f"{case.name} is skipped: {case.needs} is not installed", file=sys.stderr)
    return found


def clock_library(folder: Path) -> Path | None:
    """Build the library that moves the day's time by the number of seconds in a file."""
    if shutil.which("cc") is None:
        print(f"{CLOCK} is skipped: there is no C compiler", file=sys.stderr)
        return None
    library = folder / "clock.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, CLOCK_SOURCE, "-ldl"], check=True)
    return library


def reference(case: Case, folder: Path) -> Reference:
    """Run a command twice undisturbed."""
    inputs = folder / "inputs"
    inputs.mkdir(parents=True)
    case.prepare(inputs)
    wanted, work_s = undisturbed(case, inputs)
    again, again_s = undisturbed(case, inputs)
    # Files that two undisturbed runs write differently can be compared with nothing.
    differ = sorted(name for name in wanted if again.get(name) != wanted[name])
    for name in differ:
        print(f"note: {case.name} writes {name} differently each time", file=sys.stderr)
    return Reference(case, inputs, wanted, differ, min(work_s, again_s))


def undisturbed(case: Case, inputs: Path) -> tuple[dict[str, bytes], float]:
    """Return the files of a run without a fault, and its processor time [s]."""
    with place_of(inputs) as place:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = run(case, place)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode != 0:
            raise SystemExit(f"{case.name} failed undisturbed: {done.stderr}")
        return finals(place), sum(after[:2]) - sum(before[:2])


def schedule(
    cases: Sequence[Case], kinds: Sequence[str], moments: int, known: Sequence[Trial]
) -> Iterator[tuple[Case, str, int]]:
    """Yield the trials that are still to be run: next that of the command with the least work so far.

    Trials are expected to be appended to the known ones.
    """
    done = {(one.case, one.kind, one.index) for one in known}
    to_do = {
        case.name: [
            (case, kind, index)
            for index in range(moments)
            for kind in kinds
            if (case.name, kind, index) not in done
        ]
        for case in cases
    }
    while pending := [name for name, rest in to_do.items() if rest]:
        work = {name: sum(one.work_s for one in known if one.case == name) for name in pending}
        yield to_do[min(pending, key=work.__getitem__)].pop(0)


@dataclass(frozen=True)
class Fault:
    """A fault: what it is, and when, from which size on or by how much it strikes."""

    kind: str
    work_s: float = 0.0
    bytes: int = 0
    jump_s: int = 0


def fault(kind: str, work_s: float, draw: random.Random) -> Fault:
    """Draw a fault of a kind in a run of so much processor time."""
    if kind == DISK:
        return Fault(kind, bytes=int(_LARGEST ** draw.random()))
    jump_s = draw.choice((-1, 1)) * draw.choice(_JUMPS_S)
    return Fault(kind, work_s=work_s * draw.uniform(0.02, 1.0), jump_s=jump_s)


def trial(one: Reference, struck: Fault, index: int, clock: Path | None) -> Trial:
    """Run a command with a fault, and again without."""
    found = Trial(one.case.name, struck.kind, index, one.work_s)
    most_s = 60.0 + _HANG * one.work_s
    with place_of(one.inputs) as place:
        done = run(one.case, place, struck, clock, most_s)
        found.met = done.returncode != 0
        lines = done.stderr.strip().splitlines()
        found.lines, found.said = len(lines), lines[-1] if lines else ""
        there = finals(place)
        found.half = [
            name for name in there if name not in one.differ and there[name] != one.wanted.get(name)
        ]
        found.left = leftovers(place)
        second = run(one.case, place, most_s=most_s)
        there = finals(place)
        found.same = second.returncode == 0 and all(
            name in one.differ or there.get(name) == content for name, content in one.wanted.items()
        )
        if not found.same:
            differ = [name for name, content in one.wanted.items() if there.get(name) != content]
            print(f"{one.case.name}, {struck}: {differ} {second.stderr.strip()[-300:]}", file=sys.stderr)
        found.after = leftovers(place)
        return found


@contextlib.contextmanager
def place_of(inputs: Path) -> Iterator[Path]:
    """Yield a folder with the inputs of a command, and a folder for its temporary files."""
    with tempfile.TemporaryDirectory(prefix="fault-", dir=inputs.parent) as name:
        place = Path(name)
        shutil.copytree(inputs, place / "in")
        (place / "tmp").mkdir()
        yield place


def run(
    case: Case, place: Path, one: Fault | None = None, clock: Path | None = None, most_s: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command, with a fault if one is given; one that hangs is killed."""
    words = [sys.executable, "-m", "irt.cli.__main__", *case.words]
    if one is not None and one.kind == DISK:
        words = ["prlimit", f"--fsize={one.bytes}", *words]
    environment = {**os.environ, "TMPDIR": str(place / "tmp"), "IRT_CACHE": str(place / "cache")}
    if one is not None and one.kind == CLOCK:
        (place / "offset").write_text("0")
        environment |= {"LD_PRELOAD": str(clock), "CLOCK_OFFSET": str(place / "offset")}
    with subprocess.Popen(
        words, cwd=place, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            if one is not None and one.kind != DISK:
                end = time.monotonic() + (most_s or math.inf)
                while process.poll() is None and time.monotonic() < end:
                    if (rest := one.work_s - work_of(process.pid)) <= 0.0:
                        break
                    # All cores together need at least so long for half of the rest.
                    time.sleep(max(0.005, 0.5 * rest / (os.cpu_count() or 1)))
                strike(process, place, one)
            _, text = process.communicate(timeout=most_s)
        except subprocess.TimeoutExpired:
            text = f"{case.name} hung"
            print(f"{text}: {one}", file=sys.stderr)
        finally:
            process.kill()
    return subprocess.CompletedProcess(words, process.returncode, "", text)


def strike(process: subprocess.Popen[str], place: Path, one: Fault) -> None:
    """Let a fault happen now."""
    if one.kind == FOLDERS:
        for name in ("out", "cache"):
            shutil.rmtree(place / name, ignore_errors=True)
    elif one.kind == CLOCK:
        # Renamed, as a library that reads an empty file takes the time as it is.
        (place / "offset.new").write_text(str(one.jump_s))
        (place / "offset.new").rename(place / "offset")
    elif process.poll() is None:
        process.send_signal(getattr(signal, f"SIG{one.kind}"))


def work_of(process: int) -> float:
    """Return the processor time of a process and of all that it started [s]."""
    parents, times = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)], times[int(folder.name)] = int(fields[1]), sum(map(int, fields[11:15]))
    found, generation = 0, {process}
    while generation:
        found += sum(times.get(one, 0) for one in generation)
        generation = {one for one, parent in parents.items() if parent in generation}
    return found / os.sysconf("SC_CLK_TCK")


def finals(place: Path) -> dict[str, bytes]:
    """Return the files of results by name: not those that a later run goes on from, and no hidden ones."""
    out = place / "out"
    return {
        str(path.relative_to(out)): _DIFFERENT.sub(b"", path.read_bytes())
        for path in sorted(out.rglob("*"))
        if path.is_file() and not path.name.startswith(".") and not path.name.endswith(_STATE)
    }


def leftovers(place: Path) -> list[str]:
    """Return processes that still run after a while, temporary folders, and hidden files of results."""
    end = time.monotonic() + _GRACE_S
    while (running := processes(place)) and time.monotonic() < end:
        time.sleep(0.05)
    found = [f"process {command}" for command in running.values()]
    for process in running:
        os.kill(process, signal.SIGKILL)
    # The cache of torch's compiler is made by any program that imports it, under one name for a user.
    found += [
        f"tmp/{path.name}" for path in (place / "tmp").iterdir() if not path.name.startswith("torchinductor_")
    ]
    return found + [path.name for path in (place / "out").rglob(".irt-*")]


def processes(place: Path) -> dict[int, str]:
    """Return the processes whose temporary folder is this place's, with their command lines."""
    mark = f"TMPDIR={place / 'tmp'}".encode()
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark in (folder / "environ").read_bytes().split(b"\0"):
                found[int(folder.name)] = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
    return found


def complain(one: Trial) -> None:
    """Print what of a trial was not as it should be."""
    about = f"{one.case}, {one.kind}, moment {one.index}"
    if kept := [*one.half, *one.left, *one.after]:
        print(f"{about}: {json.dumps(kept)}", file=sys.stderr)
    if one.met and (one.lines > 1 or (one.kind == DISK and one.lines != 1)):
        print(f"{about}: {one.lines} lines, the last: {one.said}", file=sys.stderr)


def table(trials: Sequence[Trial]) -> list[str]:
    """Return the lines of the table: one for each command and fault."""
    lines = [f"| {' | '.join(HEAD)} |", f"|{' --- |' * len(HEAD)}"]
    for case in CASES:
        for kind in KINDS:
            chosen = [one for one in trials if (one.case, one.kind) == (case.name, kind)]
            if not chosen:
                continue
            cells = (
                f"`{case.name}`",
                f"{sum(one.work_s for one in chosen) / len(chosen):.1f}",
                kind,
                f"{sum(one.met for one in chosen)} of {len(chosen)}",
                f"{sum(bool(one.half) for one in chosen)}",
                f"{sum(bool(one.left) for one in chosen)}",
                f"{sum(bool(one.after) for one in chosen)}",
                f"{sum(one.same for one in chosen)} of {len(chosen)}",
            )
            lines.append(f"| {' | '.join(cells)} |")
    return lines


def write(trials: Sequence[Trial]) -> None:
    """Put the table into the page."""
    text = "\n".join([*table(trials), "", f"Measured on {machine()}."])
    PAGE.write_text(fill(PAGE.read_text(encoding="utf-8"), {"ended_commands": text}), encoding="utf-8")


if __name__ == "__main__":
    main()
