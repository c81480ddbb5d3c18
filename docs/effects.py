"""Write docs/effects.md and draw what each effect does to the paper's drive: run by `make pictures`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from irt.catalogue import EffectInfo, EffectParameter, effects
from irt.engine import SUBSTEP_S, paper_drive, rollouts
from irt.report import style
from irt.rig import Board, Marble

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "effects.md"
PICTURES = DOCS / "effects"

#: A marble that keeps off the rim, one that does not, one that nearly sticks (the order of `irt.rollouts`).
GENTLE = (0.03, 0.035, 3e-4, 20.0, 1.0)
LIVELY = (0.09, 0.1, 3e-4, 20.0, 1.0)
STICKY = (0.02, 0.02, 8e-4, 20.0, 1.0)
#: How far from neutral towards the end of its range an effect is drawn: the least that shows, in board edges.
PARTS, SHOWS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0), 0.06
#: The effect that does not show under the paper's drive.
JUMPING = "inertial_forces"
OPENING = """\
# Physical effects

The catalogue of physics beyond the five parameters, in the order in which effects act, from the command to
the picture. `make pictures` writes this page from the engine's catalogue; `irt.effects()` returns the same
data. A range is where a search looks. At its neutral values an effect changes no bit of a rollout. Optional
parameters stay neutral in every fit that does not name them. The diagnosis does not try effects marked "not a
hypothesis", except `slope_map`, as a last resort, and `inertial_forces`, which it never names. The pictures
show the paper's drive, 100 rows of 20 physics updates each: grey without the effect, blue with it, at the
values given below. That of `inertial_forces`, which need faster commands, shows jumps between two limits.

```python
irt.rollouts(parameters, irt.paper_drive(), effects=[{"name": "lag", "time_constant_s": 0.3}])
```
"""

Array = NDArray[np.float64]


def example(effect: EffectInfo) -> tuple[dict[str, float], Array, Array]:
    """Return values at which an effect shows, and the paths (100, 2) without and with it [board edges].

    Of an effect that changes no path it is the measured tilt [rad].
    """
    values: dict[str, float] = {}
    base = changed = np.zeros((100, 2))
    jumps = effect.name == JUMPING
    commands, start = (jumping_drive(), (0.25, 0.15)) if jumps else (paper_drive(), (0.0, 0.0))
    for parameters in (LIVELY,) if jumps else (GENTLE, LIVELY, STICKY):
        base = rollouts([parameters], commands, start=start)[0]
        for part in PARTS:
            values = {one.name: _value(one, part) for one in effect.required}
            acting = [{"name": effect.name, **values}]
            changed = rollouts([parameters], commands, effects=acting, start=start)[0]
            if np.abs(changed - base).max() > SHOWS:
                return values, base, changed
    if _is_of_tilt(effect, values):
        measured = [{"name": effect.name, **values}]
        base = rollouts([GENTLE], paper_drive(), tilt=True)[1][0]
        changed = rollouts([GENTLE], paper_drive(), effects=measured, tilt=True)[1][0]
    return values, base, changed


def jumping_drive() -> Array:
    """Return commands (100, 2) [rad] that jump between limits and keep the marble near its place."""
    return np.asarray(0.15 * np.sign(np.cos(2.0 * np.pi * (np.arange(100)[:, None] + 0.5) / [8.0, 12.0])))


def _is_of_tilt(effect: EffectInfo, values: dict[str, float]) -> bool:
    """Whether an effect changes no path, but what is measured of the tilt."""
    plain = rollouts([LIVELY], paper_drive())
    return np.array_equal(rollouts([LIVELY], paper_drive(), effects=[{"name": effect.name, **values}]), plain)


def _value(parameter: EffectParameter, part: float) -> float:
    """Return a value between the least and the greatest effect, in two digits."""
    low, high, neutral = parameter.low, parameter.high, parameter.neutral
    if math.isinf(neutral):
        value = high * (low / high) ** part
    elif low <= neutral <= high:
        value = neutral + part * (high - neutral)
    else:
        value = low + part * (high - low)
    return min(max(float(f"{value:.2g}"), low), high)


def draw(effect: EffectInfo) -> str:
    """Draw what an effect does into an SVG; return the values it is drawn at."""
    values, base, changed = example(effect)
    board, radius = Board(), Marble().radius_m
    half_x, half_y = (edge / 2 / board.edge_x_m for edge in (board.edge_x_m, board.edge_y_m))
    axis = int(np.abs(changed - base).max(axis=0).argmax())
    seconds = np.arange(len(base)) * GENTLE[3] * SUBSTEP_S
    with style.drawing(PICTURES / f"{effect.name}.svg", style.WIDTH, 1.8) as figure:
        if _is_of_tilt(effect, values):
            over_time = figure.subplots()
            for tilt, colour in ((base, style.MUTED), (changed, style.TUNED)):
                over_time.plot(seconds, tilt[:, axis], color=colour)
            over_time.set(xlabel="time  [s]", title=f"measured tilt about {'xy'[axis]}  [rad]")
            _name_lines(over_time)
            return _with_units(effect, values)
        above, over_time = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
        rim = Rectangle((-half_x, -half_y), 2 * half_x, 2 * half_y, fill=False, ec=style.MUTED, lw=0.7)
        above.add_patch(rim)
        for path, colour in ((base, style.MUTED), (changed, style.TUNED)):
            above.plot(*path.T, color=colour)
            over_time.plot(seconds, path[:, axis], color=colour)
        # A camera may see the marble beyond the rim.
        seen = np.max([np.abs(path).max(axis=0) for path in (base, changed)], axis=0)
        far_x, far_y = np.maximum(seen, (half_x, half_y)) * (1.05 + radius)
        above.set(xlim=(-far_x, far_x), ylim=(-far_y, far_y))
        above.set(aspect="equal", xticks=[], yticks=[], title="from above")
        above.grid(visible=False)
        above.spines[:].set_visible(False)
        over_time.set(xlabel="time  [s]", title=f"{'xy'[axis]}  [edges]")
        _name_lines(over_time)
    return _with_units(effect, values)


def _name_lines(axes: Axes) -> None:
    axes.set_title("without", loc="center", color=style.MUTED)
    axes.set_title("with", loc="right", color=style.TUNED)


def _with_units(effect: EffectInfo, values: dict[str, float]) -> str:
    """Return values with their units."""
    units = {one.name: one.unit for one in effect.parameters}
    return ", ".join(f"`{name}` = {value:g} {units[name]}".rstrip() for name, value in values.items())


def section(effect: EffectInfo, drawn_at: str) -> str:
    """Return an effect's part of the page."""
    lines = [
        f"## {effect.name}",
        f"*{effect.stage}* · `{effect.equation}`" + ("" if effect.hypothesis else " · not a hypothesis"),
        effect.does,
        f"**When it matters.** {effect.matters}",
        f"**What it looks like.** {effect.looks}",
        "\n".join(_table(effect)),
        f"![{effect.name}: the marble's path without and with it](effects/{effect.name}.svg)",
        f"Drawn at {drawn_at}.",
        "\n".join(f"- {reference}" for reference in effect.references),
    ]
    return "\n\n".join(lines)


def _table(effect: EffectInfo) -> Iterator[str]:
    yield "| parameter | unit | range | neutral | |"
    yield "| --- | --- | --- | ---: | --- |"
    for one in effect.parameters:
        note = ("optional: " if one.optional else "") + one.doc
        if not one.is_choice and one.reach != (one.low, one.high):
            note += f"; a fit goes from {one.reach[0]:g} to {one.reach[1]:g}"
        yield f"| `{one.name}` | {one.unit} | {one.searched} | {one.neutral:g} | {note} |"


def page(drawn_at: dict[str, str]) -> str:
    """Return the whole page; `drawn_at` has the values of each picture."""
    catalogue = effects()
    contents = "\n".join(f"- [{one.name}](#{one.name}) ({one.stage})" for one in catalogue)
    parts = [OPENING, contents + "\n", *(section(one, drawn_at[one.name]) + "\n" for one in catalogue)]
    return "\n".join(parts)


if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    PAGE.write_text(page({one.name: draw(one) for one in effects()}), encoding="utf-8")
    print(f"wrote {PAGE} and {len(effects())} pictures beside it")
