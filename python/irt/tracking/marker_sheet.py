"""The sheet of markers to print: four for the board's corners, at their true size, with what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from irt.files import atomic_path
from irt.tracking.markers import DICTIONARY
from irt.tracking.opencv import opencv

#: A4, upright [mm].
PAPER_MM = (210.0, 297.0)
#: Side of a marker, and the white border that is cut out with it: one of its six modules, and what scissors
#: miss [mm].
SIDE_MM, BORDER_MM = 20.0, 5.0
#: Cells to a marker's side, its black frame counted.
CELLS = 6
#: Length of the bar that shows whether the printer keeps to the size [mm].
BAR_MM = 100.0
STEPS = (
    "Print at 100 % (\u201cactual size\u201d), not \u201cfit to page\u201d, on matt white paper.",
    "Measure the bar: it must be 100 mm long. Otherwise change the printer's settings.",
    "Cut along the dashed lines. Keep the white borders: without them markers are not found.",
    "Stick each marker flat into its corner of the board, number upright: 0 where x is least and y greatest,",
    "   then 1, 2, 3 clockwise as the camera sees the board. The marble must not roll over them.",
    "Calibrate the lens (irt track VIDEO --calibrate). Then irt track measures the tilt by the markers.",
)


def write_marker_sheet(path: Path) -> None:
    """Write markers 0 to 3 as a page of A4, in the format of the path's ending (.pdf, .svg, .png).

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415

    width, height = PAPER_MM
    figure = Figure(figsize=(width / 25.4, height / 25.4))
    page = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    page.set(xlim=(0.0, width), ylim=(0.0, height))
    page.set_axis_off()
    page.text(20.0, 275.0, "Markers for irt track", fontsize=16, weight="bold", va="center")
    page.text(
        20.0, 266.0, f"ArUco {DICTIONARY}, numbers 0 to 3, {SIDE_MM:g} mm a side, black on white", fontsize=9
    )
    for number, (x, y) in enumerate(((35.0, 215.0), (130.0, 215.0), (130.0, 155.0), (35.0, 155.0))):
        _marker(page, number, x, y)
    page.plot([20.0, 20.0 + BAR_MM], [125.0, 125.0], color="black", linewidth=1.5, solid_capstyle="butt")
    for end in (20.0, 20.0 + BAR_MM):
        page.plot([end, end], [122.0, 128.0], color="black", linewidth=0.5)
    page.text(20.0 + BAR_MM / 2.0, 128.0, f"{BAR_MM:g} mm", fontsize=9, ha="center")
    counted = 0
    for row, step in enumerate(STEPS):
        counted += not step.startswith(" ")
        text = step if step.startswith(" ") else f"{counted}. {step}"
        page.text(20.0, 108.0 - 8.0 * row, text, fontsize=9)
    with atomic_path(path) as beside:
        figure.savefig(beside, format=path.suffix[1:])


def _marker(page: Any, number: int, x: float, y: float) -> None:
    """Draw a marker whose lower left is at a place of the page [mm], cell by cell."""
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    cv2 = opencv()
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    cells = cv2.aruco.generateImageMarker(words, number, CELLS)
    step = SIDE_MM / CELLS
    page.add_patch(Rectangle((x, y), SIDE_MM, SIDE_MM, facecolor="black", edgecolor="none"))
    for row in range(CELLS):
        for column in range(CELLS):
            if cells[row, column]:
                place = x + column * step, y + SIDE_MM - (row + 1) * step
                page.add_patch(
                    Rectangle(place, step, step, facecolor="white", edgecolor="white", linewidth=0.1)
                )
    page.add_patch(
        Rectangle(
            (x - BORDER_MM, y - BORDER_MM),
            SIDE_MM + 2 * BORDER_MM,
            SIDE_MM + 2 * BORDER_MM,
            fill=False,
            edgecolor="gray",
            linestyle="--",
            linewidth=0.5,
        )
    )
    page.text(x + SIDE_MM / 2.0, y + SIDE_MM + BORDER_MM + 2.0, f"{number}", fontsize=10, ha="center")
