"""Run modules in local processes, each on a copy of its input files in a fresh folder."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path

from irt.errors import IrtError
from irt.workers import FAILED, Files

#: Environment variables that a process inherits: locations of programs and packages only.
_INHERITED = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "HOME", "LANG", "LC_ALL", "SYSTEMROOT", "TMPDIR")
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
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
    started = started or Started()
    place = _unused_place()
    # Relative paths are the same in every run, so messages that contain them are too.
    process = started.start(place, module, "rig", "out", *words)
    try:
        _fill(place, files)
        started.go(process)
        said = _errors(process, started)
        written = files_of(place / "out")
    finally:
        # The process removes the folder, unless it was killed.
        started.end(process)
        shutil.rmtree(place, ignore_errors=True)
    if process.returncode == 0:
        return written
    lines = said.strip().splitlines()
    failure = lines[-1] if lines else f"ended with exit status {process.returncode}"
    return {FAILED: json.dumps({"error": failure}).encode()}


def _unused_place() -> Path:
    """Return a path for a temporary folder, which is not made.

    Raises
    ------
    IrtError
        If there is no place for temporary files.
    """
    try:
        return Path(tempfile.gettempdir()) / f"irt-{secrets.token_hex(8)}"
    except OSError as error:
        raise IrtError(f"{error.strerror or error}; TMPDIR names another place") from error


def _fill(place: Path, files: Mapping[str, bytes]) -> None:
    """Make the temporary folder, with these files in ``rig`` and an empty ``out``.

    Raises
    ------
    IrtError
        If they cannot be written.
    """
    try:
        place.mkdir(mode=0o700)
        for folder in ("rig", "out"):
            (place / folder).mkdir()
        for name, data in files.items():
            path = place / "rig" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    except OSError as error:
        raise IrtError(
            f"{place}: cannot be written: {error.strerror or error}; TMPDIR names another place"
        ) from error


class Started:
    """Registry of running processes, each with the pipe at whose end it ends; ends exactly those."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: dict[subprocess.Popen[str], int] = {}
        self._stopped = False

    def start(self, place: Path, module: str, *words: str) -> subprocess.Popen[str]:
        """Start a process that waits for `go`, unless `stop` was called.

        From now on it removes the folder ``place``, which is not there yet, if this process ends.
        """
        with self._lock:
            if self._stopped:
                raise IrtError("stopped")
            # The process ends when the other end of this pipe closes, even where this process is killed.
            read, write = os.pipe()
            try:
                process = subprocess.Popen(
                    # The folder of the start is on no path of modules.
                    [sys.executable, "-P", "-m", "irt.workers.child", str(place), module, *words],
                    cwd=place.parent,
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

    def go(self, process: subprocess.Popen[str]) -> None:
        """Let a process run its module: its folder is filled."""
        # Where the process has ended already, its exit status says so.
        with self._lock, suppress(KeyError, BrokenPipeError):
            os.write(self._running[process], b"\n")

    def release(self, process: subprocess.Popen[str]) -> None:
        """Let a process end its module, remove its folder and end."""
        with self._lock, suppress(KeyError):
            os.close(self._running.pop(process))

    def end(self, process: subprocess.Popen[str]) -> None:
        """Release a process, and wait for its end."""
        self.release(process)
        with process:
            pass

    def stop(self) -> None:
        """Release all processes, and prevent further starts."""
        with self._lock:
            self._stopped = True
            while self._running:
                os.close(self._running.popitem()[1])


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


def _errors(process: subprocess.Popen[str], started: Started) -> str:
    """Wait until the module of a process is done, and return its error output."""
    assert process.stderr is not None
    late = threading.Event()

    def give_up() -> None:
        late.set()
        started.release(process)

    patience = threading.Timer(PATIENCE_S, give_up)
    patience.daemon = True
    patience.start()
    try:
        said = process.stderr.read()
    finally:
        patience.cancel()
    return f"took longer than {PATIENCE_S:g} s" if late.is_set() else said
