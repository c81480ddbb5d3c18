"""The marble in motion: an SVG that a small script moves, and still pictures where scripts do not run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.result import RunProof
from irt.model import Model
from irt.report.diagnosis_plots import Side, thinned
from irt.report.page import Page, Picture, figure
from irt.report.plots import rim_of

Array = NDArray[np.float64]

#: Rows of all runs together, and of one at least: enough for a smooth motion in a file that can be sent.
_MOST_ROWS = 9000
_LEAST_ROWS = 150
#: Digits behind the point: a hundredth of a percent of the board.
_DIGITS = 4
_SPEEDS = (0.25, 0.5, 1, 2, 4, 8)
#: Classes of the page's style for what is predicted.
_CLASS = {"base": "before", "final": "after"}
#: Units of the SVG in one board edge.
_SCALE = 1000


def add_animation(
    page: Page,
    runs: Sequence[RunProof],
    model: Model,
    shown: Sequence[Side],
    *,
    stills: Sequence[Picture],
    hint: str,
    caption: str,
) -> None:
    """Add recorded and simulated marbles, with play, slider and choice of run.

    Where scripts do not run, and on paper, the still pictures stand in their place.

    Parameters
    ----------
    page : Page
        Where to add it; a page holds one.
    runs : sequence of RunProof
        What was recorded and predicted; the first is shown first.
    model : Model
        Dimensions of board and marble, and where the camera sees them.
    shown : sequence of Side
        Whose predictions.
    stills : sequence of Picture
        What to show instead.
    hint : str
        How to read what moves; not shown with the still pictures.
    caption : str
        What there is to see, moving or still.
    """
    names = ["recorded", *(_class(side, shown) for side in shown)]
    instead = "".join(figure(still) for still in stills)
    page.markup(
        f'<figure class="animation" id="animation"><div class="player" hidden>{_svg(model, names)}'
        f'{_legend(shown)}{_controls(runs)}<p class="hint">{escape(hint)}</p></div>'
        f'<div class="still figures">{instead}</div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        f'<script type="application/json" id="animation-data">{_json(_data(runs, shown))}</script>'
    )
    page.script(resources.files(__package__).joinpath("player.js").read_text(encoding="utf-8"))


def _class(side: Side, shown: Sequence[Side]) -> str:
    """Return the class of a prediction's marks: a lone one looks like what is final."""
    return _CLASS[side.which] if len(shown) > 1 else "after"


def _data(runs: Sequence[RunProof], shown: Sequence[Side]) -> dict[str, Any]:
    """Return what the script needs: times, and places with null where there is none."""
    most = max(_LEAST_ROWS, _MOST_ROWS // max(1, len(runs)))
    told = []
    for run in runs:
        rows = thinned(len(run.times), most)
        error = np.abs(shown[0].residual(run)[rows]).mean(axis=1)
        places = {_class(side, shown): _places(side.marble(run)[rows]) for side in shown}
        told.append(
            {
                "t": [round(float(time), 3) for time in run.times[rows]],
                "worst": int(np.argmax(np.nan_to_num(error))),
                "recorded": _places(run.observed[rows]),
                **places,
            }
        )
    return {"series": ["recorded", *(_class(side, shown) for side in shown)], "runs": told}


def _places(marble: Array) -> list[list[float] | None]:
    return [
        [round(x, _DIGITS), round(y, _DIGITS)] if np.isfinite(x) and np.isfinite(y) else None
        for x, y in marble.tolist()
    ]


def _json(data: dict[str, Any]) -> str:
    """Return JSON that no parser of HTML takes for the end of the element."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _svg(model: Model, names: Sequence[str]) -> str:
    """Return the empty board: rim, reach of the marble's centre, and what the script moves."""
    rim = _SCALE * rim_of(model)
    radius = 2 * rim[0] * model.marble.radius_m / model.board.edge_x_m
    half = rim + 0.03 * _SCALE
    view = f"{-half[0]:.0f} {-half[1]:.0f} {2 * half[0]:.0f} {2 * half[1]:.0f}"
    marks = [f'<polyline class="ghost {name}"/>' for name in names]
    marks += [f'<g class="trail {name}"></g>' for name in names]
    # The recorded marble is a disc, predictions are rings: a good one stays around the disc.
    for number, name in enumerate(names):
        marks.append(f'<circle class="marble {name}" r="{radius + 4 * (number > 0):.1f}"/>')
    return (
        f'<svg viewBox="{view}" role="img" aria-label="the board from above, with moving marbles">'
        f"{_rectangle('rim', rim)}{_rectangle('reach', rim - radius)}{''.join(marks)}</svg>"
    )


def _rectangle(name: str, half: Array) -> str:
    x, y = half
    return f'<rect class="{name}" x="{-x:.1f}" y="{-y:.1f}" width="{2 * x:.1f}" height="{2 * y:.1f}" rx="4"/>'


def _controls(runs: Sequence[RunProof]) -> str:
    options = "".join(f'<option value="{i}">{escape(run.recording)}</option>' for i, run in enumerate(runs))
    speeds = "".join(
        f'<option value="{speed:g}"{" selected" if speed == 1 else ""}>{speed:g}&times;</option>'
        for speed in _SPEEDS
    )
    return (
        '<div class="controls"><button type="button" class="play">Play</button>'
        '<input class="time" type="range" min="0" value="0" step="1" aria-label="time">'
        '<output class="clock">0.0 s</output>'
        f'<label>run <select class="run">{options}</select></label>'
        f'<label>speed <select class="speed">{speeds}</select></label></div>'
    )


def _legend(shown: Sequence[Side]) -> str:
    items = ['<li><strong class="recorded">● recorded</strong></li>']
    for side in shown:
        name = _class(side, shown)
        items.append(
            f'<li><strong class="{name}">○ {escape(side.label)}</strong>, now off by '
            f'<output class="off {name}" aria-live="off">-</output> of the edge</li>'
        )
    return f'<ul class="legend">{"".join(items)}</ul>'
