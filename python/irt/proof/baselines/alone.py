"""Baseline: the refitted base model without further effects, as after a tuning."""

from __future__ import annotations

from irt.proof.baselines.entry import Entry, Task, predicted

TITLE = "base refit alone"


def enter(task: Task) -> Entry:
    """Report no missing physics, and predict with five parameters."""
    return Entry(detected=False, named=(), predictions=predicted(task.base, task.tests))
