"""Draw the diagnosis of the example rig for README.md and docs/diagnosis.md: run by `make pictures`."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from irt.cli.demo import data
from irt.diagnosis import Diagnosis, diagnose
from irt.diagnosis.result import RunProof
from irt.report import style
from irt.report.budget_plots import bare, colour, draw_bar, labels
from irt.report.diagnosed import write_diagnosis
from irt.report.diagnosis_plots import Side, sides
from irt.report.error_budget import bars
from irt.report.plots import TICKS, draw_rim, rim_of
from irt.report.words import percent, plain
from irt.rig import Rig, load_rig

DOCS = Path(__file__).resolve().parent
#: Size of the picture [inches].
WIDTH, HEIGHT = 7.4, 4.0
#: Size of the window that shows the report [pixels].
WIDE, HIGH = 1000, 1000
#: Sections of the report that get a picture: by a part of their heading.
SECTIONS = {"effect": "What was left out", "hypotheses": "ypotheses"}
#: Space above a heading and below the player's controls [pixels].
MARGIN = 30.0
#: The first of these that is there renders the report.
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def draw_diagnosis(found: Diagnosis) -> Path:
    """Draw the run that five parameters predict worst, before and after, and where the error goes."""
    path = DOCS / "diagnosis.png"
    with style.drawing(path, WIDTH, HEIGHT) as figure:
        axes: Any = figure.subplot_mosaic(
            [["before", "after"], ["budget", "budget"]], height_ratios=(1.0, 0.13)
        )
        for side in sides(found):
            _draw_path(axes[side.label], found, side)
        _draw_budget(axes["budget"], found)
    return path


def _draw_path(axes: Any, found: Diagnosis, side: Side) -> None:
    """Draw the recorded and the predicted path of a run from above."""
    run = _shown(found)
    model = found.base if side.which == "base" else found.model
    draw_rim(axes, model)
    axes.plot(*run.observed.T, ".", color=style.RECORDED)
    axes.plot(*side.marble(run).T, color=style.TUNED if side.which == "final" else style.UNTUNED, zorder=3)
    axes.plot(*run.observed[0], "o", color=style.INK, ms=6, mfc=style.PAPER, zorder=6)
    axes.annotate(
        "start", run.observed[0], xytext=(-7, 0), textcoords="offset points", ha="right", va="center"
    )
    what = "five parameters" if side.which == "base" else f"{_names(found)} added"
    axes.set_title(f"{what}: {percent(side.mae(run))} of edge off", color=side.colour, fontweight="bold")
    axes.set_title("• recorded", color=style.RECORDED, loc="right")
    half = 1.015 * rim_of(model)
    axes.set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]), xticks=TICKS, yticks=TICKS, aspect="equal")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(labelleft=False, labelbottom=False)


def _shown(found: Diagnosis) -> RunProof:
    """Return the run that five parameters predict worst, of those that go half as far as the farthest."""
    length = [float(np.nansum(np.abs(np.diff(one.observed, axis=0)))) for one in found.runs]
    far = [one for one, each in zip(found.runs, length, strict=True) if each >= 0.5 * max(length)]
    return max(far, key=lambda one: one.base_mae)


def _draw_budget(axes: Any, found: Diagnosis) -> None:
    """Draw the squared error on held-out runs as one bar; what has no room in it stands below."""
    bar = bars(found)[0]
    nameless = draw_bar(axes, bar, (-0.4, 0.4), WIDTH)
    axes.set(xlim=(0.0, 1.0), ylim=(-0.5, 0.5))
    axes.set_title(f"where the squared error of five parameters goes, held-out {bar.title}")
    for index, place in zip(reversed(nameless), np.linspace(1.0, 0.0, 4), strict=False):
        look = {"color": colour(bar.parts, index), "transform": axes.transAxes, "ha": "right", "va": "top"}
        axes.text(place, -0.25, labels(bar.parts[index])[0], **look)
    bare(axes)


def _names(found: Diagnosis) -> str:
    """Return the effects in words."""
    return " and ".join(plain(one.name) for one in found.effects)


def draw_report(rig: Rig, found: Diagnosis) -> list[Path]:
    """Render the top of the report and some of its sections; nothing where there is no browser."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        return []
    paths: list[Path] = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        report = write_diagnosis(Path(folder), rig, found)
        chromium = driver.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": WIDE, "height": HIGH}, color_scheme="light")
        page.goto(report.as_uri())
        # A run that is chosen does not play.
        page.locator(".run").select_option(index=0)
        page.locator(".time").fill("140")
        box = "one => ['top', 'bottom'].map(side => one.getBoundingClientRect()[side] + scrollY)"
        heads = page.locator("h2").evaluate_all(f"all => all.map(one => [one.textContent, ...({box})(one)])")
        parts = {"top": (0.0, float(page.locator(".time").evaluate(box)[1]) + MARGIN / 2)}
        for name, heading in SECTIONS.items():
            index = next(index for index, head in enumerate(heads) if heading in head[0])
            parts[name] = (heads[index][1] - MARGIN, heads[index + 1][1] - MARGIN)
        for name, (first, last) in parts.items():
            paths.append(DOCS / f"report-{name}.png")
            page.screenshot(
                path=paths[-1],
                clip={"x": 0.0, "y": first, "width": WIDE, "height": last - first},
                full_page=True,
            )
        chromium.close()
    return paths


def main() -> None:
    """Draw all pictures, and name them."""
    # The page names the rig's folder: that of a user, not of this machine.
    rig = replace(load_rig(data("demo-rig")), path=Path("demo-rig"))
    found = diagnose(rig)
    paths = [draw_diagnosis(found), *draw_report(rig, found)]
    print(*(f"wrote {path}" for path in paths), sep="\n")
    if len(paths) == 1:
        print(f"the report was not rendered: none of {', '.join(BROWSERS)} is installed")


if __name__ == "__main__":
    main()
