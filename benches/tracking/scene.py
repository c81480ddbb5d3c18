"""A ray-traced marble on a tilting board: pictures whose truth is known.

Light is added up linearly, each pixel of the marble from many rays over the exposure, its rows at the times
at which a rolling shutter reads them; then the lens blurs, the camera's curve (a square root, close to what
cameras do) bends, and noise is added, as large in shadows as in light.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from tracking.board import FINE, Paint, painted
from tracking.view import Array, View, turned

Picture = NDArray[np.uint8]
Linear = NDArray[np.float32]

EDGES_M = (0.276, 0.231)
RADIUS_M = 0.00685
MARBLES = {"blue": (0.04, 0.10, 0.62), "red": (0.60, 0.05, 0.04), "green": (0.04, 0.42, 0.10)}
STEEL = "steel"
#: Rays to a pixel's side.
RAYS = 4


@dataclass(frozen=True)
class Look:
    """Light and camera of a scene.

    Attributes
    ----------
    marble : str
        One of `MARBLES`, or `STEEL`, which mirrors lamps and board.
    light : tuple
        Towards the lamp, from the board; its length does not matter.
    ambient, highlight : float
        Share of light that comes from everywhere; strength of the lamp's mirror image.
    gradient, flicker : float
        Change of light over the picture, and from picture to picture (standard deviation), as shares.
    blur, noise : float
        Standard deviations of the lens's blur [pixels] and of the noise [levels].
    exposure, readout : float
        Share of the time between pictures that the shutter is open, and that reading the rows takes.
    jpeg : int
        Quality of a compression on the way, or 0.
    ground : tuple
        Linear colour of what is beside the board.
    """

    marble: str = "blue"
    light: tuple[float, float, float] = (0.3, 0.2, 1.0)
    ambient: float = 0.5
    highlight: float = 0.6
    gradient: float = 0.05
    flicker: float = 0.0
    blur: float = 0.6
    noise: float = 2.0
    exposure: float = 0.0
    readout: float = 0.0
    jpeg: int = 0
    ground: tuple[float, float, float] = (0.03, 0.025, 0.02)


@dataclass(frozen=True)
class Finger:
    """A gripper's finger that reaches over the board.

    Attributes
    ----------
    colour : tuple
        Linear.
    width_px : float
        Across.
    ball : bool
        Whether a shiny ball of the marble's size sits on its tip.
    """

    colour: tuple[float, float, float] = (0.12, 0.12, 0.13)
    width_px: float = 46.0
    ball: bool = False


@dataclass(frozen=True)
class Truth:
    """The marble's middle in a picture [pixels], its place [board edges], and the share of it seen."""

    pixel: Array
    place: Array
    visible: float


@dataclass(frozen=True)
class Scene:
    """A run to be rendered.

    Attributes
    ----------
    view, paint, look : View, Paint, Look
        Camera, board, light.
    places : (n, 2) array
        The marble's places [board edges], one for each picture; NaN where there is none.
    tilts : (n, 2) array
        The board's angles [rad].
    finger : Finger or None
        What comes between.
    seed : int
        Of noise, wood, and the finger's way.
    """

    view: View
    paint: Paint
    look: Look
    places: Array
    tilts: Array
    finger: Finger | None = None
    seed: int = 0
    second: Array | None = field(default=None)

    def __len__(self) -> int:
        return len(self.places)

    def frames(self) -> Iterator[tuple[Picture, Truth]]:
        """Yield pictures (h, w, 3) in OpenCV's order, blue first, and what they show."""
        for index in range(len(self)):
            yield self.frame(index)

    def frame(self, index: int) -> tuple[Picture, Truth]:
        """Render one picture."""
        random = np.random.default_rng([self.seed, index])
        picture = self._board(self.tilts[index])
        truth, box, cover = self._marble(picture, index, self.places)
        if self.second is not None:
            self._marble(picture, index, self.second)
        hidden = self._finger(picture, index)
        if hidden is not None and cover is not None and cover.sum() > 0:
            seen = float((cover * (1.0 - hidden[box])).sum() / cover.sum())
            truth = Truth(truth.pixel, truth.place, seen)
        return self._exposed(picture, random), truth

    def corners(self) -> Array:
        """Return the level board's corners (4, 2) [pixels], clockwise from the top left."""
        half_x, half_y = EDGES_M[0] / 2, EDGES_M[1] / 2
        return self.view.project(
            np.array([[-half_x, half_y, 0], [half_x, half_y, 0], [half_x, -half_y, 0], [-half_x, -half_y, 0]])
        )

    @cached_property
    def _texture(self) -> tuple[Linear, float]:
        """The board's paint as coarse as the camera sees it, with its cover; texels to a metre."""
        paint = painted(self.paint, EDGES_M, RADIUS_M, self.seed)
        per_metre = 1.5 * self.view.focal / float(np.linalg.norm(self.view.eye))
        shrunk = (round(paint.shape[1] * per_metre / FINE), round(paint.shape[0] * per_metre / FINE))
        colour = cv2.resize(paint, shrunk, interpolation=cv2.INTER_AREA)
        whole = np.dstack([colour, np.ones(colour.shape[:2], np.float32)])
        return np.pad(whole, ((4, 4), (4, 4), (0, 0))), per_metre

    @cached_property
    def _rays(self) -> NDArray[np.float32]:
        return self.view.rays()

    @cached_property
    def _fine_rays(self) -> NDArray[np.float32]:
        return self.view.rays(RAYS)

    @cached_property
    def _lamp(self) -> Array:
        light = np.array(self.look.light)
        return np.asarray(light / np.linalg.norm(light))

    @cached_property
    def _grain(self) -> NDArray[np.float32]:
        random = np.random.default_rng([self.seed, 999])
        size = 5 * self.view.width * self.view.height * 3
        return self.look.noise * random.standard_normal(size, dtype=np.float32)

    @cached_property
    def _lit(self) -> Linear:
        """Light over the picture (h, w, 1)."""
        random = np.random.default_rng([self.seed, 998])
        way = random.uniform(0, 2 * np.pi)
        down, right = np.mgrid[-0.5 : 0.5 : self.view.height * 1j, -0.5 : 0.5 : self.view.width * 1j]
        slope = np.cos(way) * right + np.sin(way) * down
        level = 1.0 + 2 * self.look.gradient * slope - self.look.gradient * (right**2 + down**2)
        return np.asarray(level[:, :, None], dtype=np.float32)

    def _onto_board(self, tilt: Array, rays: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return where rays (..., 2) meet the board's plane (..., 2), in the tilted board's frame [m]."""
        turn = turned(tilt).T
        eye, way = turn @ self.view.eye, (turn @ self.view.rotation.T).astype(np.float32)
        right, down = rays[..., 0], rays[..., 1]
        x, y, z = (one[0] * right + one[1] * down + one[2] for one in way)
        far = np.float32(-eye[2]) / z
        return np.stack([np.float32(eye[0]) + far * x, np.float32(eye[1]) + far * y], axis=-1)

    def _board(self, tilt: Array) -> Linear:
        """Return the board without a marble."""
        texture, per_metre = self._texture
        ground = np.array(self.look.ground, np.float32)
        picture = np.empty((self.view.height, self.view.width, 3), np.float32)
        picture[:] = ground
        # The tilt moves corners by a few pixels.
        corners = self.corners()
        box = self._box(corners.mean(axis=0), float(np.abs(corners - corners.mean(axis=0)).max()) + 25.0)
        spots = self._onto_board(tilt, self._rays[box])
        height, width = texture.shape[:2]
        across = spots[..., 0] * np.float32(per_metre) + np.float32((width - 1) / 2)
        down = np.float32((height - 1) / 2) - spots[..., 1] * np.float32(per_metre)
        seen = cv2.remap(texture, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        picture[box] = seen[:, :, :3] + (1.0 - seen[:, :, 3:]) * ground
        return picture

    def _middle(self, index: int, later: Array, places: Array) -> Array:
        """Return the marble's middle (n, 3) in the level frame [m] at times (n,) after a picture's [rows]."""
        nearby = range(max(index - 1, 0), min(index + 2, len(self)))
        times = np.array([one - index for one in nearby], dtype=float)
        xy = np.array([np.interp(later, times, places[list(nearby), axis]) for axis in range(2)]).T
        above = np.column_stack([EDGES_M[0] * xy, np.full(len(xy), RADIUS_M)])
        return np.asarray(above @ turned(self.tilts[index]).T)

    def _when(self, rows: Array) -> Array:
        """Return when rows (n,) of a picture are read, after its stamp [pictures]."""
        return np.asarray(self.look.readout * (rows / self.view.height - 0.5))

    def _marble(
        self, picture: Linear, index: int, places: Array
    ) -> tuple[Truth, tuple[slice, slice], NDArray[np.float32] | None]:
        """Add a marble and its shadow; return the truth, and how much it covers of the pixels of a box."""
        nowhere = (slice(0, 0), slice(0, 0))
        if np.isnan(places[index]).any():
            return Truth(np.full(2, np.nan), places[index], 0.0), nowhere, None
        later = 0.0
        for _ in range(3):
            middle = self._middle(index, np.array([later]), places)
            pixel = self.view.project(middle)[0]
            later = float(self._when(pixel[1:])[0])
        place = np.array([np.interp(later, [-1, 0, 1], places[self._near(index), axis]) for axis in range(2)])
        away = float(np.linalg.norm(middle[0] - self.view.eye))
        radius = self.view.focal * RADIUS_M / away
        self._shade(picture, middle[0], self.tilts[index], self._box(pixel, 5.0 * radius))
        box = self._box(pixel, 1.3 * radius + 3.0)
        colour, cover = self._traced(index, box, places, picture)
        picture[box] = colour + (1.0 - cover[:, :, None]) * picture[box]
        return Truth(pixel, place, 1.0), box, cover

    def _near(self, index: int) -> list[int]:
        return [max(index - 1, 0), index, min(index + 1, len(self) - 1)]

    def _box(self, pixel: Array, reach: float) -> tuple[slice, slice]:
        left, right = (int(np.clip(pixel[0] + one, 0, self.view.width)) for one in (-reach, reach + 1))
        top, bottom = (int(np.clip(pixel[1] + one, 0, self.view.height)) for one in (-reach, reach + 1))
        return slice(top, bottom), slice(left, right)

    def _shade(self, picture: Linear, middle: Array, tilt: Array, box: tuple[slice, slice]) -> None:
        """Darken the board where the marble takes the lamp's light, and all light close to it."""
        spots = self._onto_board(tilt, self._rays[box])
        toward = turned(tilt).T @ middle - np.dstack([spots, np.zeros(spots.shape[:2])])
        along = toward @ (turned(tilt).T @ self._lamp)
        aside = np.sqrt(np.maximum((toward**2).sum(axis=2) - along**2, 0.0)) / RADIUS_M
        # A lamp of some size: the farther the shadow from its marble, the softer.
        soft = 0.15 + 0.12 * np.maximum(along, 0.0) / RADIUS_M
        lamp = np.where(along > 0.0, np.clip((aside - 1.0) / soft + 0.5, 0.0, 1.0), 1.0)
        near = 1.0 - 0.6 * (RADIUS_M / np.linalg.norm(toward, axis=2)) ** 4
        light = self.look.ambient * near + (1.0 - self.look.ambient) * lamp
        picture[box] *= light[:, :, None].astype(np.float32)

    def _traced(
        self, index: int, box: tuple[slice, slice], places: Array, picture: Linear
    ) -> tuple[Linear, NDArray[np.float32]]:
        """Return a box's light from the marble, and its cover."""
        rows, columns = box
        size = rows.stop - rows.start, columns.stop - columns.start
        if 0 in size:
            return np.zeros((*size, 3), np.float32), np.zeros(size, np.float32)
        rays = self._fine_rays[
            rows.start * RAYS : rows.stop * RAYS, columns.start * RAYS : columns.stop * RAYS
        ].astype(np.float64)
        toward = np.dstack([rays, np.ones(rays.shape[:2])])
        toward = (toward / np.linalg.norm(toward, axis=2, keepdims=True)) @ self.view.rotation
        read = self._when(np.repeat(np.arange(rows.start, rows.stop), RAYS))
        times = np.linspace(-0.5, 0.5, 3) * self.look.exposure if self.look.exposure else np.zeros(1)
        around = picture[box].reshape(-1, 3).max(axis=0)
        light, cover = np.zeros((*size, 3)), np.zeros(size)
        for time in times:
            middle = self._middle(index, read + time, places)[:, None, :]
            offset = self.view.eye - middle
            along = (toward * offset).sum(axis=2)
            root = along**2 - (offset**2).sum(axis=2) + RADIUS_M**2
            hit = root > 0
            far = -along[hit] - np.sqrt(root[hit])
            normal = (offset + 0.0 * toward)[hit] + far[:, None] * toward[hit]
            fine = np.zeros((*root.shape, 3))
            fine[hit] = self._surface(normal / RADIUS_M, toward[hit], around)
            light += fine.reshape(size[0], RAYS, size[1], RAYS, 3).mean(axis=(1, 3))
            cover += hit.reshape(size[0], RAYS, size[1], RAYS).mean(axis=(1, 3))
        return (light / len(times)).astype(np.float32), (cover / len(times)).astype(np.float32)

    def _surface(self, normal: Array, toward: Array, board: NDArray[np.float32]) -> Array:
        """Return the light (n, 3) that leaves the marble where it has these normals."""
        look = self.look
        mirrored = toward - 2.0 * (toward * normal).sum(axis=1, keepdims=True) * normal
        lamp = np.clip(mirrored @ self._lamp, 0.0, 1.0)
        if look.marble == STEEL:
            up = np.clip(8.0 * mirrored[:, 2:] + 0.5, 0.0, 1.0)
            sky = np.array([0.30, 0.31, 0.33]) * (0.5 + 0.5 * np.clip(mirrored[:, 2:], 0, 1))
            below = 0.5 * look.ambient * board * np.clip(1.2 + mirrored[:, 2:], 0.3, 1)
            seen = up * sky + (1.0 - up) * below
            return np.asarray(0.75 * seen + (look.highlight * 2.0) * lamp[:, None] ** 40)
        facing = np.clip(normal @ self._lamp, 0.0, 1.0)
        from_around = look.ambient * (0.65 + 0.35 * normal[:, 2])
        diffuse = np.array(MARBLES[look.marble]) * (from_around + (1.0 - look.ambient) * facing)[:, None]
        return np.asarray(diffuse + 0.02 + look.highlight * lamp[:, None] ** 60)

    def _finger(self, picture: Linear, index: int) -> NDArray[np.float32] | None:
        """Lay the finger over the picture; return how much it covers (h, w)."""
        if self.finger is None:
            return None
        tip, root = self._reach(index)
        if tip is None or root is None:
            return None
        finger, fine = self.finger, 4
        along = (root - tip) / np.linalg.norm(root - tip)
        aside = np.array([-along[1], along[0]]) * finger.width_px / 2
        shape = np.array(
            [
                tip + 0.5 * aside,
                tip - 0.5 * aside,
                tip + 14 * along - aside,
                root - aside,
                root + aside,
                tip + 14 * along + aside,
            ]
        )
        cover = np.zeros((self.view.height, self.view.width), np.uint8)
        cv2.fillPoly(cover, [np.rint(shape * 2**fine).astype(np.int32)], 255, cv2.LINE_AA, fine)
        alpha: Linear = (cv2.GaussianBlur(cover, (3, 3), 0) / 255.0).astype(np.float32)
        left, top, width, height = cv2.boundingRect(cover)
        box = (
            slice(max(top - 20, 0), min(top + height + 20, self.view.height)),
            slice(max(left - 20, 0), min(left + width + 20, self.view.width)),
        )
        shadow = cv2.GaussianBlur(cover[box], (0, 0), 5.0).astype(np.float32) / 255
        moved = np.array([[1.0, 0.0, -8.0], [0.0, 1.0, 6.0]])
        shadow = np.asarray(cv2.warpAffine(shadow, moved, (shadow.shape[1], shadow.shape[0])))
        part, over = picture[box], alpha[box]
        part *= (1.0 - 0.35 * shadow * (1.0 - over))[:, :, None]
        down, right = np.mgrid[box].astype(np.float32)
        across = ((right - tip[0]) * along[1] - (down - tip[1]) * along[0]) * 2 / finger.width_px
        gloss = np.float32(0.6) + np.float32(0.8) * np.exp(-8 * (across.astype(np.float32) - 0.3) ** 2)
        part *= 1.0 - over[:, :, None]
        part += (over * gloss)[:, :, None] * np.array(finger.colour, np.float32)
        if finger.ball:
            self._tip_ball(picture, tip + 20 * along)
        return alpha

    def _tip_ball(self, picture: Linear, place: Array) -> None:
        """Put a shiny screw head as large as the marble on the finger."""
        radius = self.view.focal * RADIUS_M / float(np.linalg.norm(self.view.eye))
        box = self._box(place, radius + 2.0)
        down, right = np.mgrid[box]
        alpha = np.clip(radius + 0.5 - np.hypot(right - place[0], down - place[1]), 0.0, 1.0)[:, :, None]
        shine = np.array([0.30, 0.30, 0.31]) * (1.3 - ((right - place[0]) / radius)[:, :, None] * 0.4)
        picture[box] += (alpha * (shine - picture[box])).astype(np.float32)

    def _reach(self, index: int) -> tuple[Array | None, Array | None]:
        """Return tip and root of the finger [pixels]: it comes and goes, now and then over the marble."""
        period = 150
        visit, phase = divmod(index, period)
        random = np.random.default_rng([self.seed, 7, visit])
        part = (phase - 40) / 60
        if not 0.0 <= part <= 1.0:
            return None, None
        corners = self.corners()
        aims_at = np.clip(visit * period + 70, 0, len(self) - 1)
        if random.random() < 0.7 and not np.isnan(self.places[aims_at]).any():
            goal = self.view.project(self._middle(aims_at, np.zeros(1), self.places))[0]
        else:
            goal = corners.mean(axis=0) + random.uniform(-0.3, 0.3, 2) * np.ptp(corners, axis=0)
        way = random.uniform(0, 2 * np.pi)
        root = goal + 600 * np.array([np.cos(way), np.sin(way)])
        reach = np.sin(np.pi * part)
        return goal + (1.0 - reach) * 0.7 * (root - goal), root

    def _exposed(self, picture: Linear, random: np.random.Generator) -> Picture:
        """Return what the camera makes of light: levels, blue first."""
        look = self.look
        light = picture * (self._lit * np.float32(1.0 + look.flicker * random.standard_normal()))
        light = cv2.GaussianBlur(light, (0, 0), look.blur)
        levels = cv2.sqrt(np.clip(light, 0.0, 1.0)) * 255.0
        first = int(random.integers(0, self._grain.size - levels.size))
        levels = levels + self._grain[first : first + levels.size].reshape(levels.shape)
        shown = np.asarray(cv2.convertScaleAbs(np.maximum(levels[:, :, ::-1], 0.0)), dtype=np.uint8)
        if look.jpeg:
            _, data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, look.jpeg])
            shown = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
        return shown
