"""Record the sample rigs shipped with the package, in PyBullet: the engine of the paper, not this project's.

Run `python benches/record_pybullet.py` to write `labyrinth/` (four runs of the paper's drive, which differ by
the tracker) and `labyrinth-heldout/` (four other drives and starts, which no tuning sees). The same seed and
the same PyBullet give the same bytes.

The board stands still and gravity turns about it. At these tilts (below 7 mrad) that is the same motion,
whereas a board set from one tilt to the next between two substeps throws the marble up by more than half a
millimetre at every step of the knob: an artefact no real board has.

Rolling friction is Bullet's own. Its coefficient is a length and is multiplied by the other body's lateral
friction, so `mu * radius / lateral friction` makes it the dimensionless `mu` that `rolling_friction` means.
This needs solver iterations: with 10 the marble accelerates 4 % too fast; from 50 on, the stick threshold
is right to 2 % and the acceleration beyond it is 5/7 g (sin(tilt) - mu) to 1e-3.

Damping is off. Bullet multiplies its default of 0.04 1/s by one plus the spin in rad/s, so that a rolling
marble is braked at 0.2 1/s and more. No marble on wood is, the five parameters cannot follow it, and a fit
that tries to ends at a time scale of 62 where 16 is true.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pybullet
from numpy.typing import NDArray

from irt.recording import save_recording

FloatArray = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[1] / "python" / "irt" / "data"
EDGES_M = (0.276, 0.231)
RADIUS_M = 0.00685
MASS_KG = 0.0105
LATERAL_FRICTION = 0.5  # PyBullet's default; two bodies multiply to the rig's wall_friction of 0.25
GRAVITY = 9.81
SUBSTEP_S = 1 / 240
SOLVER_ITERATIONS = 100


@dataclass(frozen=True)
class Truth:
    """The true parameters."""

    gear_x: float = 0.038
    gear_y: float = 0.068
    rolling_friction: float = 0.0004
    time_scale: int = 16
    observation_scale: float = 1.06


@dataclass(frozen=True)
class Run:
    """A recording: commands, start position, and errors of the tracker.

    Attributes
    ----------
    name : str
        Of the file.
    knobs : (n, 2) array
        Commanded angles [rad].
    start_m : tuple
        Position of the resting marble [m].
    lost : tuple of int
        Rows in which the tracker sees no marble.
    outliers : dict
        Offset [board edges] of a false detection, by row.
    """

    name: str
    knobs: FloatArray
    start_m: tuple[float, float] = (0.0, 0.0)
    lost: tuple[int, ...] = ()
    outliers: dict[int, tuple[float, float]] = field(default_factory=dict)


@contextmanager
def labyrinth(truth: Truth, start_m: tuple[float, float]) -> Iterator[tuple[int, int]]:
    """Board with four rim walls and a resting marble; yields the PyBullet client and the marble's id."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=SUBSTEP_S, numSolverIterations=SOLVER_ITERATIONS, physicsClientId=client
        )
        half_x, half_y, thick, high = EDGES_M[0] / 2, EDGES_M[1] / 2, 0.01, 0.02
        boxes = [
            ((half_x + 2 * thick, half_y + 2 * thick, thick), (0.0, 0.0, -thick)),
            ((thick, half_y + 2 * thick, high), (half_x + thick, 0.0, high - thick)),
            ((thick, half_y + 2 * thick, high), (-half_x - thick, 0.0, high - thick)),
            ((half_x + 2 * thick, thick, high), (0.0, half_y + thick, high - thick)),
            ((half_x + 2 * thick, thick, high), (0.0, -half_y - thick, high - thick)),
        ]
        board_shape = pybullet.createCollisionShapeArray(
            shapeTypes=[pybullet.GEOM_BOX] * len(boxes),
            halfExtents=[half for half, _ in boxes],
            collisionFramePositions=[centre for _, centre in boxes],
            physicsClientId=client,
        )
        marble_shape = pybullet.createCollisionShape(
            pybullet.GEOM_SPHERE, radius=RADIUS_M, physicsClientId=client
        )
        board = pybullet.createMultiBody(0, board_shape, physicsClientId=client)
        marble = pybullet.createMultiBody(
            MASS_KG, marble_shape, basePosition=[*start_m, RADIUS_M], physicsClientId=client
        )
        pybullet.changeDynamics(
            board, -1, lateralFriction=LATERAL_FRICTION, restitution=0.0, physicsClientId=client
        )
        pybullet.changeDynamics(
            marble,
            -1,
            lateralFriction=LATERAL_FRICTION,
            rollingFriction=truth.rolling_friction * RADIUS_M / LATERAL_FRICTION,
            restitution=0.0,
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=client,
        )
        yield client, marble
    finally:
        pybullet.disconnect(client)


def gravity_in_board(tilt_x: float, tilt_y: float) -> list[float]:
    """Gravity [m/s^2] as a board tilted about x, then about its y, by right-hand angles [rad] sees it."""
    return [
        GRAVITY * math.cos(tilt_x) * math.sin(tilt_y),
        -GRAVITY * math.sin(tilt_x),
        -GRAVITY * math.cos(tilt_x) * math.cos(tilt_y),
    ]


def simulate(truth: Truth, knobs: FloatArray, start_m: tuple[float, float]) -> FloatArray:
    """Positions (n, 2) [m] at the moment each of the (n, 2) commands [rad] is issued."""
    positions = np.empty_like(knobs)
    with labyrinth(truth, start_m) as (client, marble):
        for row, (knob_x, knob_y) in enumerate(knobs):
            centre, _ = pybullet.getBasePositionAndOrientation(marble, physicsClientId=client)
            positions[row] = centre[:2]
            gravity = gravity_in_board(truth.gear_x * knob_x, truth.gear_y * knob_y)
            pybullet.setGravity(*gravity, physicsClientId=client)
            for _ in range(truth.time_scale):
                pybullet.stepSimulation(physicsClientId=client)
    return positions


def observe(
    truth: Truth, run: Run, positions_m: FloatArray, noise_m: float, rng: np.random.Generator
) -> FloatArray:
    """Return tracked positions of (n, 2) [m]: board edges, to the six printed digits."""
    noisy_m = positions_m + rng.normal(0.0, noise_m, positions_m.shape)
    seen = noisy_m / EDGES_M[0] * truth.observation_scale
    for row, offset in run.outliers.items():
        seen[row] += offset
    seen[list(run.lost)] = np.nan
    return seen.round(6)


def paper_drive(rows: int = 100) -> FloatArray:
    """The drive of the paper's Eq. 3 as its text describes it: one full period on both knobs."""
    phase = 2 * np.pi * np.arange(rows) / rows
    return 0.1 * np.stack([np.sin(phase), np.cos(phase)], axis=1)


def multisine(rows: int, rng: np.random.Generator) -> FloatArray:
    """Sum of four sines with random phases on each knob, scaled to 0.1 rad."""
    periods = np.array([[1, 2, 4, 7], [1, 3, 5, 6]])
    phases = rng.uniform(0, 2 * np.pi, periods.shape)
    angles = 2 * np.pi * np.arange(rows)[:, None, None] / rows * periods + phases
    knobs = np.sin(angles).sum(axis=2)
    return np.asarray(0.1 * knobs / np.abs(knobs).max(axis=0))


def steps(rows: int) -> FloatArray:
    """Six levels, held equally long."""
    levels = np.array([[-9, 5], [6, -8], [7, -6], [-6, 9], [-8, 4], [9, -3]]) / 100
    return np.repeat(levels, rows // len(levels), axis=0)


def chirp(rows: int) -> FloatArray:
    """Sines that speed up from half a period to three and a half a run, the knobs a quarter period apart."""
    time = np.arange(rows) / rows
    phase = 2 * np.pi * (0.5 * time + 1.5 * time**2)
    return 0.1 * np.stack([-np.cos(phase), np.sin(phase)], axis=1)


def training_runs() -> list[Run]:
    """Four times the paper's drive from the centre; two of them with what trackers do to a marble."""
    return [
        Run("run-1", paper_drive()),
        Run("run-2", paper_drive(), lost=(17, 41, 42, 43, 44, 45, 46, 83)),
        Run("run-3", paper_drive(), outliers={29: (0.06, -0.04), 74: (-0.05, 0.08)}),
        Run("run-4", paper_drive()),
    ]


def heldout_runs(rng: np.random.Generator) -> list[Run]:
    """Other drives from other places, 120 rows each."""
    backwards = paper_drive(120) * (-0.8, 0.8)
    return [
        Run("chirp", chirp(120), start_m=(-0.09, -0.04)),
        Run("circle-back", backwards, start_m=(-0.07, -0.03)),
        Run("multisine", multisine(120, rng), start_m=(0.03, 0.01), lost=(60, 61, 62)),
        Run("steps", steps(120), start_m=(0.03, -0.02)),
    ]


RIG_TOML = """\
# {title}
# Recorded in PyBullet by benches/record_pybullet.py. Everything not said here is the paper's labyrinth.
"""

README = """\
# {title}

{about}

Not measured on wood: recorded in PyBullet {version} by `benches/record_pybullet.py --seed {seed}`, which
writes these files again byte for byte.

| truth, which no program reads | |
| --- | --- |
| gear_x, gear_y | {truth.gear_x}, {truth.gear_y} |
| rolling_friction | {truth.rolling_friction} |
| time_scale | {truth.time_scale} |
| observation_scale | {truth.observation_scale} |
| tracker noise, sd | {noise_mm} mm |

A simulation with these values stays within a tenth of the tracker's noise until the marble is faster than
0.055 m/s, where Bullet keeps contact points that it has left and loses up to 1 % of its acceleration to
them, or meets the rim, where its contact is another. What follows, up to 1.5 % of the edge, no fit removes.
"""


@dataclass(frozen=True)
class Rig:
    """One folder to write."""

    folder: str
    title: str
    about: str
    runs: Callable[[np.random.Generator], list[Run]]


RIGS = (
    Rig(
        "labyrinth",
        "A sample labyrinth under the paper's drive",
        "Four runs of the same drive from the centre. The tracker lost the marble in eight rows of run-2\n"
        "and took something else for it in two rows of run-3.",
        lambda rng: training_runs(),
    ),
    Rig(
        "labyrinth-heldout",
        "The sample labyrinth under other drives",
        "Other drives from other starts than in `labyrinth/`, to judge a model by what it never saw.",
        heldout_runs,
    ),
)


def record(rig: Rig, out: Path, seed: int, noise_m: float) -> None:
    """Write the folder of one rig below `out`."""
    truth = Truth()
    rng = np.random.default_rng([seed, RIGS.index(rig)])
    folder = out / rig.folder
    folder.mkdir(parents=True, exist_ok=True)
    for run in rig.runs(rng):
        knobs = run.knobs.round(6)
        positions = simulate(truth, knobs, run.start_m)
        save_recording(folder / f"{run.name}.csv", knobs, observe(truth, run, positions, noise_m, rng))
    (folder / "rig.toml").write_text(RIG_TOML.format(title=rig.title))
    readme = README.format(
        title=rig.title,
        about=rig.about,
        truth=truth,
        seed=seed,
        noise_mm=noise_m * 1000,
        version=version("pybullet"),
    )
    (folder / "README.md").write_text(readme)


def main(arguments: list[str] | None = None) -> None:
    """Write both rigs."""
    parser = argparse.ArgumentParser(description="Record the sample rigs in PyBullet.")
    parser.add_argument("--out", type=Path, default=DATA, help="folder to write to (default: the package's)")
    parser.add_argument("--seed", type=int, default=1, help="of drives and tracker noise (default: 1)")
    parser.add_argument("--noise-mm", type=float, default=0.5, help="tracker noise, sd (default: 0.5)")
    options = parser.parse_args(arguments)
    for rig in RIGS:
        record(rig, options.out, options.seed, options.noise_mm / 1000)
        print(f"wrote {options.out / rig.folder}")


if __name__ == "__main__":
    main()
