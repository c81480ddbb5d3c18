"""Description and load of the machine of a measurement."""

import datetime
import json
import os
import platform
import shutil
import subprocess
import time
from pathlib import Path


def machine() -> str:
    """Return processor, date and number of cores, for the line under a table."""
    model = platform.processor() or platform.machine()
    if shutil.which("lscpu"):
        fields = json.loads(subprocess.check_output(["lscpu", "--json"]))["lscpu"]
        model = next((field["data"] for field in fields if field["field"] == "Model name:"), model)
    return f"{model}, {datetime.datetime.now(tz=datetime.UTC).date()}, {os.cpu_count()} cores"


def busy_cores(seconds: float = 2.0) -> float:
    """Return the number of busy cores while this process sleeps; 0 if the system does not report it."""
    stat = Path("/proc/stat")
    if not stat.exists():
        return 0.0
    before = _ticks(stat)
    time.sleep(seconds)
    total, idle = (after - before for after, before in zip(_ticks(stat), before, strict=True))
    return (os.cpu_count() or 1) * (1 - idle / total) if total else 0.0


def _ticks(stat: Path) -> tuple[int, int]:
    """Return the time of all cores since boot, and their idle and waiting time [ticks]."""
    user, nice, system, idle, waiting, *others = map(int, stat.read_text().split("\n", 1)[0].split()[1:9])
    return user + nice + system + idle + waiting + sum(others), idle + waiting
