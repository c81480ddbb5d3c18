"""The base model refitted, and nothing else: what a tuning leaves behind."""

from __future__ import annotations

from irt.proof.baselines.entry import Entry, Task, predicted

TITLE = "base refit alone"


def enter(task: Task) -> Entry:
    """Say that nothing is missing, and predict with five parameters."""
    return Entry(told=False, named=(), predictions=predicted(task.base, task.tests))
