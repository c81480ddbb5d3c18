"""Choose between local processes and a cluster."""

from __future__ import annotations

import os

from irt.workers import Workers


def make_workers(jobs: int | None = None, cluster: str | None = None) -> Workers:
    """Return workers: `jobs` local processes at a time, or the Ray cluster at an address.

    Parameters
    ----------
    jobs : int, optional
        Number of local processes; by default one per core.
    cluster : str, optional
        Address of a Ray cluster; "auto" for the cluster that this machine belongs to.

    Raises
    ------
    IrtError
        If Ray is not installed, or no cluster answers.
    """
    if cluster is not None:
        from irt.workers.cluster import RayWorkers  # noqa: PLC0415

        return RayWorkers(cluster)
    from irt.workers.processes import LocalWorkers  # noqa: PLC0415

    return LocalWorkers(jobs or os.cpu_count() or 1)
