"""Work on an existing Ray cluster: the same processes, on other machines, with the same answers."""

from __future__ import annotations

import re
import socket
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from irt.errors import IrtError
from irt.extras import require
from irt.workers import Files
from irt.workers.processes import run_module

_HOST = re.compile(r"(?:ray://)?(?P<host>[^:/]+):(?P<port>\d+)")
#: Longest that a cluster may take to open its door (s); Ray itself waits for minutes.
_PATIENCE_S = 5.0


class RayWorkers:
    """Runs processes on a Ray cluster, one core each.

    The cluster's machines need this package. Whatever else a cluster asks for, such as a token, is for
    Ray's own settings to say.

    Parameters
    ----------
    address : str
        Of the cluster, as Ray takes it; "auto" for one that this machine belongs to.

    Raises
    ------
    IrtError
        If Ray is not installed, or no cluster answers.
    """

    def __init__(self, address: str) -> None:
        require("ray", "--cluster")
        import ray  # noqa: PLC0415

        self._ray: Any = ray
        if not ray.is_initialized():
            _knock(address)
            try:
                ray.init(address=address, log_to_driver=False, logging_level="error")
            except (ConnectionError, RuntimeError, ValueError) as error:
                raise IrtError(f"no Ray cluster answers at {address}: {error}") from error

    def each(
        self, module: str, inputs: Mapping[str, Files], words: Sequence[str] = ()
    ) -> Generator[tuple[str, Files]]:
        """Yield (name, files written) as work gets done; Ctrl-C takes back what has not begun."""
        # A module that is run needs nothing but the files: no object of this process travels.
        work = self._ray.remote(run_module).options(num_cpus=1, max_retries=3)
        tasks = {work.remote(module, files, tuple(words)): name for name, files in inputs.items()}
        left = list(tasks)
        try:
            while left:
                (done, *_), left = self._ray.wait(left, num_returns=1)
                yield tasks[done], self._ray.get(done)
        finally:
            for task in left:
                self._ray.cancel(task, force=True)


def _knock(address: str) -> None:
    """Raise at once where nobody listens at the host and port of an address, if it names any."""
    place = _HOST.fullmatch(address)
    if place is None:
        return
    try:
        socket.create_connection((place["host"], int(place["port"])), timeout=_PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise IrtError(f"no Ray cluster answers at {address}: {error}") from error
