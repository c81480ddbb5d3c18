"""Who does work that falls into parts: processes of this machine or a cluster, with the same answers."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import Protocol

#: Files by name; a name may hold a folder.
Files = dict[str, bytes]

#: The one file that stands for the work of a process that failed.
FAILED = "failed.json"


class Workers(Protocol):
    """Whoever runs a module on many sets of files."""

    def each(
        self, module: str, inputs: Mapping[str, Files], words: Sequence[str] = ()
    ) -> Generator[tuple[str, Files]]:
        """Yield (name, files written) as work gets done, in any order.

        Each set of files is in a folder of its own, and ``python -m module FOLDER OUT WORDS`` a process of
        its own.
        """
