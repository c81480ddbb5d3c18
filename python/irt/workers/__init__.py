"""Run independent jobs in processes on this machine or on a cluster, with the same results."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import Protocol

#: Contents of files by name; a name may include a folder.
Files = dict[str, bytes]

#: The only output file of a process that failed.
FAILED = "failed.json"


class Workers(Protocol):
    """Interface for running a module on many sets of files."""

    def each(
        self, module: str, inputs: Mapping[str, Files], words: Sequence[str] = ()
    ) -> Generator[tuple[str, Files]]:
        """Yield (name, files written) for each completed job, in any order.

        Each set of files is written to its own folder, and ``python -m module FOLDER OUT WORDS`` runs in its
        own process.
        """
