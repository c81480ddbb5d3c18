"""Experiment 1 with what the paper leaves open taken the other way: Eq. 3 to the letter, and damping."""

from __future__ import annotations

from dataclasses import replace

from irt.fitting.fit import Progress
from irt.paper.setting import Setting, within
from irt.paper.simulated import Experiment1, experiment1

#: The paper's method, its main rival, and the two that this project puts beside them.
SWITCHED = ("irt-paper", "cma-es", "least-squares", "irt+")

#: Targets that the engine's least squares is tried on.
ENGINE_TARGETS = 20


def switched(setting: Setting, targets: int, progress: Progress | None = None) -> dict[str, Experiment1]:
    """Return Experiment 1 on so many targets with each switch the other way, by what is other.

    What is kept of an earlier call is not done again.
    """
    others = {
        "a full period" if setting.literal else "Eq. 3 as printed": replace(
            setting, targets=targets, literal=not setting.literal
        ),
        "no damping" if setting.damped else "PyBullet's damping": replace(
            setting, targets=targets, damped=not setting.damped
        ),
    }
    return {
        name: experiment1(other, SWITCHED, within(progress, name), engine_targets=ENGINE_TARGETS)
        for name, other in others.items()
    }
