"""Ablations of Experiment 1: the open choices of the paper reversed (Eq. 3 as printed, and damping)."""

from __future__ import annotations

from dataclasses import replace

from irt.fitting.fit import Progress
from irt.paper.setting import Setting, within
from irt.paper.simulated import Experiment1, experiment1

#: The paper's method, its main baseline, and two methods of this project.
ABLATED = ("irt-paper", "cma-es", "least-squares", "irt+")

#: Number of targets for the engine's least squares.
ENGINE_TARGETS = 20


def ablations(setting: Setting, targets: int, progress: Progress | None = None) -> dict[str, Experiment1]:
    """Return Experiment 1 with each choice reversed, by the reversed choice.

    Results of an earlier call are reused.
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
        name: experiment1(other, ABLATED, within(progress, name), engine_targets=ENGINE_TARGETS)
        for name, other in others.items()
    }
