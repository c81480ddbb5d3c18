"""One input to one reader: success or a refusal of one line are fine, all else is a find."""

from __future__ import annotations

import resource
import shutil
import signal
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from readers import Reader

from irt.errors import IrtError

#: Processor time of one input [s], and memory beyond what the process has [bytes].
MOST_S, MOST_BYTES = 2.0, 512 * 2**20
#: Where files are written: in memory, where the machine has such a place.
_SCRATCH = next((place for place in ("/dev/shm",) if Path(place).is_dir()), None)


class TooSlowError(BaseException):
    """A reader took too long; no handler of exceptions takes it for one of its own."""


def outcome(reader: Reader, data: bytes) -> str | None:
    """Read a file, and return the line with which it was refused, None where it was not.

    Any other exception passes; so does `TooSlowError`.
    """
    folder = Path(tempfile.mkdtemp(dir=_SCRATCH))
    begin = time.process_time()
    try:
        with _watched(), warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(folder, data)
    except IrtError as error:
        line = str(error)
        assert line, "an empty refusal"
        assert "\n" not in line, f"a refusal of several lines: {line!r}"
        return line
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if time.process_time() - begin > MOST_S:
        raise TooSlowError(f"{time.process_time() - begin:.1f} s")
    return None


@contextmanager
def _watched() -> Iterator[None]:
    """Raise `TooSlowError` in the block once it has used twice its processor time."""

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise TooSlowError(f"more than {2.0 * MOST_S:g} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, 2.0 * MOST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


@contextmanager
def little_memory() -> Iterator[None]:
    """Let this process have no more than `MOST_BYTES` beyond what it has."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_BYTES, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
