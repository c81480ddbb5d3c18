"""Write the counts of fuzzing into docs/reliability.md.

    make fuzz FUZZ_SECONDS=36000
    python benches/fuzz_counts.py out/fuzz.jsonl

Each line of the file is one reader of one run; the counts of all its runs are added.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from machine import machine
from write_table import fill

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reliability.md"
#: Inputs that each reader is to get.
GOALS = {"Rust": 10**7, "Python": 10**5}


def main() -> None:
    """Fill the block of the page."""
    parser = argparse.ArgumentParser(description="Write the counts of fuzzing into a page.")
    parser.add_argument("summary", type=Path, nargs="?", default=ROOT / "out" / "fuzz.jsonl")
    parser.add_argument("--page", type=Path, default=PAGE, help="page to write to")
    args = parser.parse_args()
    counts = [json.loads(line) for line in args.summary.read_text(encoding="utf-8").splitlines()]
    text = "\n".join([*table(counts), "", f"Measured on {machine()}."])
    args.page.write_text(fill(args.page.read_text(encoding="utf-8"), {"fuzz": text}), encoding="utf-8")


def table(counts: Iterable[dict[str, Any]]) -> list[str]:
    """Return the lines of the table: one for each reader, those in Rust first."""
    sums: dict[tuple[str, str], Counter[str]] = {}
    for one in counts:
        known = sums.setdefault((one["language"], one["reader"]), Counter())
        known.update({name: one[name] for name in ("inputs", "finds", "processor_s") if name in one})
    lines = [
        "| reader | in | inputs | of the goal | finds | processor time for 1000 inputs [s] |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    for language, goal in GOALS.items():
        for (spoken, reader), found in sums.items():
            if spoken == language:
                inputs = found["inputs"]
                # A system without processor times leaves the cell empty.
                cost = f"{1000 * found['processor_s'] / max(inputs, 1):.3g}" if found["processor_s"] else ""
                share = min(1.0, inputs / goal)
                lines.append(
                    f"| {reader} | {language} | {inputs:,} | {share:.1%} | {found['finds']} | {cost} |"
                )
    return lines


if __name__ == "__main__":
    main()
