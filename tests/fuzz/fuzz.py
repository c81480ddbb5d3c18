"""Fuzz the readers for some time, print a table of inputs and finds, and keep the finds.

    python tests/fuzz/fuzz.py --seconds 300 --out /tmp/finds

A line of JSON a reader is appended to ``--summary``, of which ``benches/fuzz_counts.py`` makes a table.
Exit status 1 if anything but success or one line of refusal came of an input.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import gc
import hashlib
import itertools
import json
import math
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import TextIO

from guard import TooSlowError, little_memory, outcome
from mutations import edited
from readers import READERS, Reader

#: Processor time of an input in a library that returns to no handler of signals [s].
_MOST_S = 20
#: Inputs of one child process: what libraries leak ends with it.
_BATCH = 500


@dataclass(frozen=True)
class Batch:
    """Inputs of one child process, which follow from a seed."""

    reader: Reader
    seeds: Sequence[str | bytes]
    seed: str

    def input(self, index: int) -> bytes:
        """Return the input of this number."""
        random = Random(f"{self.reader.name} {self.seed} {index}")
        edits = range(random.choice((1, 1, 1, 2, 2, 3, 4)))
        return edited(random.choice(self.seeds), [random.getrandbits(64) for _ in edits])


def main() -> int:
    """Share the time among the readers, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=300.0, help="in all (default: 300)")
    parser.add_argument("--inputs", type=int, default=10**9, help="most for each reader (default: no limit)")
    parser.add_argument("--summary", type=Path, help="file to which the counts are appended")
    parser.add_argument("--seed", type=int, default=None, help="of the inputs (default: the time)")
    parser.add_argument(
        "--out", type=Path, default=Path("out/finds"), help="folder of finds (default: out/finds)"
    )
    parser.add_argument("readers", nargs="*", help="names (default: all)")
    args = parser.parse_args()
    chosen = [one for one in READERS if not args.readers or one.name in args.readers]
    seed = time.time_ns() if args.seed is None else args.seed
    print(f"{'reader':<12} {'inputs':>8} {'taken':>8} {'finds':>6}   (seed {seed})")
    failed = False
    for reader in chosen:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        counts, finds = run(reader, seed, args.seconds / len(chosen), args.inputs, args.out)
        if args.summary:
            about = {"language": "Python", "reader": reader.name, "finds": len(finds)}
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            line = json.dumps(about | counts | {"processor_s": sum(after[:2]) - sum(before[:2])})
            with args.summary.open("a", encoding="utf-8") as summary:
                print(line, file=summary)
        print(f"{reader.name:<12} {counts['inputs']:>8} {counts['taken']:>8} {len(finds):>6}", flush=True)
        for place, text in finds.items():
            print(f"    {place}: {text}", flush=True)
        failed |= bool(finds)
    return int(failed)


def run(
    reader: Reader, seed: int, seconds: float, most: int, out: Path
) -> tuple[collections.Counter[str], dict[str, str]]:
    """Fuzz one reader in child processes; return counts, and the finds by their place in the sources."""
    counts: collections.Counter[str] = collections.Counter()
    finds: dict[str, str] = {}
    end = time.monotonic() + seconds
    seeds = reader.seeds()
    numbers = itertools.count()
    # Else each child's collector copies the pages of all objects.
    gc.freeze()
    while time.monotonic() < end and counts["inputs"] < most:
        batch = Batch(reader, seeds, f"{seed} {next(numbers)}")
        read, write = os.pipe()
        if (child := os.fork()) == 0:
            os.close(read)
            with os.fdopen(write, "w") as pipe:
                _child(batch, min(_BATCH, most - counts["inputs"]), end, out, pipe)
            os._exit(0)
        os.close(write)
        last = b""
        with os.fdopen(read, "r") as pipe:
            for line in pipe:
                kind, _, rest = line.rstrip("\n").partition(" ")
                if kind == "at":
                    counts["inputs"] += 1
                    last = rest.encode()
                elif kind == "taken":
                    counts["taken"] += 1
                elif kind == "find":
                    place, _, text = rest.partition(" | ")
                    finds.setdefault(place, text)
        _, status = os.waitpid(child, 0)
        if os.WIFSIGNALED(status):
            name = signal.Signals(os.WTERMSIG(status)).name
            finds.setdefault(f"ended by {name}", f"input {last.decode()} of batch {batch.seed}")
            _keep(out, reader, batch.input(int(last or b"0")))
    return counts, finds


def _child(batch: Batch, size: int, end: float, out: Path, pipe: TextIO) -> None:
    reader = batch.reader
    faulthandler.enable()
    with little_memory():
        for index in range(size):
            if time.monotonic() > end:
                return
            data = batch.input(index)
            print(f"at {index}", file=pipe, flush=True)
            # A library that never returns to Python ends the process; the parent knows the input.
            used = math.ceil(time.process_time())
            resource.setrlimit(resource.RLIMIT_CPU, (used + _MOST_S, resource.RLIM_INFINITY))
            try:
                if outcome(reader, data) is None:
                    print("taken", file=pipe, flush=True)
            except (Exception, TooSlowError) as error:
                path = _keep(out, reader, data)
                place = f"{type(error).__name__} at {_place(error)}"
                print(
                    f"find {place} | {path.name}: {' '.join(str(error).split())[:160]}", file=pipe, flush=True
                )


def _place(error: BaseException) -> str:
    """Return where an exception left the package: the innermost of its lines in the traceback."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [one for one in frames if "/irt/" in one.filename] or frames
    return f"{Path(own[-1].filename).name}:{own[-1].lineno} {own[-1].name}"


def _keep(out: Path, reader: Reader, data: bytes) -> Path:
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{reader.name}-{hashlib.sha256(data).hexdigest()[:8]}"
    path.write_bytes(data)
    return path


if __name__ == "__main__":
    sys.exit(main())
