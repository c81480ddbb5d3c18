"""Draw docs/maze.svg: a marble that a planner leads through a labyrinth with holes; run by `make pictures`.

The planner knows nothing but `irt.rollouts`: every tenth of a second it tries random tilts from where the
marble is, and plays the beginning of those that lead furthest along the path.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.dimensions import Board, Marble
from irt.engine import SUBSTEP_S, rollouts
from irt.maze import Maze
from irt.model import Model, Parameter
from irt.report import style
from irt.report.plots import draw_rim, rim_of
from irt.rig import PARAMETERS, RANGES

Array = NDArray[np.float64]

OUT = Path(__file__).resolve().parent / "maze.svg"
LAYOUT = "cyberrunner-easy"
#: Size of the picture [inches].
WIDTH, HEIGHT = 7.4, 6.4
#: Updates of 1/240 s in a row.
UPDATES = 6
#: Rows of a plan, in pieces of constant tilt, and how many of them are played.
HORIZON, PIECE, PLAYED = 32, 8, 4
#: Plans that are compared, how far their tilts are spread, and the largest tilt [rad].
PLANS, SPREAD_RAD, MOST_RAD = 256, 0.025, 0.05
#: A millimetre beside the path costs as much as so many along it.
BESIDE = 4.0
#: How far back and ahead along the path the marble is looked for [mm].
BACK, AHEAD = 30, 200
#: The run is over so near to the goal [m], or after so many rows.
GOAL_M, MOST_ROWS = 0.008, 2400


def model_of(layout: str) -> Model:
    """Return a labyrinth whose commands are its tilts."""
    values = (1.0, 1.0, 5e-4, float(UPDATES), 1.0)
    parameters = dict(zip(PARAMETERS, map(Parameter, values), strict=True))
    return Model(Board(), Marble(), "rest", dict(RANGES), parameters, maze=Maze.of_layout(layout))


def places_of(path: Array) -> Array:
    """Return a place of a path for each of its millimetres."""
    pieces = [
        a + (b - a) * np.linspace(0.0, 1.0, int(1000.0 * np.hypot(*(b - a))), endpoint=False)[:, None]
        for a, b in itertools.pairwise(path)
    ]
    return np.concatenate([*pieces, path[-1:]])


def travel(model: Model, seed: int = 0) -> Array:
    """Lead the marble along the path; return where it was in each row, (n, 2) [m]."""
    assert model.maze is not None
    random = np.random.default_rng(seed)
    places, edge = places_of(np.array(model.maze.path)), model.board.edge_x_m
    holes = np.array(model.maze.holes)
    marble, velocity, at = places[0], np.zeros(2), 0
    plan = np.zeros((HORIZON // PIECE, 2))
    rows = [marble]
    while len(rows) < MOST_ROWS and np.hypot(*(marble - places[-1])) > GOAL_M:
        tried = plan + SPREAD_RAD * random.normal(size=(PLANS, *plan.shape))
        tried[0] = plan
        tilts = np.clip(tried, -MOST_RAD, MOST_RAD).repeat(PIECE, axis=1)
        paths = edge * rollouts(model, tilts, start=marble / edge, start_velocity=velocity / edge)
        some = places[max(0, at - BACK) : at + AHEAD]
        distance = np.linalg.norm(paths[:, ::PLAYED, None] - some, axis=-1)
        # A plan is given up over a hole: the next one would begin on the board again.
        over = np.linalg.norm(paths[:, :, None] - holes, axis=-1) < model.maze.hole_radius_m
        lost = np.isnan(paths).any(axis=(1, 2)) | over.any(axis=(1, 2))
        along, beside = distance[:, -1].argmin(axis=-1), 1000.0 * distance.min(axis=-1).mean(axis=-1)
        best = int(np.where(lost, -np.inf, along - BESIDE * beside).argmax())
        plan = tried[best]
        rows.extend(paths[best, 1 : PLAYED + 1])
        marble, velocity = rows[-1], (rows[-1] - rows[-2]) / (UPDATES * SUBSTEP_S)
        at = max(0, at - BACK) + int(np.linalg.norm(some - marble, axis=-1).argmin())
    return np.array(rows)


def draw(model: Model, run: Array) -> None:
    """Draw the labyrinth from above, its path, and a marble each half second."""
    assert model.maze is not None
    edge = model.board.edge_x_m
    half = 1.015 * rim_of(model)
    with style.drawing(OUT, WIDTH, HEIGHT) as figure:
        axes: Any = figure.subplots()
        draw_rim(axes, model)
        axes.plot(*np.array(model.maze.path).T / edge, color=style.MUTED, ls=(0, (1, 3)), lw=1.2)
        axes.plot(*run.T / edge, color=style.TUNED, zorder=3)
        every = round(0.5 / (UPDATES * SUBSTEP_S))
        for place in run[::every] / edge:
            axes.add_patch(_marble(tuple(place), model.marble.radius_m / edge))
        for name, place in (("start", run[0]), ("goal", np.array(model.maze.path[-1]))):
            axes.annotate(
                name, place / edge, xytext=(0, 12), textcoords="offset points", ha="center", fontweight="bold"
            )
        seconds = len(run) * UPDATES * SUBSTEP_S
        axes.set_title(f"{len(model.maze.holes)} holes, {seconds:.0f} s", fontweight="bold")
        axes.set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]), aspect="equal", xticks=[], yticks=[])
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)


def _marble(place: tuple[float, float], radius: float) -> Any:
    from matplotlib.patches import Circle  # noqa: PLC0415

    return Circle(place, radius, fc=style.TUNED, ec="none", alpha=0.25, zorder=2.5)


def main() -> None:
    """Run the marble and draw it."""
    model = model_of(LAYOUT)
    draw(model, travel(model))
    print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
