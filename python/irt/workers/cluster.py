"""Run jobs on an existing Ray cluster: the same processes as locally, with the same results."""

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
#: Timeout of the connection to a cluster [s]; Ray itself waits for minutes.
_PATIENCE_S = 5.0


class RayWorkers:
    """Runs processes on a Ray cluster, one core each.

    This package must be installed on the cluster's machines. Other requirements of a cluster, such as a
    token, are set through Ray's own configuration.

    Parameters
    ----------
    address : str
        Address of the cluster; "auto" for the cluster that this machine belongs to.

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
            _check_reachable(address)
            try:
                ray.init(address=address, log_to_driver=False, logging_level="error")
            except (ConnectionError, RuntimeError, ValueError) as error:
                raise IrtError(f"no Ray cluster answers at {address}: {error}") from error

    def each(
        self, module: str, inputs: Mapping[str, Files], words: Sequence[str] = ()
    ) -> Generator[tuple[str, Files]]:
        """Yield (name, files written) for each completed job; Ctrl-C cancels the others."""
        # Jobs exchange only files, so no Python objects are serialised.
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


def _check_reachable(address: str) -> None:
    """Raise at once if the host and port of an address, if given, do not accept connections."""
    place = _HOST.fullmatch(address)
    if place is None:
        return
    try:
        socket.create_connection((place["host"], int(place["port"])), timeout=_PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise IrtError(f"no Ray cluster answers at {address}: {error}") from error
