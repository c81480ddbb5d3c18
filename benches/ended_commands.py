"""End commands at random moments, run them again, and write what came of it into docs/reliability.md.

    python benches/ended_commands.py --moments 20

Each command runs once undisturbed. Then it is ended at random moments of that time (SIGTERM, SIGKILL), its
files are limited to a random size, as on a full disk, or its folder of results is removed. After each
fault the same command runs again. Four things are looked at: files with a final name that differ from those
of the undisturbed run, processes and temporary files that are left, the error message, and whether the
second run gives the same files bit for bit.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ended_commands_inputs import CASES, Case

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reliability.md"
BEGIN, END = "<!-- faults: written by benches/ended_commands.py -->", "<!-- /faults -->"
DISK = "disk full"
KINDS = ("TERM", "KILL", DISK, "folder removed")
HEAD = "| command | time [s] | fault | met | half-written | left behind | left after the second run | same |"
#: A file of results is never larger [bytes]; limits of a full disk are drawn below it, small ones as often
#: as large ones.
_LARGEST = 2**20
#: How long processes that a command started may outlive it [s].
_GRACE_S = 3.0
#: What a run says of its own duration differs each time.
_DURATION = re.compile(rb'"seconds": [^,\n]+|[\d.]+ s of computing|computing time.{0,60}?[\d.]+ s')
#: Names of files that a later run goes on from, and that no reader takes for results.
_STATE = ("unfinished.jsonl", ".checkpoint.safetensors")


@dataclass
class Trial:
    """What came of one fault.

    Attributes
    ----------
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

    met: bool
    half: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    after: list[str] = field(default_factory=list)
    said: str = ""
    lines: int = 0
    same: bool = False


def main() -> None:
    """Run the trials, and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--moments", type=int, default=10, help="faults of each kind (default: 10)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (default: 0)")
    parser.add_argument("--case", action="append", choices=[one.name for one in CASES], help="default: all")
    parser.add_argument("--page", action="store_true", help="write the table into docs/reliability.md")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="faults-") as place:
        for case in CASES:
            if args.case and case.name not in args.case:
                continue
            inputs = Path(place) / case.name / "inputs"
            inputs.mkdir(parents=True)
            case.prepare(inputs)
            for line in measure(case, inputs, args.moments, random.Random(f"{args.seed} {case.name}")):
                print(line, flush=True)
                if args.page:
                    write(line)


def measure(case: Case, inputs: Path, moments: int, draw: random.Random) -> Iterator[str]:
    """Yield a line of the table for each kind of fault."""
    begin = time.monotonic()
    wanted = undisturbed(case, inputs, "first")
    seconds = time.monotonic() - begin
    again = undisturbed(case, inputs, "second")
    # Files that two undisturbed runs write differently can be compared with nothing.
    differ = sorted(name for name in wanted if again.get(name) != wanted[name])
    for name in differ:
        print(f"note: {case.name} writes {name} differently each time", file=sys.stderr)
    for kind in KINDS:
        trials = [trial(case, inputs, wanted, differ, fault(kind, seconds, draw)) for _ in range(moments)]
        yield row(case, seconds, kind, trials)


def undisturbed(case: Case, inputs: Path, name: str) -> dict[str, bytes]:
    """Return the files of a run without a fault."""
    with place_of(inputs) as place:
        done = run(case, place)
        if done.returncode != 0:
            raise SystemExit(f"{case.name} failed undisturbed ({name}): {done.stderr}")
        return finals(place)


@dataclass(frozen=True)
class Fault:
    """A fault: what it is, and when or from which size on it strikes."""

    kind: str
    delay_s: float = 0.0
    bytes: int = 0


def fault(kind: str, seconds: float, draw: random.Random) -> Fault:
    """Draw a fault of a kind in a run of so many seconds."""
    if kind == DISK:
        return Fault(kind, bytes=int(_LARGEST ** draw.random()))
    return Fault(kind, delay_s=seconds * draw.uniform(0.02, 1.0))


def trial(case: Case, inputs: Path, wanted: dict[str, bytes], differ: Sequence[str], one: Fault) -> Trial:
    """Run a command with a fault, and again without."""
    with place_of(inputs) as place:
        done = run(case, place, one)
        found = Trial(met=done.returncode != 0)
        lines = done.stderr.strip().splitlines()
        found.lines, found.said = len(lines), lines[-1] if lines else ""
        there = finals(place)
        found.half = [name for name in there if name not in differ and there[name] != wanted.get(name)]
        found.left = leftovers(place)
        second = run(case, place)
        there = finals(place)
        found.same = second.returncode == 0 and all(
            name in differ or there.get(name) == content for name, content in wanted.items()
        )
        if not found.same:
            print(f"{case.name}, {one}: {second.stderr.strip()[-300:]}", file=sys.stderr)
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


def run(case: Case, place: Path, one: Fault | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command, with a fault if one is given."""
    words = [sys.executable, "-m", "irt.cli.__main__", *case.words]
    if one is not None and one.kind == DISK:
        words = ["prlimit", f"--fsize={one.bytes}", *words]
    environment = {**os.environ, "TMPDIR": str(place / "tmp"), "IRT_CACHE": str(place / "cache")}
    with subprocess.Popen(
        words, cwd=place, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        if one is not None and one.kind != DISK:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(one.delay_s)
            if one.kind == "folder removed":
                shutil.rmtree(place / "out", ignore_errors=True)
            elif process.poll() is None:
                process.send_signal(getattr(signal, f"SIG{one.kind}"))
        _, text = process.communicate()
    return subprocess.CompletedProcess(words, process.returncode, "", text)


def finals(place: Path) -> dict[str, bytes]:
    """Return the files of results by name: not those that a later run goes on from, and no hidden ones."""
    out = place / "out"
    return {
        str(path.relative_to(out)): _DURATION.sub(b"", path.read_bytes())
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
    found += [f"tmp/{path.name}" for path in (place / "tmp").iterdir()]
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


def row(case: Case, seconds: float, kind: str, trials: Sequence[Trial]) -> str:
    """Return a line of the table, and print what was not as it should be."""
    met = [one for one in trials if one.met]
    kept = Counter(name for one in trials for name in (*one.half, *one.left, *one.after))
    if kept:
        print(f"{case.name}, {kind}: {json.dumps(kept)}", file=sys.stderr)
    many = [one for one in met if one.lines > 1 or (kind == DISK and one.lines != 1)]
    for one in many[:3]:
        print(f"{case.name}, {kind}: {one.lines} lines, the last: {one.said}", file=sys.stderr)
    cells = (
        f"`{case.name}`",
        f"{seconds:.1f}",
        kind,
        f"{len(met)} of {len(trials)}",
        f"{sum(bool(one.half) for one in trials)}",
        f"{sum(bool(one.left) for one in trials)}",
        f"{sum(bool(one.after) for one in trials)}",
        f"{sum(one.same for one in trials)} of {len(trials)}",
    )
    return f"| {' | '.join(cells)} |"


def write(line: str) -> None:
    """Put a line into the table, instead of the one of the same command and fault."""

    def place(one: str) -> tuple[int, int]:
        cells = [cell.strip(" `") for cell in one.split("|")]
        return [case.name for case in CASES].index(cells[1]), KINDS.index(cells[3])

    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    table, after = rest.split(END)
    known = {place(one): one for one in table.strip().splitlines()[2:]}
    known[place(line)] = line
    rows = [HEAD, "| --- | --- | --- | --- | --- | --- | --- | --- |", *(known[key] for key in sorted(known))]
    PAGE.write_text("\n".join([f"{before}{BEGIN}", *rows, f"{END}{after}"]), encoding="utf-8")


if __name__ == "__main__":
    main()
