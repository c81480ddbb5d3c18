"""Time and memory of the rolling engine over the number of rollouts, streamed in chunks."""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from irt.engine import rollouts
from peers.workload import drive, spread

#: Rollouts per chunk: 32 MB of positions.
CHUNK = 20_000
WARM_UP = 1000
#: Number of rollouts from which a size is timed once; smaller ones are timed more often.
ENOUGH, MOST_REPEATS = 1_000_000, 5


@dataclass(frozen=True)
class Growth:
    """Streaming one number of rollouts.

    Attributes
    ----------
    rollouts : int
        Their number.
    seconds : list of float
        Time of each repetition, on all cores.
    peak_mib : list of float
        Largest resident memory of a process that did nothing else [MiB].
    """

    rollouts: int
    seconds: list[float] = field(default_factory=list)
    peak_mib: list[float] = field(default_factory=list)


def stream(count: int) -> tuple[float, float]:
    """Simulate `count` rollouts chunk by chunk; return the seconds and this process's peak memory [MiB]."""
    commands = drive()
    rollouts(spread(WARM_UP), commands)  # starts the threads and fills the caches
    began = time.perf_counter()
    for first in range(0, count, CHUNK):
        rollouts(spread(min(CHUNK, count - first), first), commands)
    seconds = time.perf_counter() - began
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def measure(largest: int, progress: Callable[[str], None]) -> list[Growth]:
    """Time 1,000, 10,000, ... up to `largest` rollouts, in turns, each time in a process of its own."""
    sizes = [10**power for power in range(3, len(str(largest)))]
    results = [Growth(size) for size in sizes]
    for repeat in range(MOST_REPEATS):
        for result in results:
            if repeat > 0 and (repeat + 1) * result.rollouts > ENOUGH:
                continue
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                seconds, peak = pool.apply(stream, (result.rollouts,))
            result.seconds.append(seconds)
            result.peak_mib.append(peak)
            progress(f"growth: {result.rollouts:,} rollouts in {seconds:.3g} s, {peak:.0f} MiB")
    return results
