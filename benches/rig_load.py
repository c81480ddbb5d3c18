"""Measure the rig under attack and under load, and write the tables of docs/reliability.md.

    python benches/rig_load.py [--stops 40] [--busy 8] [--fifo 50] [--together 2]

- ``rig_attacks``: each attack of ``tests/rig/floods.py`` on a rig that plays, and SIGTERM 4 s later;
- ``rig_stops``: SIGTERM of a rig that plays, while other processes keep all cores busy.

Each rig has a private network namespace, which requires root.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from machine import machine
from rig_faults import ROOT, observe
from write_table import fill

# The module is beside the tests that use it.
from floods import ATTACKS  # type: ignore[import-not-found]  # isort: skip

PAGE = ROOT / "docs" / "reliability.md"
_TESTS = ROOT / "tests" / "rig"
_ATTACKS = (
    *("attack", "sent", "how it ended", "from the signal to the stop [ms]"),
    *("from the stop to rest [ms]", "most memory [MB]"),
)
_STOPS = (
    *("other work", "load", "stops", "from the signal to the stop, median [ms]", "90 %", "longest"),
    *("from the stop to rest, median [ms]", "90 %", "longest"),
)


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Run processes that do nothing but compute."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def attacks(rig: Path, folder: Path) -> Iterator[str]:
    """Yield the lines of the table of attacks."""
    yield from ("| " + " | ".join(_ATTACKS) + " |", "| --- | ---: | --- | ---: | ---: | ---: |")
    for number, (name, what) in enumerate(ATTACKS.items()):
        found = observe(name, folder / f"attack-{number}", rig, _TESTS / "floods.py")
        if "error" in found:
            yield f"| {what} | | FAILED: {found['error']} | | | |"
            continue
        after = (
            f"{1e3 * (found['stopped'] - found['injected']):.0f}" if found["code"] == "signal" else "before"
        )
        yield (
            f"| {what} | {found['sent']:,} | `{found['code']}`: {found['why']} | {after} "
            f"| {1e3 * found['ramp_s']:.0f} | {found['peak_mb']:.0f} |"
        )


def stops(rig: Path, folder: Path, count: int, together: int) -> tuple[list[float], list[float]]:
    """Return the times from a signal to the stop, and from the stop to rest [ms]."""

    def one(number: int) -> dict[str, Any]:
        return observe("SIGTERM", folder / f"stop-{number}", rig)

    with ThreadPoolExecutor(together) as pool:
        found = list(pool.map(one, range(count)))
    for bad in (each for each in found if each.get("code") != "signal"):
        print(f"not counted: {bad.get('error') or bad.get('err')}", file=sys.stderr)
    right = [each for each in found if each.get("code") == "signal"]
    return (
        [1e3 * (each["stopped"] - each["injected"]) for each in right],
        [1e3 * each["ramp_s"] for each in right],
    )


def quantiles(values: list[float]) -> str:
    """Return median, 90 % and the longest of some times, as cells of a table."""
    return " | ".join(f"{one:.0f}" for one in (*np.quantile(values, [0.5, 0.9]), max(values)))


def stop_row(what: str, times: tuple[list[float], list[float]], load: float) -> str:
    """Return a line of the table of stops."""
    return f"| {what} | {load:.0f} | {len(times[0])} | {quantiles(times[0])} | {quantiles(times[1])} |"


def write(name: str, lines: list[str]) -> None:
    """Write a table into the page, and the machine under it."""
    text = "\n".join([*lines, "", f"Measured on {machine()}."])
    PAGE.write_text(fill(PAGE.read_text(encoding="utf-8"), {name: text}), encoding="utf-8")


def measure_stops(rig: Path, folder: Path, args: argparse.Namespace) -> list[str]:
    """Return the table of stops."""
    scheduled = folder / "scheduled"
    scheduled.write_text(f'#!/bin/sh\nexec chrt --fifo {args.fifo} "{rig}" "$@"\n')
    scheduled.chmod(0o755)
    lines = ["| " + " | ".join(_STOPS) + " |", "| --- |" + " ---: |" * (len(_STOPS) - 1)]
    full = f"{args.busy} busy processes"
    for what, count, program in (
        ("none", 0, rig),
        (full, args.busy, rig),
        (f"{full}, the rig under `chrt --fifo {args.fifo}`", args.busy, scheduled),
    ):
        place = folder / f"stops-{len(lines)}"
        place.mkdir()
        with busy(count):
            times = stops(program, place, args.stops, args.together)
            lines.append(stop_row(what, times, os.getloadavg()[0]))
        print(lines[-1], file=sys.stderr)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--stops", type=int, default=40, help="stops for each row (default: 40)")
    parser.add_argument("--busy", type=int, default=8, help="processes that compute (default: 8)")
    parser.add_argument("--fifo", type=int, default=50, help="real-time priority of the rig (default: 50)")
    parser.add_argument("--together", type=int, default=2, help="how many rigs at once (default: 2)")
    parser.add_argument(
        "tables", nargs="*", default=["rig_attacks", "rig_stops"], help="which (default: all)"
    )
    args = parser.parse_args()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    rig = (target / "release" / "rig").resolve()
    with tempfile.TemporaryDirectory() as name:
        if "rig_attacks" in args.tables:
            lines = []
            for line in attacks(rig, Path(name)):
                print(line, file=sys.stderr)
                lines.append(line)
            write("rig_attacks", lines)
        if "rig_stops" in args.tables:
            write("rig_stops", measure_stops(rig, Path(name), args))


if __name__ == "__main__":
    main()
