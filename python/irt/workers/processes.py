"""Run modules in local processes, each on a copy of its input files in a fresh folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path

from irt.errors import IrtError
from irt.workers import FAILED, Files

#: Environment variables that a process inherits: locations of programs and packages only.
_INHERITED = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "HOME", "LANG", "LC_ALL", "SYSTEMROOT", "TMPDIR")
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Timeout of a process [s].
PATIENCE_S = 3600.0


def run_module(
    module: str, files: Mapping[str, bytes], words: Sequence[str] = (), started: Started | None = None
) -> Files:
    """Run ``python -m module FOLDER OUT WORDS`` on files in a fresh folder, and return the files it wrote.

    If the process fails, the only file is ``failed.json`` with the last line of its error output.

    Parameters
    ----------
    module : str
        Full name of the module.
    files : mapping of name to bytes
        Input files; a name may include a folder.
    words : sequence of str
        Further arguments.
    started : Started, optional
        Registry of the process, through which it can be ended.
    """
    # Relative paths are the same in every run, so messages that contain them are too.
    with _filled(files) as place:
        folder, out = Path(place) / "rig", Path(place) / "out"
        command = [sys.executable, "-m", "irt.workers.child", place, module, folder.name, out.name, *words]
        failure = _run(command, place, started or Started())
        if failure is not None:
            return {FAILED: json.dumps({"error": failure}).encode()}
        return {path.name: path.read_bytes() for path in sorted(out.iterdir())}


@contextmanager
def _filled(files: Mapping[str, bytes]) -> Iterator[str]:
    """Yield a temporary folder with these files in ``rig``, and an empty ``out``.

    Raises
    ------
    IrtError
        If they cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="irt-") as place:
        folder, out = Path(place) / "rig", Path(place) / "out"
        try:
            for path in (folder, out):
                path.mkdir()
            for name, data in files.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(data)
        except OSError as error:
            raise IrtError(
                f"{place}: cannot be written: {error.strerror or error}; TMPDIR names another place"
            ) from error
        yield place


class Started:
    """Registry of running processes, to end exactly those."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: dict[subprocess.Popen[str], int] = {}
        self._stopped = False

    def start(self, command: Sequence[str], place: str) -> subprocess.Popen[str]:
        """Start a process, unless `stop` was called."""
        with self._lock:
            if self._stopped:
                raise IrtError("stopped")
            # The process ends when the other end of this pipe closes, even where this process is killed.
            read, write = os.pipe()
            try:
                process = subprocess.Popen(
                    list(command),
                    cwd=place,
                    env=environment(),
                    stdin=read,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    text=True,
                    errors="replace",
                    start_new_session=True,
                )
            except BaseException:
                os.close(write)
                raise
            finally:
                os.close(read)
            self._running[process] = write
            return process

    def ended(self, process: subprocess.Popen[str]) -> None:
        """Remove a process that has ended."""
        with self._lock:
            os.close(self._running.pop(process))

    def stop(self) -> None:
        """End all running processes, and prevent further starts."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.kill()


class LocalWorkers:
    """Runs processes on this machine.

    Parameters
    ----------
    jobs : int
        Number of processes at a time.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def each(
        self, module: str, inputs: Mapping[str, Files], words: Sequence[str] = ()
    ) -> Generator[tuple[str, Files]]:
        """Yield (name, files written) for each completed job; Ctrl-C ends the processes first."""
        started = Started()
        with ThreadPoolExecutor(self._jobs) as pool:
            tasks: dict[Future[Files], str] = {}
            try:
                # Ctrl-C may come while the first processes run and others are handed in.
                for name, files in inputs.items():
                    tasks[pool.submit(run_module, module, files, words, started)] = name
                for done in as_completed(tasks):
                    yield tasks[done], done.result()
            finally:
                started.stop()
                pool.shutdown(cancel_futures=True)


def environment() -> dict[str, str]:
    """Return the environment of a process: one thread, and the locations of programs and packages."""
    kept = {name: os.environ[name] for name in _INHERITED if name in os.environ}
    # The process starts in another folder, so relative paths must be resolved here.
    paths = [str(Path(__file__).resolve().parents[2])]
    paths += [str(Path(one).resolve()) for one in kept.get("PYTHONPATH", "").split(os.pathsep) if one]
    own = {"PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)), "MPLBACKEND": "agg"}
    return {**kept, **own, **dict.fromkeys(_ONE_THREAD, "1")}


def files_of(folder: Path, pattern: str = "*") -> Files:
    """Return the files of a folder by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob(pattern)) if path.is_file()}


def _run(command: Sequence[str], place: str, started: Started) -> str | None:
    """Run a process; return the last line of its error output if it failed, else None."""
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
