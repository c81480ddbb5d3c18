"""Run tests of the base with the oldest packages that pyproject.toml allows, on the oldest Python.

    make oldest

The packages are installed into a folder of their own. Their warnings do not count: old versions warn of new
Pythons and of each other.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
import venv
from importlib import metadata
from pathlib import Path

from sbom import ROOT

#: Tests that need no extra, and between them each package of the base.
TESTS = (
    *(f"tests/unit/test_{name}.py" for name in ("engine", "files", "maze", "model", "posterior", "predict")),
    *(f"tests/unit/test_{name}.py" for name in ("init", "in_memory", "recording", "rig", "wrong_types")),
    *("tests/unit/checking", "tests/unit/export", "tests/unit/fitting", "tests/unit/report"),
    *(f"tests/unit/tuning/test_{name}.py" for name in ("evolution", "library", "tunenet")),
    *(
        f"tests/cli/test_{name}.py"
        for name in ("check", "diagnose", "drive", "evaluate", "simulate", "suggest")
    ),
)
_TOOLS = ("hypothesis", "pytest", "pytest-xdist")
_HOW = (
    *("-q", "-n", "2", "-p", "no:cacheprovider", "-m", "not slow", "--hypothesis-profile", "ci"),
    *("-W", "ignore::DeprecationWarning", "-W", "ignore::PendingDeprecationWarning"),
)


def oldest(requirements: list[str]) -> list[str]:
    """Return requirements with each lower bound as the only version."""
    pinned = [re.sub(r">=\s*([\w.]+).*", r"==\1", one) for one in requirements]
    unbound = [one for one in pinned if "==" not in one]
    assert not unbound, f"{unbound}: no lower bound"
    return pinned


def main() -> int:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    least = project["requires-python"].removeprefix(">=")
    if f"{sys.version_info.major}.{sys.version_info.minor}" != least:
        print(f"make: old packages have no wheels for this Python: 'make PYTHON=python{least} oldest'")
        return 1
    with tempfile.TemporaryDirectory() as name:
        venv.create(name, with_pip=True)
        python = Path(name) / "bin" / "python"
        words = ("--quiet", "--disable-pip-version-check", "--only-binary", ":all:")
        subprocess.run(
            [python, "-m", "pip", "install", *words, *oldest(project["dependencies"]), *_TOOLS], check=True
        )
        # The sources are tested as they are; their version is known from what `make build` has installed.
        about = metadata.distribution("labsim-irt")
        folder = f"labsim_irt-{about.version}.dist-info"
        site = sysconfig.get_path("purelib", vars={"base": name})
        shutil.copytree(str(about.locate_file(folder)), Path(site) / folder)
        environment = {**os.environ, "PYTHONPATH": str(ROOT / "python")}
        return subprocess.run(
            [python, "-m", "pytest", *_HOW, *TESTS], cwd=ROOT, env=environment, check=False
        ).returncode


if __name__ == "__main__":
    sys.exit(main())
