"""Run the proof by transfer: controllers made on fitted models, tried on concealed rigs.

Its concealed rigs and its controller are not part of the installed package: they are `benches/transfer.py`
and `examples/mpc.py` of the checkout from which the package runs.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from irt.errors import IrtError
from irt.extras import require

_CHECKOUT = Path(__file__).resolve().parents[3]


def prove(out: Path, page: Path, *, rigs: int | None, jobs: int, checkout: Path = _CHECKOUT) -> None:
    """Make the rigs, fits and controllers that a folder lacks, try the controllers, and write the page.

    What is done is printed line by line.

    Parameters
    ----------
    out : Path
        Folder of all that is made; what is there is kept.
    page : Path
        Page to write.
    rigs : int, optional
        Number of concealed rigs; by default one of each kind.
    jobs : int
        Processes at the same time.
    checkout : Path
        Root of the project's source tree.

    Raises
    ------
    IrtError
        If the package does not run from a checkout, an extra is missing, or a step fails.
    """
    for package in ("mujoco", "gymnasium"):
        require(package, "irt prove --transfer")
    script = checkout / "benches" / "transfer.py"
    if not script.is_file():
        raise IrtError(
            f"--transfer: {script} is not there; run it from a checkout of the project, "
            "which has the concealed rigs and the controller"
        )
    words = [str(out), "--page", str(page), "--jobs", f"{jobs}", "--policies", "0"]
    if rigs is not None:
        words += ["--rigs", f"{rigs}"]
    done = subprocess.run(
        [sys.executable, str(script), *words],
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"it ended with exit status {done.returncode}"]
        raise IrtError(f"the proof by transfer: {lines[-1].removeprefix(f'{script.name}: ')}")
