"""What the path-traced runs show: boards, lamps, marbles and cameras by kind, drawn from a run's number."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracking.sets import STEEP, rolled
from tracking.view import Array, View

Texture = NDArray[np.float32]

EDGES_M = (0.276, 0.231)
RADIUS_M = 0.00685
#: Texels to a metre of the board.
FINE = 5000.0
#: Runs from this number on are for scoring, and not looked at while the tracker is worked on.
FROZEN = 100
PICTURES = 100
#: From this number on a run has, by turns, something of `CAMERAS` as well.
CAMERAS_FROM = 400
CAMERAS = ("arm", "h264", "rolling", "webcam", "broken")
KINDS = ("steel", "beige", "glass", "bands", "glare", "printed", "large", "small")
#: From this number on runs are of these kinds, and have by turns one of these cameras.
LOOKS_FROM = 600
LOOKS = ("faint", "square", "thick", "1080p", "grey", "rimmed", "white", "dark")
LOOKS_CAMERAS = ("plain", "webcam", "arm", "rolling", "mpeg4")


@dataclass(frozen=True)
class Shine:
    """A marble's surface: `steel`, `glass` or `painted`, its linear colour, its roughness, and its spots."""

    kind: str
    colour: tuple[float, float, float] = (0.9, 0.9, 0.9)
    rough: float = 0.05
    spots: float = 0.0

    def texture(self) -> Texture:
        """Return the paint (h, w, 3): a real marble is never of one colour throughout."""
        random = np.random.default_rng(3)
        noise = cv2.GaussianBlur(random.standard_normal((64, 128)).astype(np.float32), (0, 0), 5)
        spots = 1.0 - self.spots * (noise > noise.std())[..., None]
        return np.asarray(np.array(self.colour, np.float32) * spots, dtype=np.float32)


@dataclass(frozen=True)
class Lamp:
    """A square lamp: its place [m], half its side [m], its strength and linear colour."""

    name: str
    place: Array
    half_m: float
    strength: float
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Case:
    """All that a run is rendered from.

    Attributes
    ----------
    places, tilts : (n, 2) arrays
        Of the marble [board edges], and of the board [rad].
    edges_m : tuple
        Of the board [m].
    slab_m, slab_colour : float, tuple
        Thickness of the board [m], and the linear colour of its edges, by default that of the rim.
    wood : tuple
        Linear colour of the board, or nothing for one that is printed white.
    varnish, grain : float
        Roughness of the board's gloss, 0 for none; depth of its grain.
    printed : bool
        Whether maze lines and holes are on it.
    rim : bool
        Whether a rim stands about the board.
    day : float
        Light from the room's window.
    bands, drift, hunting : float
        Depth of shadows that pass, change of the daylight, and of the exposure, as shares.
    open : float
        Share of the time between pictures that the shutter is open.
    shot, read : float
        Noise that grows with the light, and that does not, as shares of full light.
    arm : float
        Depth of the shadow of an arm that reaches over the board and turns, as a share.
    readout : float
        From the first row of a picture to the last, as a share of the time between pictures.
    codec : str
        `png`, `MJPG`, `mp4v` or `h264`.
    quality : int
        Of MJPEG, to 100.
    kbps : int
        Of H.264 [kbit/s].
    broken : int
        Bytes of the video that are flipped.
    """

    seed: int
    kind: str
    view: View
    places: Array
    tilts: Array
    shine: Shine
    lamps: tuple[Lamp, ...]
    radius_m: float = RADIUS_M
    edges_m: tuple[float, float] = EDGES_M
    slab_m: float = 0.006
    slab_colour: tuple[float, float, float] | None = None
    wood: tuple[float, float, float] | None = (0.55, 0.36, 0.20)
    varnish: float = 0.0
    grain: float = 0.25
    printed: bool = False
    rim: bool = False
    rim_colour: tuple[float, float, float] = (0.30, 0.18, 0.09)
    table_colour: tuple[float, float, float] = (0.03, 0.03, 0.035)
    table_m: float = 0.05
    day: float = 0.25
    bands: float = 0.0
    drift: float = 0.0
    hunting: float = 0.0
    open: float = 0.0
    blur: float = 0.7
    shot: float = 0.012
    read: float = 0.003
    arm: float = 0.0
    readout: float = 0.0
    codec: str = "png"
    quality: int = 95
    kbps: int = 1500
    broken: int = 0
    turns: Array = field(default_factory=lambda: np.eye(3)[None])

    @property
    def changes(self) -> bool:
        """Whether lamps change beside each other."""
        return self.bands > 0 or self.drift > 0 or self.arm > 0

    def moments(self, count: int) -> tuple[float, ...]:
        """Return the moments of an exposure, from its middle [pictures]."""
        if self.open == 0.0:
            return (0.0,)
        return tuple(self.open * ((one + 0.5) / count - 0.5) for one in range(count))

    def place_at(self, moment: float) -> Array:
        """Return the marble's place (2,) between pictures [board edges]."""
        times = np.arange(len(self.places))
        return np.array([np.interp(moment, times, self.places[:, axis]) for axis in range(2)])

    def turn_at(self, moment: float) -> Array:
        """Return how the marble has rolled (3, 3)."""
        return np.asarray(self.turns[int(np.clip(round(moment), 0, len(self.turns) - 1))])

    def tilt_at(self, moment: float) -> Array:
        """Return the board's tilt (2,) between pictures [rad]."""
        times = np.arange(len(self.tilts))
        return np.array([np.interp(moment, times, self.tilts[:, axis]) for axis in range(2)])

    def strengths(self, index: int) -> dict[str, float]:
        """Return the strength of each group of lamps in a picture, over the usual one."""
        cloud = np.sin(2 * np.pi * (index / 70.0 + 0.1 * self.seed))
        return {"lamp": 1.0, "day": 1.0 + self.drift * cloud}

    def exposure(self, index: int) -> float:
        """Return the camera's gain in a picture."""
        return 1.0 + self.hunting * float(np.sin(2 * np.pi * index / 37.0) * np.sin(2 * np.pi * index / 90.0))

    def shade(self, index: int) -> Texture:
        """Return the share of the first lamp's light (h, w, 1) that what passes before it leaves."""
        height, width = self.view.height, self.view.width
        down, right = np.mgrid[:height, :width].astype(np.float32)
        shade = np.ones((height, width), np.float32)
        if self.bands:
            random = np.random.default_rng([self.seed, 8])
            for _ in range(3):
                way, speed, start = (
                    random.uniform(0, np.pi),
                    random.uniform(-5.0, 5.0),
                    random.uniform(0, 900),
                )
                broad, soft = random.uniform(25.0, 80.0), random.uniform(4.0, 14.0)
                along = np.cos(way) * right + np.sin(way) * down
                away = np.abs((along - start - speed * index) % 900.0 - 450.0) - broad
                shade *= 1.0 - self.bands / (1.0 + np.exp(np.clip(away / soft, -30, 30)))
        if self.arm:
            random = np.random.default_rng([self.seed, 9])
            shoulder = np.array([random.uniform(0.2, 0.8) * width, -0.1 * height])
            turn = 0.5 * np.sin(2 * np.pi * index / random.uniform(40, 90) + random.uniform(0, 6))
            reach = height * (0.65 + 0.25 * np.sin(2 * np.pi * index / random.uniform(50, 110)))
            toward = np.array([np.sin(turn), np.cos(turn)])
            along = np.clip((right - shoulder[0]) * toward[0] + (down - shoulder[1]) * toward[1], 0.0, reach)
            away = np.hypot(right - shoulder[0] - along * toward[0], down - shoulder[1] - along * toward[1])
            soft = random.uniform(3.0, 10.0)
            shade *= 1.0 - self.arm / (1.0 + np.exp(np.clip((away - 0.07 * height) / soft, -30, 30)))
        return np.asarray(shade[..., None], dtype=np.float32)

    def texture(self) -> Texture:
        """Return the board's linear colour (h, w, 3), its first row along the edge of least y."""
        random = np.random.default_rng([self.seed, 4])
        width, height = (round(FINE * edge) for edge in self.edges_m)
        across = np.arange(height, dtype=np.float32)[:, None] / FINE
        along = np.arange(width, dtype=np.float32)[None, :] / FINE
        bend = cv2.GaussianBlur(random.standard_normal((height, width)).astype(np.float32), (0, 0), 120)
        bend = 0.010 * bend / bend.std()
        rings = np.sin(2 * np.pi * (across + 0.05 * along + bend) / 0.011)
        pores = cv2.GaussianBlur(
            random.standard_normal((height, width)).astype(np.float32), (0, 0), 30, sigmaY=1.5
        )
        pores = pores / pores.std()
        colour = np.array(self.wood or (0.75, 0.75, 0.73), np.float32)
        grain = self.grain if self.wood else 0.02
        board = colour * np.exp(grain * (0.5 * rings + 0.35 * pores))[..., None]
        if self.printed:
            for _ in range(9):
                ends = random.uniform([0.05, 0.05], [0.95, 0.95], (2, 2))
                ends[1, random.integers(2)] = ends[0, random.integers(1)]
                points = (ends * [width, height]).astype(int)
                cv2.line(
                    board,
                    tuple(map(int, points[0])),
                    tuple(map(int, points[1])),
                    (0.04, 0.04, 0.04),
                    round(0.0018 * FINE),
                    cv2.LINE_AA,
                )
            for place in random.uniform([0.1, 0.1], [0.9, 0.9], (12, 2)) * [width, height]:
                cv2.circle(
                    board, tuple(map(int, place)), round(0.0075 * FINE), (0.02, 0.02, 0.02), -1, cv2.LINE_AA
                )
            inset = round(0.004 * FINE)
            cv2.rectangle(
                board,
                (inset, inset),
                (width - inset, height - inset),
                (0.04, 0.04, 0.04),
                round(0.0015 * FINE),
            )
        return np.asarray(np.clip(board, 0.0, 0.95), dtype=np.float32)

    def room(self) -> Texture:
        """Return the light of the room (h, w, 3): a window, a ceiling, a dark floor."""
        random = np.random.default_rng([self.seed, 6])
        room = np.full((64, 128, 3), 0.6, np.float32)
        room[:20] = 1.0
        room[36:] = 0.25
        left = int(random.integers(0, 100))
        room[14:32, left : left + 18] = (3.4, 3.8, 4.4)
        return np.asarray(room * self.day, dtype=np.float32)


def case(number: int, pictures: int = PICTURES) -> Case:
    """Return a run by its number: its kind is that modulo the number of kinds."""
    random = np.random.default_rng([number, 77])
    kind = KINDS[number % len(KINDS)] if number < LOOKS_FROM else LOOKS[number % len(LOOKS)]
    # Thirty pictures a second of a run with sixty rows, without its slow beginning.
    _, tilts, places = (rows[20::2] for rows in rolled(2 * pictures + 20, 4000 + number, STEEP))
    side = random.uniform(0, 2 * np.pi)
    low = random.uniform(0.5, 0.9)
    lamp = Lamp(
        "lamp",
        np.array([0.8 * np.cos(side), 0.8 * np.sin(side), low]),
        random.uniform(0.03, 0.06),
        random.uniform(2.0, 2.6),
    )
    lean = tuple(random.uniform(-0.2, 0.2, 2))
    usual = Case(
        seed=number,
        kind=kind,
        view=View.above(
            random.uniform(300, 380),
            focal=random.uniform(650, 900),
            lean=lean,
            turn=random.uniform(-0.08, 0.08),
        ),
        places=places,
        tilts=tilts,
        turns=turns_of(places),
        shine=Shine("steel", rough=0.06),
        lamps=(lamp,),
        wood=tuple(random.uniform(0.85, 1.15) * np.array([0.50, 0.33, 0.18])),
        grain=random.uniform(0.15, 0.35),
    )
    if number >= LOOKS_FROM:
        camera = LOOKS_CAMERAS[(number + number // len(LOOKS)) % len(LOOKS_CAMERAS)]
        run = replace(_looks(kind, usual, random), codec="MJPG", quality=85)
        run = _before(camera, run, random)
        # A webcam sends large pictures in MPEG.
        return replace(run, codec="mp4v") if kind == "1080p" else run
    run = _as(kind, usual, random)
    if number >= CAMERAS_FROM:
        return _before(CAMERAS[(number + number // len(KINDS)) % len(CAMERAS)], run, random)
    return run


def _as(kind: str, usual: Case, random: np.random.Generator) -> Case:
    """Return a case with what its kind is about."""
    second = Lamp(
        "second", np.array([-0.7, 0.5, 0.8]) * random.uniform(0.8, 1.2, 3), 0.05, 1.2, (1.0, 0.85, 0.6)
    )
    paints = {"blue": (0.04, 0.09, 0.45), "red": (0.5, 0.05, 0.04), "green": (0.05, 0.3, 0.08)}
    paint = paints[("blue", "red", "green")[int(random.integers(3))]]
    eye = usual.view.eye
    if kind in ("bands", "printed"):
        usual = replace(usual, lamps=(usual.lamps[0], second))
    changes: dict[str, dict[str, Any]] = {
        "steel": {},
        "beige": {
            "shine": Shine("painted", tuple(1.25 * np.array(usual.wood)), 0.1, 0.15),
            "codec": "MJPG",
        },
        "glass": {"shine": Shine("glass", (0.8, 0.95, 0.85)), "table_colour": (0.45, 0.45, 0.45)},
        "bands": {"shine": Shine("painted", paint, 0.08), "bands": random.uniform(0.4, 0.7), "hunting": 0.05},
        "glare": {
            "shine": Shine("painted", paint, 0.05, 0.4),
            "varnish": random.uniform(0.08, 0.15),
            "lamps": (
                Lamp("lamp", eye * [-0.9, -0.9, 0.9] + [*random.uniform(-0.1, 0.1, 2), 0.0], 0.08, 2.2),
            ),
        },
        "printed": {
            "wood": None,
            "printed": True,
            "rim": True,
            "rim_colour": (0.4, 0.25, 0.12),
            "drift": 0.4,
            "shine": Shine("painted", paint, 0.1),
            "codec": "mp4v",
        },
        "large": {
            "view": View.above(
                random.uniform(560, 640), focal=1300.0, lean=(0.1, -0.15), turn=0.04, size=(1280, 720)
            ),
            "radius_m": 0.0075,
            "printed": True,
            "rim": True,
            "codec": "MJPG",
            "open": 0.4,
        },
        "small": {
            "view": View.above(
                random.uniform(230, 270), focal=600.0, lean=tuple(random.uniform(-0.3, 0.3, 2))
            ),
            "radius_m": 0.005,
            "shine": Shine("painted", paint, 0.1),
            "open": 0.5,
            "shot": 0.03,
            "read": 0.012,
            "codec": "mp4v",
        },
    }
    return replace(usual, **changes[kind])


def _looks(kind: str, usual: Case, random: np.random.Generator) -> Case:
    """Return a case of one of `LOOKS`: bare boards, marbles like their board, rims, thick edges."""
    lean = tuple(random.uniform(-0.25, 0.25, 2))
    board = np.array([(0.40, 0.40, 0.40), (0.62, 0.55, 0.42), (0.12, 0.28, 0.14)][int(random.integers(3))])
    paint = tuple(random.uniform(0.03, 0.6, 3))
    black = Shine("painted", (0.03, 0.03, 0.03), 0.1)
    printed = bool(random.integers(2))
    lamps = tuple(replace(lamp, half_m=random.uniform(0.04, 0.15)) for lamp in usual.lamps)
    changes: dict[str, dict[str, Any]] = {
        "faint": {
            "wood": tuple(board),
            "grain": 0.0,
            "shine": Shine("painted", tuple(random.uniform(0.85, 1.2) * board), 0.3),
            "lamps": lamps,
            "day": random.uniform(0.25, 0.6),
        },
        "square": {
            "edges_m": (EDGES_M[0], EDGES_M[0]),
            "view": View.above(random.uniform(260, 310), focal=random.uniform(600, 850), lean=lean),
            "rim": True,
            "printed": printed,
            "shine": Shine("painted", paint, 0.1),
        },
        "thick": {
            "slab_m": random.uniform(0.008, 0.014),
            "slab_colour": (0.6, 0.58, 0.52),
            "wood": None,
            "view": View.above(random.uniform(300, 380), focal=random.uniform(650, 900), lean=lean),
            "shine": Shine("painted", paint, 0.1),
        },
        "1080p": {
            "slab_m": random.uniform(0.004, 0.012),
            "slab_colour": (0.7, 0.7, 0.68),
            "wood": None,
            "printed": printed,
            "view": View.above(
                random.uniform(850, 950),
                focal=random.uniform(1700, 2200),
                lean=lean,
                turn=random.uniform(-0.05, 0.05),
                size=(1920, 1080),
            ),
            "shine": Shine("painted", paint, 0.1),
        },
        "grey": {"wood": tuple(np.full(3, random.uniform(0.15, 0.5))), "grain": 0.0, "lamps": lamps},
        "rimmed": {
            "rim": True,
            "rim_colour": tuple(random.uniform(0.2, 1.3) * np.array(usual.wood)),
            "shine": Shine("painted", paint, 0.1),
        },
        "white": {
            "wood": None,
            "printed": printed,
            "shine": Shine("painted", (0.75, 0.75, 0.73), 0.2),
        },
        "dark": {
            "wood": (0.04, 0.04, 0.045),
            "table_colour": (0.45, 0.45, 0.45),
            "slab_colour": (0.04, 0.04, 0.045),
            "shine": black if random.integers(2) else usual.shine,
        },
    }
    return replace(usual, **changes[kind])


def _before(camera: str, run: Case, random: np.random.Generator) -> Case:
    """Return a case before another camera, or with an arm over it."""
    if camera == "arm":
        return replace(run, arm=random.uniform(0.4, 0.75))
    if camera == "rolling":
        return replace(run, readout=random.uniform(0.5, 0.9), open=0.3)
    if camera == "plain":
        return run
    if camera == "mpeg4":
        return replace(run, codec="mp4v", open=0.4)
    if camera == "webcam":
        return replace(run, codec="MJPG", quality=60, shot=0.025, read=0.008, hunting=0.08)
    return replace(run, codec="h264", kbps=900, broken=6 if camera == "broken" else 0)


def turns_of(places: Array) -> Array:
    """Return how a marble that rolls through places (n, 2) [board edges] has turned (n, 3, 3)."""
    turns = [np.eye(3)]
    for step in np.diff(places, axis=0) * EDGES_M[0] / RADIUS_M:
        turn, _ = cv2.Rodrigues(np.array([-step[1], step[0], 0.0]))
        turns.append(turn @ turns[-1])
    return np.array(turns)
