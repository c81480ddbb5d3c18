"""Which code diagnoses the rigs of a proof: version, digest and commit."""

from __future__ import annotations

import functools
import hashlib
import subprocess
from importlib.metadata import version
from pathlib import Path

from irt.errors import IrtError

#: Files of the package's digest: its modules and the engine.
_CODE = ("*.py", "*.so", "*.pyd")
_DIGITS = 12
_ROOT = Path(__file__).parents[1]


@functools.cache
def this_code() -> str:
    """Return version and digest of the running package."""
    total = hashlib.sha256()
    for path in sorted(path for kind in _CODE for path in _ROOT.rglob(kind)):
        total.update(f"{path.relative_to(_ROOT).as_posix()}\0".encode())
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return f"irt {version('labsim-irt')}, code {total.hexdigest()[:_DIGITS]}"


def clean_commit(root: Path = _ROOT) -> str:
    """Return the hash of the commit that the package runs from.

    Raises
    ------
    IrtError
        If it does not run from a git checkout, or tracked files there were changed.
    """
    commit = _git(root, "rev-parse", "HEAD")
    changed = _git(root, "status", "--porcelain", "--untracked-files=no")
    if commit is None or changed is None:
        raise IrtError(f"{root}: no git checkout, and a full proof is of one commit; run it from a checkout")
    if changed:
        name = changed.splitlines()[0][3:]
        raise IrtError(f"{root}: a full proof is of one commit; {name} was changed since: commit it first")
    return commit


def _git(root: Path, *words: str) -> str | None:
    try:
        done = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return done.stdout.rstrip("\n") if done.returncode == 0 else None
