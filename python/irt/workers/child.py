"""Run a module as ``python -m`` does, until it is done or the process that asked for it has gone.

    python -P -m irt.workers.child FOLDER MODULE WORDS

A parent that is killed can remove nothing. So this process removes FOLDER, and is there before the folder and
as long as it. Standard input is a pipe whose other end only the parent holds:

1. The parent starts this process, makes and fills FOLDER, and writes a byte to the pipe.
2. This process runs the module in a fork of itself. The end of the module closes standard error.
3. The parent reads what it needs, and closes the pipe. The parent's own end closes it too, at any time.
4. This process ends the module if it still runs, removes FOLDER, and ends with the module's exit status.
"""

from __future__ import annotations

import os
import runpy
import shutil
import signal
import sys


def main(words: list[str]) -> int:
    """Run the module named second with the words after it, in the folder named first; return its status."""
    folder, module, *rest = words
    status = 1
    if os.read(0, 1):
        # Nothing heavy is imported and there is one thread: a fork is cheap and safe.
        runner = os.fork()
        if runner == 0:
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.chdir(folder)
            sys.argv[1:] = rest
            runpy.run_module(module, run_name="__main__", alter_sys=True)
            return 0
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        while os.read(0, 1):
            pass
        os.kill(runner, signal.SIGKILL)
        status = os.waitstatus_to_exitcode(os.waitpid(runner, 0)[1])
    # Nothing writes into the folder any more, so it is removed whole.
    shutil.rmtree(folder, ignore_errors=True)
    return status if status >= 0 else 128 - status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
