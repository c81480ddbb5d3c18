"""Run a module in this process as ``python -m`` does, until the process that asked for it has gone.

    python -m irt.workers.child FOLDER MODULE WORDS

FOLDER is the temporary folder of this process. Standard input is a pipe whose other end the parent holds. A
parent that is killed can clean up nothing, but then the pipe closes: this process removes FOLDER and ends.
"""

from __future__ import annotations

import os
import runpy
import shutil
import sys
import threading


def _end_with_parent(folder: str) -> None:
    # Not through sys.stdin, whose lock a thread that waits would hold as the interpreter shuts down.
    os.read(0, 1)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def main(words: list[str]) -> None:
    """Run the module named second with the words after it."""
    folder, module, *rest = words
    threading.Thread(target=_end_with_parent, args=(folder,), daemon=True).start()
    sys.argv[1:] = rest
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(sys.argv[1:])
