"""Draw the pictures of README.md: run by `make pictures`."""

from __future__ import annotations

from pathlib import Path

from irt.cli.demo import data
from irt.report import style
from irt.report.plots import Prediction, plot_paths
from irt.report.tuning_report import untuned
from irt.residual import evaluate
from irt.rig import load_rig
from irt.tuning import tune

DOCS = Path(__file__).resolve().parent


def draw_tuned() -> Path:
    """Draw the sample rig from above, before and after tuning by IRT, into ``tuned.png``."""
    rig = load_rig(data("labyrinth"))
    recording = rig.recordings[0]
    tuned = tune(rig, "irt", seed=0).model
    panels = []
    for label, model, colour in (("untuned", untuned(rig), style.UNTUNED), ("tuned", tuned, style.TUNED)):
        run = evaluate(model, [recording]).runs[0]
        panels.append((recording, Prediction(label, run.free_prediction, model, colour)))
    path = DOCS / "tuned.png"
    plot_paths(path, panels)
    return path


if __name__ == "__main__":
    print(f"wrote {draw_tuned()}")
