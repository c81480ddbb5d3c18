"""Work to processes: each gets a copy of the files that it may see, in a fresh folder; files come back."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path

from irt.errors import IrtError
from irt.workers import FAILED, Files

#: What a process inherits from the environment: where programs and packages are, and no more.
_INHERITED = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "HOME", "LANG", "LC_ALL", "SYSTEMROOT", "TMPDIR")
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Longest that a process may take (s).
PATIENCE_S = 3600.0


def run_module(
    module: str, files: Mapping[str, bytes], words: Sequence[str] = (), started: Started | None = None
) -> Files:
    """Run ``python -m module FOLDER OUT WORDS`` on files in a fresh folder, and return what it wrote.

    Where it fails, the files are one, ``failed.json``, with its last words.

    Parameters
    ----------
    module : str
        Full name.
    files : mapping of name to bytes
        What the process may see; a name may hold a folder.
    words : sequence of str
        Arguments that follow those two.
    started : Started, optional
        Is told of the process, to be able to end it.
    """
    # What the process is told of places is the same every time, and so are the words of an answer.
    with tempfile.TemporaryDirectory(prefix="irt-") as place:
        folder, out = Path(place) / "rig", Path(place) / "out"
        for path in (folder, out):
            path.mkdir()
        for name, data in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        command = [sys.executable, "-m", module, folder.name, out.name, *words]
        failure = _run(command, place, started or Started())
        if failure is not None:
            return {FAILED: json.dumps({"error": failure}).encode()}
        return {path.name: path.read_bytes() for path in sorted(out.iterdir())}


class Started:
    """The processes that run, so that they, and no others, can be ended."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()
        self._stopped = False

    def start(self, command: Sequence[str], place: str) -> subprocess.Popen[str]:
        """Start a process, unless all were ended."""
        with self._lock:
            if self._stopped:
                raise IrtError("stopped")
            process = subprocess.Popen(
                list(command),
                cwd=place,
                env=environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                start_new_session=True,
            )
            self._running.add(process)
            return process

    def ended(self, process: subprocess.Popen[str]) -> None:
        """Forget a process that has ended."""
        with self._lock:
            self._running.discard(process)

    def stop(self) -> None:
        """End all that run, and let no other start."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.kill()


class LocalWorkers:
    """Runs so many processes at a time on this machine.

    Parameters
    ----------
    jobs : int
        How many.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def each(
        self, module: str, inputs: Mapping[str, Files], words: Sequence[str] = ()
    ) -> Generator[tuple[str, Files]]:
        """Yield (name, files written) as work gets done; Ctrl-C ends the processes first."""
        started = Started()
        with ThreadPoolExecutor(self._jobs) as pool:
            tasks: dict[Future[Files], str] = {
                pool.submit(run_module, module, files, words, started): name for name, files in inputs.items()
            }
            try:
                for done in as_completed(tasks):
                    yield tasks[done], done.result()
            finally:
                started.stop()
                pool.shutdown(cancel_futures=True)


def environment() -> dict[str, str]:
    """Return what a process is told by its environment: one thread, and where programs and packages are."""
    kept = {name: os.environ[name] for name in _INHERITED if name in os.environ}
    # The process starts in another folder, where a relative path leads nowhere.
    paths = [str(Path(__file__).resolve().parents[2])]
    paths += [str(Path(one).resolve()) for one in kept.get("PYTHONPATH", "").split(os.pathsep) if one]
    told = {"PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)), "MPLBACKEND": "agg"}
    return {**kept, **told, **dict.fromkeys(_ONE_THREAD, "1")}


def files_of(folder: Path, pattern: str = "*") -> Files:
    """Return the files of a folder by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob(pattern)) if path.is_file()}


def _run(command: Sequence[str], place: str, started: Started) -> str | None:
    """Run a process; return its last words where it failed."""
    process = started.start(command, place)
    try:
        _, said = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f"took longer than {PATIENCE_S:g} s"
    finally:
        started.ended(process)
    if process.returncode == 0:
        return None
    lines = said.strip().splitlines()
    return lines[-1] if lines else f"ended with exit status {process.returncode}"
