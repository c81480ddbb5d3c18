"""Each fault ends in its stop or its refusal, with an independent tracker and two independent arms."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest
from faults import FAULTS
from laboratory import Fault

HERE = Path(__file__).resolve().parent
Inside = Callable[..., CompletedProcess[str]]

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("cyclone")]

#: Number of laboratories at once.
TOGETHER = 4


def observe(fault: str, folder: Path, rig: Path, inside: Inside) -> dict[str, Any]:
    folder.mkdir()
    ran = inside(sys.executable, HERE / "faults.py", fault, folder, rig)
    if ran.returncode != 0:
        return {"fault": fault, "error": ran.stderr.strip()[-2000:]}
    found: dict[str, Any] = json.loads(ran.stdout.strip().splitlines()[-1])
    return found


def wrong(fault: Fault, found: dict[str, Any]) -> list[str]:
    """Return the failed checks."""
    checks = {f"it failed: {found.get('error')}": "error" not in found}
    if fault.killed:
        checks["all but the last second is in the bag"] = (
            found.get("last", 0.0) > found.get("injected", 1e12) - 1.0
        )
    elif fault.abandoned:
        checks |= {
            "it ends": found.get("status") == 1,
            "in one line": len(found.get("err", "").splitlines()) == 1,
            f"with the last command: {found.get('err')}": f"the last command was {fault.abandoned}"
            in found.get("err", ""),
            "it is in the bag": "abandoned" in found.get("codes", []),
            f"the bag is closed: {found.get('bag')}": "was whole" in found.get("bag", ""),
        }
    elif fault.refusal:
        checks |= {
            "it is refused": found.get("status") == 1,
            f"for its reason: {found.get('err')}": fault.refusal in found.get("err", ""),
            "in one line": len(found.get("err", "").splitlines()) == 1,
            "nothing moves": not found.get("code"),
        }
    else:
        full = fault.stop == "recorder"
        checks |= {
            "it is reported": found.get("status") == 1 and fault.stop in found.get("err", ""),
            f"for its reason: {found.get('code')}": full or found.get("code") == fault.stop,
            "it is latched": full or bool(found.get("latched")),
            "at rest": full or bool(found.get("rests")),
            # In ticks of 10 ms, of which a busy machine may be late for some.
            f"in time: {found.get('ramp_ticks')} ticks": full or found.get("ramp_ticks", 99) <= 13,
        }
    return [what for what, right in checks.items() if not right]


def test_each_fault_ends_in_its_stop_or_its_refusal(rig: Path, inside: Inside, tmp_path: Path) -> None:
    folders = {name: tmp_path / f"{number}" for number, name in enumerate(FAULTS)}
    with ThreadPoolExecutor(TOGETHER) as pool:
        found = dict(
            zip(FAULTS, pool.map(lambda name: observe(name, folders[name], rig, inside), FAULTS), strict=True)
        )
    failures = {name: wrong(FAULTS[name], one) for name, one in found.items()}
    # Several laboratories at once keep a small machine busy, and a late process is a fault of its own. Failed
    # ones are therefore repeated alone.
    again = {
        name: observe(name, folders[name].with_name(f"{folders[name].name}-again"), rig, inside)
        for name, what in failures.items()
        if what
    }
    found |= again
    failures = {name: what for name, one in again.items() if (what := wrong(FAULTS[name], one))}
    assert not failures, json.dumps({name: (what, found[name]) for name, what in failures.items()}, indent=1)
