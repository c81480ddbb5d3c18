"""Write the table of faults: injection, outcome, and time to rest of the arms.

python benches/rig_faults.py [--together 1] [--out faults.md]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "rig"))

# The module is beside the tests that use it.
from faults import FAULTS  # type: ignore[import-not-found]  # noqa: E402

_INSIDE = 'ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'


def observe(
    fault: str, folder: Path, rig: Path, script: Path = ROOT / "tests" / "rig" / "faults.py"
) -> dict[str, Any]:
    folder.mkdir()
    command = [
        "unshare",
        "-n",
        "-m",
        "sh",
        "-c",
        _INSIDE,
        "_",
        sys.executable,
        str(script),
        fault,
        str(folder),
        str(rig),
    ]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        return {"error": ran.stderr.strip().splitlines()[-1]}
    found: dict[str, Any] = json.loads(ran.stdout.strip().splitlines()[-1])
    return found


def row(name: str, what: str, found: dict[str, Any]) -> str:
    if "error" in found:
        return f"| {name} | {what} | FAILED: {found['error']} | | |"
    if found["status"] == -9:
        lost = max(0.0, found["injected"] - found["last"])
        kept = found["bag"].split(" are in")[0]
        return f"| {name} | {what} | {kept} | | the last {1e3 * lost:.0f} ms are lost |"
    if "code" not in found:
        why = found["err"].splitlines()[-1].removeprefix("rig: ")
        return f"| {name} | {what} | {why if why.startswith('stopped') else f'refused: {why}'} | | |"
    rest = 1e3 * (found["stopped"] - found["injected"] + found["ramp_s"])
    ramp = f"{1e3 * found['ramp_s']:.0f} ms from {found['rate_before']:.2f} rad/s"
    after = f"{rest:.0f} ms" if rest > 0.0 else ""  # no valid times after a clock step
    return f"| {name} | {what} | `{found['code']}`: {found['why']} | {ramp} | {after} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--together", type=int, default=1, help="how many at once (default: 1)")
    parser.add_argument("--out", type=Path, help="the table (default: standard output)")
    parser.add_argument("faults", nargs="*", default=list(FAULTS), help="which (default: all)")
    args = parser.parse_args()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    rig = (target / "release" / "rig").resolve()
    lines = [
        "| fault | injected | how it ended | to rest from the time-out | from the fault |",
        "| --- | --- | --- | --- | ---: |",
    ]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(args.together) as pool:
        places = [Path(folder) / f"{number}" for number in range(len(args.faults))]
        found = pool.map(lambda name, place: observe(name, place, rig), args.faults, places)
        for name, one in zip(args.faults, found, strict=True):
            lines.append(row(name, FAULTS[name].what, one))
            print(lines[-1], file=sys.stderr)
    text = "\n".join(lines) + "\n"
    if args.out is None:
        sys.stdout.write(text)
    else:
        args.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
