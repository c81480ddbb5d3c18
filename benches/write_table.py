"""Write criterion's results as the table of README.md, between its two markers.

Run by ``make bench`` after ``cargo bench``: every benchmark under ``target/criterion`` becomes one row with
the median of its samples, their spread, and substeps per second where the benchmark counts them.
"""

import argparse
import datetime
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- bench:engine -->", "<!-- /bench -->"
UNITS = (("s", 1e9), ("ms", 1e6), ("µs", 1e3), ("ns", 1.0))


def significant(number: float) -> str:
    """Return a number with three significant digits and no exponent."""
    return f"{float(f'{number:.3g}'):g}"


@dataclass(frozen=True)
class Timing:
    """One benchmark's samples, summed up."""

    name: str
    median: float
    """Time of one iteration [ns]."""
    spread: float
    """1.4826 x the median absolute deviation [ns]: a robust standard deviation."""
    substeps: int | None
    """Substeps simulated in one iteration, where the benchmark counts them."""

    def row(self) -> str:
        """Return this benchmark's row of the table."""
        unit, scale = next((u, s) for u, s in UNITS if self.median >= s or s == 1.0)
        time = f"{significant(self.median / scale)} {unit}"
        spread = f"± {100 * self.spread / self.median:.1f} %"
        rate = f"{significant(1e3 * self.substeps / self.median)} M" if self.substeps else ""
        return f"| {self.name} | {time} | {spread} | {rate} |"


def read_timings(criterion: Path) -> list[Timing]:
    """Read every benchmark's latest result under criterion's output folder, sorted by name."""
    timings = []
    for path in criterion.glob("**/new/benchmark.json"):
        benchmark = json.loads(path.read_text(encoding="utf-8"))
        estimates = json.loads(path.with_name("estimates.json").read_text(encoding="utf-8"))
        timings.append(
            Timing(
                name=benchmark["full_id"],
                median=estimates["median"]["point_estimate"],
                spread=estimates["median_abs_dev"]["point_estimate"],
                substeps=(benchmark["throughput"] or {}).get("Elements"),
            )
        )
    return sorted(timings, key=lambda timing: natural_order(timing.name))


def natural_order(name: str) -> list[tuple[str, int]]:
    """Return a sort key under which the numbers in names count as numbers: 64 before 1024."""
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", name)]


def machine() -> str:
    """Name the processor, its cores and the day, for the line under the table."""
    model = platform.processor() or platform.machine()
    if shutil.which("lscpu"):
        fields = json.loads(subprocess.check_output(["lscpu", "--json"]))["lscpu"]
        model = next((field["data"] for field in fields if field["field"] == "Model name:"), model)
    return f"{model}, {os.cpu_count()} cores, {datetime.datetime.now(tz=datetime.UTC).date()}"


def table(timings: Iterable[Timing], where: str) -> str:
    """Return the Markdown table, with the machine it was measured on beneath."""
    head = "| benchmark | median | spread | substeps/s |\n| --- | ---: | ---: | ---: |"
    rows = "\n".join(timing.row() for timing in timings)
    return f"{head}\n{rows}\n\nMeasured on {where}. Spread: robust standard deviation of the samples."


def main() -> int:
    """Replace the table of the page; return the exit status."""
    parser = argparse.ArgumentParser(description="Write criterion's results into a page as a table.")
    parser.add_argument(
        "--criterion", type=Path, default=ROOT / "target" / "criterion", help="results to read"
    )
    parser.add_argument("--page", type=Path, default=ROOT / "README.md", help="page to write to")
    arguments = parser.parse_args()
    timings = read_timings(arguments.criterion)
    if not timings:
        print(f"no results under {arguments.criterion}: run 'cargo bench' first", file=sys.stderr)
        return 1
    page = arguments.page.read_text(encoding="utf-8")
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        print(f"{arguments.page} has no {BEGIN} ... {END} to write between", file=sys.stderr)
        return 1
    text = f"{before}{BEGIN}\n\n{table(timings, machine())}\n\n{END}{after}"
    arguments.page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
