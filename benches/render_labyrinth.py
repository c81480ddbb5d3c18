"""Render a marble in a labyrinth by Blender's Cycles, with its truth, for `track_traced.py`.

    python3.11 -m venv blender && blender/bin/pip install bpy==4.5.15 scipy matplotlib jinja2 tqdm
    PYTHONPATH=python blender/bin/python benches/render_labyrinth.py steel white --out labyrinths
    .venv/bin/python benches/track_traced.py labyrinths

The marble rolls between walls and past holes as the engine says, under commands drawn at random; a picture
takes about ten seconds of one core. The corners of the board, where it meets its rim, are given to the
tracker, since case, frame, rim and board are all of wood and of one shape.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

import irt
from irt.rig import PARAMETERS, RANGES
from tracking.labyrinth import LOOKS, Labyrinth, Look
from tracking.view import Array, View, turned

#: Of the marble [m], as that of the CyberRunner's labyrinth.
RADIUS_M = 0.006
#: Gears and rolling friction, updates in a row, observation scale.
BASE = (0.07, 0.07, 3e-4, 16.0, 1.0)
#: Amplitudes of the board's tilt are drawn from these, and its frequencies [rad, 1/s].
TILTS, FREQUENCIES = (0.02, 0.05), (0.15, 0.8)
#: Least way across the board [board edges], and how often commands are drawn until the marble does not fall.
LEAST_WAY, TRIES = 0.3, 2000


def main() -> None:
    """Render the looks that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("looks", nargs="+", choices=sorted(LOOKS))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--pictures", type=int, default=45)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--samples", type=int, default=4, help="to a pixel, before its noise is removed")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    for name in args.looks:
        look, folder = LOOKS[name], args.out / f"{name}-{args.seed}"
        (folder / "run").mkdir(parents=True, exist_ok=True)
        places, tilts, edges = rolled(look, args.pictures, args.seed)
        view = View.above(look.edge_px, edges[0], lean=look.lean, turn=look.turn)
        truth = seen(places, tilts, edges, view)
        (folder / "truth.json").write_text(json.dumps({"kind": name, **truth}), encoding="utf-8")
        Labyrinth(look, view, edges, RADIUS_M, args.samples, args.threads).render(
            places, tilts, folder / "run"
        )
        print(name, "done", flush=True)


def rolled(look: Look, pictures: int, seed: int) -> tuple[Array, Array, tuple[float, float]]:
    """Return places (n, 2) [board edges], tilts (n, 2) [rad], and edges [m] of a run without a fall.

    Raises
    ------
    RuntimeError
        If the marble falls, or hardly moves, under all commands that are tried.
    """
    maze, board = irt.Maze.of_layout(look.layout), irt.Board()
    parameters = {name: irt.Parameter(value) for name, value in zip(PARAMETERS, BASE, strict=True)}
    model = irt.Model(board, irt.Marble(radius_m=RADIUS_M), "rest", dict(RANGES), parameters, maze=maze)
    times = BASE[3] / 240.0 * np.arange(pictures)
    for attempt in range(TRIES):
        random = np.random.default_rng([seed, attempt])
        waves = [
            random.uniform(0.2, 1.0)
            * np.sin(2.0 * np.pi * random.uniform(*FREQUENCIES) * times + random.uniform(0.0, 2.0 * np.pi))
            for _ in range(8)
        ]
        tilts = random.uniform(*TILTS) / 2.0 * np.stack([sum(waves[:4]), sum(waves[4:])], axis=1)
        begin = maze.path[int(random.integers(len(maze.path)))] if maze.path else random.uniform(-0.1, 0.1, 2)
        places = model.predict(tilts / BASE[:2], start=tuple(np.divide(begin, board.edge_x_m)))
        if np.isfinite(places).all() and np.ptp(places, axis=0).max() > LEAST_WAY:
            return places, tilts, (board.edge_x_m, board.edge_y_m)
    raise RuntimeError(f"seed {seed}: the marble falls, or hardly moves, under {TRIES} commands")


def seen(places: Array, tilts: Array, edges: tuple[float, float], view: View) -> dict[str, object]:
    """Return what `track_traced.py` reads as the truth."""
    x, y = edges[0] / 2.0, edges[1] / 2.0
    corners = np.array([[-x, y, 0.0], [x, y, 0.0], [x, -y, 0.0], [-x, -y, 0.0]])
    middles = np.column_stack([places * edges[0], np.full(len(places), RADIUS_M)])
    pixels = [
        view.project((turned(tilt) @ middle)[None])[0] for middle, tilt in zip(middles, tilts, strict=True)
    ]
    return {
        "rim": True,
        "radius_m": RADIUS_M,
        "edges_m": edges,
        "matrix": view.matrix.tolist(),
        "size": (view.width, view.height),
        "radius_px": view.focal * RADIUS_M / float(np.linalg.norm(view.eye)),
        "corners": view.project(corners).tolist(),
        "pixels": np.array(pixels).tolist(),
        "places": places.tolist(),
        "tilts": tilts.tolist(),
    }


if __name__ == "__main__":
    main()
