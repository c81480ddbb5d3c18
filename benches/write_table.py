"""Write measurements into docs/benchmarks.md, between ``<!-- bench:NAME -->`` and ``<!-- /bench -->``.

Run by ``make bench``. The blocks by NAME:

- ``engine``: every benchmark under ``target/criterion``, with the median of its samples, their spread, and
  substeps per second if it counts them;
- ``effects``: criterion's group of that name, each effect in multiples of its benchmark ``base``;
- ``peers``, ``growth``, ``fit``: measurements of ``compare.py``;
- ``tracking``: measurements of ``track.py``.

A block without measurements is not changed.
"""

import argparse
import json
import re
import sys
from pathlib import Path

from machine import machine
from table.criterion import effects_table, engine_table, read_timings
from table.peers import fit_table, growth_table, peers_table
from table.tracking import tracking_table

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "benchmarks.md"
BLOCK = re.compile(r"(?P<begin><!-- bench:(?P<name>\w+) -->).*?(?P<end><!-- /bench -->)", re.DOTALL)


PEERS = {"peers": peers_table, "growth": growth_table, "fit": fit_table}
CRITERION = {"engine": engine_table, "effects": effects_table}


def tables(names: set[str], criterion: Path, peers: Path, tracking: Path) -> dict[str, str]:
    """Return the texts of the named blocks with measurements."""
    timings, where = read_timings(criterion), machine()
    found = {name: table(timings, where) for name, table in CRITERION.items() if name in names}
    if names & PEERS.keys() and peers.exists():
        results = json.loads(peers.read_text(encoding="utf-8"))
        found |= {name: table(results) for name, table in PEERS.items() if name in names}
    if "tracking" in names and tracking.exists():
        found["tracking"] = tracking_table(json.loads(tracking.read_text(encoding="utf-8")))
    return {name: text for name, text in found.items() if text is not None}


def fill(page: str, texts: dict[str, str]) -> str:
    """Return a page with the blocks of these texts replaced."""

    def block(found: re.Match[str]) -> str:
        text = texts.get(found["name"])
        return found[0] if text is None else f"{found['begin']}\n\n{text}\n\n{found['end']}"

    return BLOCK.sub(block, page)


def main() -> int:
    """Replace the tables of the page; return the exit status."""
    parser = argparse.ArgumentParser(description="Write measurements into a page as tables.")
    parser.add_argument(
        "--criterion", type=Path, default=ROOT / "target" / "criterion", help="criterion's results"
    )
    parser.add_argument(
        "--peers", type=Path, default=ROOT / "target" / "peers.json", help="results of compare.py"
    )
    parser.add_argument(
        "--tracking", type=Path, default=ROOT / "target" / "tracking.json", help="results of track.py"
    )
    parser.add_argument("--page", type=Path, default=PAGE, help="page to write to")
    arguments = parser.parse_args()
    page = arguments.page.read_text(encoding="utf-8")
    names = {found["name"] for found in BLOCK.finditer(page)}
    if not names:
        print(f"{arguments.page} has no <!-- bench:NAME --> ... <!-- /bench --> to fill", file=sys.stderr)
        return 1
    texts = tables(names, arguments.criterion, arguments.peers, arguments.tracking)
    if not texts:
        print(f"nothing measured for {arguments.page}: run 'cargo bench' first", file=sys.stderr)
        return 1
    arguments.page.write_text(fill(page, texts), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
