"""Fixtures: the rig's binary, and private network namespaces."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

_INSIDE = 'ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'

#: Runs a command in its own namespace.
Inside = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def rig() -> Path:
    """Return the rig's binary, as `make test` builds it."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    binary = target / "release" / "rig"
    if not binary.exists():
        pytest.skip("the rig is not built: 'cargo build --package rig --release' does it")
    return binary


def _namespaces() -> list[str] | None:
    """Return the command that creates a private network on this machine, if there is one."""
    for words in (["unshare", "-n", "-m"], ["unshare", "-r", "-n", "-m"]):
        command = [*words, "sh", "-c", _INSIDE, "_", "true"]
        if (
            shutil.which("unshare")
            and subprocess.run(command, capture_output=True, check=False).returncode == 0
        ):
            return words
    return None


@pytest.fixture(scope="session")
def inside() -> Inside:
    """Run a command in its own network and mount namespaces; skip where they are not permitted."""
    words = _namespaces()
    if words is None:
        pytest.skip("private network namespaces (unshare -n, ip) are not permitted or not there")

    def run(
        *command: str | Path, timeout: float = 120.0, cwd: Path | None = None
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*words, "sh", "-c", _INSIDE, "_", *map(str, command)],
            cwd=cwd,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def cyclone() -> None:
    """Skip if Cyclone DDS is missing."""
    if importlib.util.find_spec("cyclonedds") is None:
        pytest.skip("cyclonedds is not installed (extra 'ros')")
