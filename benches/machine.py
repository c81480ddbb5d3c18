"""Where something was measured."""

import datetime
import json
import os
import platform
import shutil
import subprocess


def machine() -> str:
    """Name the processor, its cores and the day, for the line under a table."""
    model = platform.processor() or platform.machine()
    if shutil.which("lscpu"):
        fields = json.loads(subprocess.check_output(["lscpu", "--json"]))["lscpu"]
        model = next((field["data"] for field in fields if field["field"] == "Model name:"), model)
    return f"{model}, {os.cpu_count()} cores, {datetime.datetime.now(tz=datetime.UTC).date()}"
