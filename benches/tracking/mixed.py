"""Path-traced runs in which board, marble, lamps and camera are drawn independently of each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracking.cases import EDGES_M, PICTURES, Case, Lamp, Shine, turns_of
from tracking.sets import STEEP, rolled
from tracking.view import View

#: Runs from this number on are of this kind.
MIXED_FROM = 700
#: Boards and marbles, with how often each is drawn.
BOARDS = {"wood": 0.3, "maze": 0.25, "white": 0.15, "grey": 0.15, "black": 0.15}
MARBLES = {"steel": 0.4, "paint": 0.35, "glass": 0.1, "white": 0.075, "black": 0.075}
CODECS = {"MJPG": 0.4, "h264": 0.3, "mp4v": 0.2, "png": 0.1}
#: Least distance of the level board's corners from the edge of the picture [pixels].
MARGIN_PX = 15.0


def mixed(number: int, pictures: int = PICTURES) -> Case:
    """Return a run by its number."""
    random = np.random.default_rng([number, 78])
    _, tilts, places = (rows[20::2] for rows in rolled(2 * pictures + 20, 5000 + number, STEEP))
    board, marble, codec = (_drawn(random, one) for one in (BOARDS, MARBLES, CODECS))
    wood = np.array([0.50, 0.33, 0.18]) * random.uniform(0.5, 1.2)
    looks: dict[str, dict[str, Any]] = {
        "wood": {"wood": tuple(wood), "grain": random.uniform(0.1, 0.35), "printed": random.random() < 0.3},
        "maze": {"wood": None, "printed": True},
        "white": {"wood": None},
        "grey": {"wood": tuple(random.uniform(0.15, 0.5) * random.uniform(0.8, 1.2, 3)), "grain": 0.0},
        "black": {"wood": tuple(random.uniform(0.03, 0.06, 3)), "grain": random.choice([0.0, 0.15])},
    }
    slab = random.uniform(0.02, 0.6)
    return Case(
        seed=number,
        kind=f"{board} {marble}",
        view=_view(random),
        places=places,
        tilts=tilts,
        turns=turns_of(places),
        shine=_shine(marble, random),
        lamps=_lamps(random),
        radius_m=random.uniform(0.005, 0.0085),
        slab_m=random.uniform(0.003, 0.01),
        slab_colour=tuple(slab * random.uniform(0.7, 1.3, 3)),
        varnish=_sometimes(random, 0.35, 0.06, 0.2),
        rim=bool(random.random() < 0.15),
        table_colour=tuple(random.uniform(0.02, 0.5) * random.uniform(0.8, 1.2, 3)),
        day=random.uniform(0.1, 0.6),
        bands=_sometimes(random, 0.15, 0.3, 0.7),
        arm=_sometimes(random, 0.35, 0.3, 0.75),
        drift=_sometimes(random, 0.2, 0.1, 0.4),
        hunting=_sometimes(random, 0.2, 0.02, 0.08),
        open=_sometimes(random, 0.5, 0.2, 0.6),
        readout=_sometimes(random, 0.4, 0.3, 0.9),
        blur=random.uniform(0.5, 1.0),
        shot=random.uniform(0.008, 0.03),
        read=random.uniform(0.002, 0.01),
        codec=codec,
        quality=int(random.integers(65, 96)),
        kbps=int(random.integers(900, 3000)),
        **looks[board],
    )


def _drawn(random: np.random.Generator, shares: dict[str, float]) -> str:
    """Return a name by its share."""
    return str(random.choice(list(shares), p=list(shares.values())))


def _sometimes(random: np.random.Generator, share: float, low: float, high: float) -> float:
    """Return a value between two in this share of the runs, else 0."""
    value = random.uniform(low, high)
    return value if random.random() < share else 0.0


def _view(random: np.random.Generator) -> View:
    """Return a camera that stands askew, and has the whole board in its picture."""
    x, y = EDGES_M[0] / 2, EDGES_M[1] / 2
    flat = np.array([[-x, y, 0], [x, y, 0], [x, -y, 0], [-x, -y, 0.0]])
    while True:
        view = View.above(
            random.uniform(280, 400),
            focal=random.uniform(550, 950),
            lean=tuple(random.uniform(-0.45, 0.45, 2)),
            turn=random.uniform(-0.25, 0.25),
        )
        seen = view.project(flat)
        if (seen >= MARGIN_PX).all() and (seen <= np.array([view.width, view.height]) - MARGIN_PX).all():
            return view


def _shine(marble: str, random: np.random.Generator) -> Shine:
    """Return a marble's surface."""
    rough = random.uniform(0.04, 0.2)
    if marble == "steel":
        return Shine("steel", rough=random.uniform(0.02, 0.15))
    if marble == "glass":
        return Shine("glass", tuple(random.uniform(0.7, 1.0, 3)))
    if marble == "paint":
        return Shine("painted", tuple(random.uniform(0.02, 0.6, 3)), rough, _sometimes(random, 0.3, 0.2, 0.5))
    level = 0.75 if marble == "white" else 0.03
    return Shine("painted", (level, level, level), rough)


def _lamps(random: np.random.Generator) -> tuple[Lamp, ...]:
    """Return one lamp or two, in any direction at 35 to 75 degrees above the board."""
    lamps = []
    for name in ("lamp", "second")[: 1 + int(random.random() < 0.5)]:
        side, height = random.uniform(0, 2 * np.pi), np.radians(random.uniform(35, 75))
        away = random.uniform(0.7, 1.2)
        level = np.array([np.cos(side), np.sin(side)]) * np.cos(height)
        place = away * np.array([*level, np.sin(height)])
        strength = 2.2 * away**2 * (1.0 if name == "lamp" else random.uniform(0.3, 0.9))
        colour = (1.0, random.uniform(0.8, 1.0), random.uniform(0.6, 1.0))
        lamps.append(Lamp(name, place, random.uniform(0.03, 0.1), strength, colour))
    return tuple(lamps)
