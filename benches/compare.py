"""Compare this project's engines and fits with those of others in one run, into ``target/peers.json``.

    python benches/compare.py && python benches/write_table.py

Needs the packages of ``benches/requirements.txt``; missing ones are skipped and listed.
"""

import argparse
import importlib.metadata
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from machine import busy_cores, machine
from peers import fit_task, fits, growth, throughput
from peers.workload import PAPER_ROLLOUTS, spread, substeps

ROOT = Path(__file__).resolve().parents[1]
#: Name on the page, and distribution for the version.
PACKAGES = {
    "PyBullet": "pybullet",
    "MuJoCo": "mujoco",
    "mujoco.sysid": "mujoco",
    "scipy least_squares": "scipy",
    "pycma": "cma",
}


def progress(text: str) -> None:
    """Print progress to stderr."""
    print(text, file=sys.stderr, flush=True)


def versions() -> dict[str, str]:
    """Return the versions of installed peers."""
    installed = {}
    for name, package in PACKAGES.items():
        try:
            installed[name] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            progress(f"{name}: not installed; see benches/requirements.txt")
    return installed


def measure(rounds: int, starts: int, largest: int) -> dict[str, Any]:
    """Run all measurements; return the raw samples as JSON content."""
    busy = busy_cores()
    absent: dict[str, dict[str, str]] = {"engines": {}, "fits": {}}
    # First, while this process is small, because a child's peak memory includes its parent's.
    grown = growth.measure(largest, progress)
    engines = throughput.contenders(absent["engines"])
    speeds = throughput.measure(engines, rounds, progress)
    racers = fits.methods(absent["fits"])
    races = [fits.race(drive, racers, starts, progress) for drive in fit_task.DRIVES]
    return {
        "machine": machine(),
        "busy": max(busy, busy_cores()),
        "versions": versions(),
        "absent": absent,
        "paper": {"rollouts": PAPER_ROLLOUTS, "substeps": substeps(spread(PAPER_ROLLOUTS))},
        "throughput": [asdict(one) for one in speeds],
        "growth": [asdict(one) for one in grown],
        "fit_noise": fit_task.NOISE,
        "fits": [asdict(one) for one in races],
    }


def main() -> None:
    """Measure, and write the samples."""
    parser = argparse.ArgumentParser(description="Compare engines and fits with those of others.")
    parser.add_argument("--rounds", type=int, default=9, help="repetitions of each engine (default: 9)")
    parser.add_argument("--starts", type=int, default=10, help="start points of each fit (default: 10)")
    parser.add_argument(
        "--largest", type=int, default=10**6, help="rollouts to grow to by tens (default: 1000000)"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "peers.json", help="file to write")
    options = parser.parse_args()
    results = measure(options.rounds, options.starts, options.largest)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    unfinished = options.out.with_suffix(".part")
    unfinished.write_text(json.dumps(results, indent=1), encoding="utf-8")
    unfinished.replace(options.out)
    progress(f"wrote {options.out}")


if __name__ == "__main__":
    main()
