"""The two sets of runs that trackers are judged by: clean light, and what a laboratory has."""

from __future__ import annotations

import numpy as np

from irt.engine import rollouts
from tracking.board import Paint
from tracking.scene import Finger, Look, Scene
from tracking.view import Array, View

#: Gears, friction, substeps to a picture (60 a second), scale.
TRUTH = (0.10, 0.10, 4e-4, 4.0, 1.0)
STEEP = (0.13, 0.13, 4e-4, 4.0, 1.0)


def rolled(rows: int, seed: int, parameters: tuple[float, ...] = TRUTH) -> tuple[Array, Array, Array]:
    """Return commands [rad], tilts [rad] and places [board edges], (rows, 2) each, of a marble that rolls."""
    random = np.random.default_rng([seed, 5])
    time = np.arange(rows)[:, None, None] / 60.0
    waves = np.sin(2 * np.pi * (time * random.uniform(0.15, 0.8, (2, 4)) + random.random((2, 4))))
    knobs = 0.12 * waves.sum(axis=2) * np.minimum(time[:, 0], 0.5) * 2
    places = rollouts([parameters], knobs)[0]
    return knobs, knobs * parameters[:2], places


def clean(clip: int, rows: int) -> Scene:
    """Return a run in good light: an even board, no lens to speak of, nothing between."""
    random = np.random.default_rng([clip, 1])
    _, tilts, places = rolled(rows, clip)
    marble = ("blue", "steel", "red", "green")[clip % 4]
    view = View.above(
        random.uniform(242, 403), lean=tuple(random.uniform(-0.12, 0.12, 2)), turn=random.uniform(-0.05, 0.05)
    )
    look = Look(marble, light=(*random.uniform(-0.3, 0.3, 2), 1.0))
    return Scene(view, Paint(grain=0.06, lines=0, holes=0), look, places, tilts, seed=100 + clip)


def hard(clip: int, rows: int) -> Scene:
    """Return a run with all that makes it hard."""
    random = np.random.default_rng([clip, 2])
    _, tilts, places = rolled(rows, 1000 + clip, STEEP)
    marble = ("blue", "steel", "red", "green")[clip % 4]
    view = View.above(
        random.uniform(242, 403),
        focal=random.uniform(500, 900),
        lean=tuple(random.uniform(-0.25, 0.25, 2)),
        turn=random.uniform(-0.1, 0.1),
        lens=(random.uniform(-0.2, 0.0), 0.03),
    )
    look = Look(
        marble,
        light=(*random.uniform(-0.7, 0.7, 2), 1.0),
        ambient=random.uniform(0.3, 0.6),
        highlight=1.0,
        gradient=random.uniform(0.2, 0.5),
        flicker=0.03,
        blur=random.uniform(0.7, 1.1),
        noise=random.uniform(3.0, 8.0),
        exposure=0.5,
        readout=0.8,
        jpeg=int(random.integers(60, 96)),
    )
    likeness = {"blue": (0.05, 0.11, 0.45), "red": (0.5, 0.06, 0.05), "green": (0.05, 0.35, 0.1)}.get(
        marble, (0.2, 0.2, 0.21)
    )
    wood = ("light", "white", "dark")[clip % 3]
    paint = Paint(wood, grain=0.12, lines=5, holes=8, likeness=likeness)
    finger = Finger(
        colour=((0.12, 0.12, 0.13), (0.45, 0.27, 0.2), (0.02, 0.02, 0.02))[clip % 3],
        ball=(clip // 4) % 2 == 0,
    )
    return Scene(view, paint, look, places, tilts, finger, seed=200 + clip)


SETS = {"clean": clean, "hard": hard}
