"""Stop one thread of a process, as a thread that hangs: the others go on."""

from __future__ import annotations

import ctypes
import os
import threading
from pathlib import Path

_ATTACH = 16
#: Wait for a thread that is no child of this process, too.
_WALL = 0x40000000


def thread_of(process: int, name: str) -> int:
    """Return the number of the thread whose name begins so."""
    found = [
        int(task.name)
        for task in Path(f"/proc/{process}/task").iterdir()
        if (task / "comm").read_text(encoding="utf-8").startswith(name)
    ]
    (thread,) = found
    return thread


def freeze(process: int, thread: int) -> None:
    """Stop a thread of a process until this process ends."""
    system = ctypes.CDLL(None, use_errno=True)
    if system.ptrace(_ATTACH, thread, None, None) != 0:
        raise OSError(ctypes.get_errno(), f"thread {thread} cannot be stopped")
    os.waitpid(thread, _WALL)
    if thread != process:
        # A process ends only after the end of its stopped threads was waited for.
        threading.Thread(target=os.waitpid, args=(thread, _WALL), daemon=True).start()
