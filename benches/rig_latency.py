"""Measure the rig's loop with its twin: late ticks, latency into the bag, and lost messages.

    python benches/rig_latency.py [--seconds 600] [--tracker-hz 60] [--fifo 50]

Runs in a private network namespace, which requires root. Prints a row of rig/README.md's table.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from mcap.reader import make_reader

ROOT = Path(__file__).resolve().parents[1]

_MODEL = """
[parameters]
gear_x = { value = 0.07 }
gear_y = { value = 0.06 }
rolling_friction = { value = 3e-4 }
time_scale = { value = 24.0 }
observation_scale = { value = 1.0 }
"""

_SCRIPT = """
ip link set lo up; ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo
"$1" twin --model model.toml & twin=$!
$2 "$1" play run.csv --out bags --arm; status=$?
kill $twin; exit $status
"""


def prepare(folder: Path, seconds: float, tracker_hz: int) -> None:
    text = (ROOT / "rig" / "example" / "rig.toml").read_text(encoding="utf-8")
    text = text.replace("allow_arming = false", "allow_arming = true")
    # Here a late tick is counted and does not stop the rig.
    text = text.replace("overrun_s = 0.05", "overrun_s = 2.0").replace("joints_s = 0.1", "joints_s = 2.0")
    text = text.replace("tracker_s = 0.3", "tracker_s = 2.0").replace("stamp_s = 0.5", "stamp_s = 2.0")
    text = text.replace("tracking_error_s = 0.1", "tracking_error_s = 2.0")
    text = text.replace("tracker_hz = 60", f"tracker_hz = {tracker_hz}\nlost = 0.0")
    text = text.replace('reliability = "best_effort"', 'reliability = "reliable"\nfastest_edges_s = 1000.0')
    (folder / "rig.toml").write_text(text)
    (folder / "model.toml").write_text(_MODEL)
    rows = ["t_s,knob_x_rad,knob_y_rad"]
    for i in range(round(seconds / 0.1)):
        t = 0.1 * i
        rows.append(f"{t:.1f},{0.1 * math.sin(1.1 * t)!r},{0.1 * math.sin(0.8 * t)!r}")
    (folder / "run.csv").write_text("\n".join(rows) + "\n")


def points(bag: Path) -> tuple[int, int]:
    """Return the number of points in a bag, and of missing ones between the first and the last."""
    stamps = []
    with bag.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics=["/marble/position"]):
            stamps.append(message.publish_time / 1e9)
    period = sorted(after - before for before, after in itertools.pairwise(stamps))[len(stamps) // 2]
    gaps = [round((after - before) / period) - 1 for before, after in itertools.pairwise(stamps)]
    return len(stamps), sum(gap for gap in gaps if gap > 0)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=600.0, help="how long (default: 600)")
    parser.add_argument("--tracker-hz", type=int, default=60, help="points a second (default: 60)")
    parser.add_argument("--fifo", type=int, help="real-time priority of the rig, as chrt sets it")
    args = parser.parse_args()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    rig = (target / "release" / "rig").resolve()
    words = "" if args.fifo is None else f"chrt --fifo {args.fifo}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder, args.seconds, args.tracker_hz)
        before = os.getloadavg()[0]
        ran = subprocess.run(
            ["unshare", "-n", "bash", "-c", _SCRIPT, "_", rig, words],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if ran.returncode != 0:
            sys.exit(ran.stderr.strip())
        load = (before + os.getloadavg()[0]) / 2
        found = re.search(
            r"(\d+) messages; (\d+) of (\d+) ticks .* worst ([\d.]+) ms; .* ([\d.]+) ms \(p50\), ([\d.]+) ms",
            ran.stdout,
        )
        assert found, ran.stdout
        messages, late, ticks, worst, median, slow = found.groups()
        count, missing = points(folder / "bags" / "run.mcap")
    part = 100.0 * int(late) / int(ticks)
    print(
        f"| {args.seconds:.0f} s, points at {count / args.seconds:.0f} Hz | {words or 'none'} | {load:.1f} "
        f"| {late} of {ticks} ({part:.3f} %), worst {worst} ms | {median} ms, {slow} ms | {messages} "
        f"| {missing} of {count} |"
    )


if __name__ == "__main__":
    main()
