"""Record the rig of `irt demo` in PyBullet, with backlash hidden in its drive: not this project's engine.

    python benches/record_demo.py

writes `python/irt/data/demo-rig`. The commands are those of `irt drive`. The board's drive has slack about
both axes, which a simulator of five parameters lacks, as something to diagnose. The same PyBullet version
gives the same bytes.
"""

from __future__ import annotations

import argparse
from importlib.metadata import version
from pathlib import Path

import numpy as np

from irt.files import make_folder, write_atomic
from irt.proof.pybullet_world.engine import Base
from irt.proof.pybullet_world.physics import EDGE_X_M
from irt.proof.pybullet_world.played import play
from irt.proof.pybullet_world.record import RIG_TOML
from irt.proof.pybullet_world.spec import physics_of
from irt.recording import save_recording
from irt.suggestion.first_runs import first_runs

FOLDER = Path(__file__).resolve().parents[1] / "python" / "irt" / "data" / "demo-rig"
TRUTH = Base(gear_x=0.09, gear_y=0.098, rolling_friction=0.0003, time_scale=12.0, observation_scale=1.03)
BACKLASH = {"name": "backlash", "width_x_rad": 0.04, "width_y_rad": 0.06}
#: Rows of a run: 8 s at the 20 Hz of `TRUTH.time_scale`.
ROWS = 160
#: Standard deviation of the tracker [m].
NOISE_M = 0.4e-3
SEED = 1

README = """\
# The rig of `irt demo`

Six runs of 8 s at 20 Hz, played with the commands of `irt drive` from the centre of the board, with
stamps. The drive has backlash, which the simulator of five parameters lacks.

Not measured on wood: recorded in PyBullet {pybullet} by `benches/record_demo.py`, which writes these files
again byte for byte.

| truth, which no program reads | |
| --- | --- |
| gear_x, gear_y | {truth.gear_x:g}, {truth.gear_y:g} |
| rolling_friction | {truth.rolling_friction:g} |
| time_scale | {truth.time_scale:g} |
| observation_scale | {truth.observation_scale:g} |
| backlash: width_x_rad, width_y_rad | {backlash[width_x_rad]:g}, {backlash[width_y_rad]:g} |
| tracker noise, sd | {noise:g} mm |
"""


def main(argv: list[str] | None = None) -> None:
    """Simulate the runs and write the rig's folder."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=FOLDER, help=f"folder to write (default: {FOLDER.name})")
    folder = make_folder(parser.parse_args(argv).out)
    stamps = (TRUTH.row_s * np.arange(ROWS)).round(6)
    for number, run in enumerate(first_runs(ROWS, TRUTH.row_s), start=1):
        commands = run.commands.round(6) + 0.0
        seen = play(TRUTH, commands, (0.0, 0.0), physics_of([BACKLASH])).seen
        random = np.random.default_rng([SEED, number])
        tracked = seen + NOISE_M / EDGE_X_M * random.normal(size=seen.shape)
        save_recording(folder / f"run-{number}.csv", commands, tracked.round(5), stamps)
    write_atomic(folder / "rig.toml", RIG_TOML)
    readme = README.format(
        pybullet=version("pybullet"), truth=TRUTH, backlash=BACKLASH, noise=1000.0 * NOISE_M
    )
    write_atomic(folder / "README.md", readme)


if __name__ == "__main__":
    main()
