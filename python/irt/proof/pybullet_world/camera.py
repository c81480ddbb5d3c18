"""Rendered pictures of a run: a camera above the board, its lens, the light and the noise of its pixels.

Hidden sensing effects change the picture and not the numbers: after its calibration the camera is shifted,
rotated or tilted, or its lens changes, or the board lies above its axes. PyBullet renders on the CPU, in some
5 ms per picture. The resolution is so low that a tracker's error is 0.2 to 0.3 mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .effects.camera import Parallax
from .in_pybullet import bullet
from .out_of_catalogue import Yaw
from .physics import EDGE_X_M, EDGE_Y_M, RADIUS_M, Array
from .played import Played
from .spec import Spec

Picture = NDArray[np.uint8]

#: Pixels of two millimetres: with smaller ones the tracker's error was 0.08 mm, less than engines differ.
WIDTH, HEIGHT = 160, 120
#: Oversampling of the calibration's picture along a side; odd.
FINER = 5
#: Height of the camera [m]; half of its field of view in the board's plane, along y.
DISTANCE_M, HALF_VIEW_M = 0.6, 0.14
#: Plate for the calibration: as large as the board, at the height of the marble's centre.
CORNERS_M = np.array([[-0.5, -0.5, 1], [0.5, -0.5, 1], [0.5, 0.5, 1], [-0.5, 0.5, 1]]) * [
    EDGE_X_M,
    EDGE_Y_M,
    RADIUS_M,
]
BOARD, FRAME, TABLE, MARBLE = (0.85, 0.7, 0.5, 1), (0.3, 0.2, 0.1, 1), (0.1, 0.1, 0.1, 1), (0.1, 0.2, 0.9, 1)


@dataclass(frozen=True)
class Camera:
    """A pinhole with a lens.

    Attributes
    ----------
    eye, forward, up : (3,) arrays
        Position [m] and orientation.
    lens : float
        Relative magnification per squared board edge from its centre.
    """

    eye: Array
    forward: Array
    up: Array
    lens: float = 0.0

    def look(self, points: Array) -> Array:
        """Return the pixels (n, 2), right of and below the corner's centre, of points (n, 3) [m]."""
        right = np.cross(self.forward, self.up)
        away = points - self.eye
        seen = np.stack([away @ right, away @ self.up], axis=1) / (away @ self.forward)[:, None]
        return self.to_pixels(seen * self._magnified((seen**2).sum(axis=1))[:, None])

    def to_pixels(self, seen: Array) -> Array:
        """Return pixels for tangents (n, 2) of the angles right of and above the line of sight."""
        return np.asarray(seen * FOCAL * [1.0, -1.0] + MIDDLE)

    def straightened(self) -> tuple[Array, Array] | None:
        """Return the source pixel (h, w), to the right and down, of each pixel; None without a lens."""
        if self.lens == 0.0:
            return None
        down, right = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
        x, y = (right - MIDDLE[0]) / FOCAL, (down - MIDDLE[1]) / FOCAL
        reached = np.hypot(x, y)
        straight = reached
        for _ in range(20):
            straight = reached / self._magnified(straight**2)
        part = np.divide(straight, reached, out=np.ones_like(reached), where=reached > 0)
        return x * part * FOCAL + MIDDLE[0], y * part * FOCAL + MIDDLE[1]

    def _magnified(self, square: Array) -> Array:
        return 1.0 + self.lens * square * (DISTANCE_M / EDGE_X_M) ** 2


#: Depth in the buffer that means background.
NOTHING = 0.99
#: A position outside every picture.
NOWHERE = np.array([0.0, 0.0, -1.0])
FOCAL = HEIGHT / 2 * DISTANCE_M / HALF_VIEW_M
#: The principal point; the renderer's rows begin at the lower margin.
MIDDLE = (WIDTH / 2, HEIGHT / 2 - 1)


def mounted(spec: Spec) -> Camera:
    """Return the calibrated camera: tilted by up to three degrees."""
    random = spec.random(0, 4)
    lean_x, lean_y = random.uniform(-0.05, 0.05, 2)
    return _aimed(np.array([lean_x, lean_y]), 0.0, np.zeros(2), 0.0)


def now(spec: Spec) -> Camera:
    """Return the actual camera: the calibrated one with the hidden sensing effects."""
    random = spec.random(0, 4)
    lean = random.uniform(-0.05, 0.05, 2)
    hidden = {str(one["name"]): one for one in spec.effects}
    scale = spec.observation_scale
    aslant, shift = hidden.get("perspective"), hidden.get("camera_offset")
    turn, lens = hidden.get("camera_rotation"), hidden.get("lens_distortion")
    if aslant is not None:
        # Over an edge the distance grows by the sine of the tilt; the far side has the positive slope.
        lean = lean - DISTANCE_M / EDGE_X_M * scale * np.array([aslant["slope_x"], aslant["slope_y"]])
    aside = np.zeros(2) if shift is None else -np.array([shift["x_edges"], shift["y_edges"]])
    return _aimed(
        lean,
        0.0 if turn is None else float(turn["angle_rad"]),
        aside * EDGE_X_M / scale,
        0.0 if lens is None else float(lens["k_per_edge2"]) * scale**2,
    )


def pictures(spec: Spec, run: int, played: Played) -> Iterator[Picture]:
    """Yield a picture (h, w, 3) for each row of a run."""
    camera, light, random = now(spec), _Light.of(spec), spec.random(run, 5)
    p = bullet()
    client = p.connect(p.DIRECT)
    try:
        still = _Scene(p, client).render(camera, NOWHERE)
    finally:
        p.disconnect(client)
    client = p.connect(p.DIRECT)
    try:
        alone, bent = _Scene(p, client, board=False), camera.straightened()
        for place in _moved(spec, played):
            # Only the marble moves, and nothing occludes it.
            marble, covered = alone.seen(camera, place)
            picture = np.where(covered[:, :, None], marble, still)
            yield light.on(_sampled(picture, bent), random)
    finally:
        p.disconnect(client)


def calibration(spec: Spec) -> Picture:
    """Return the picture (h, w, 3) for the tracker's calibration, before the camera was moved.

    A plate as large as the board lies on it at the height of the marble's centre, so that a tilted camera
    maps the marble's centre and not the point of the board behind it.
    """
    return _still(spec, mounted(spec), finer=FINER, what=6, plate=True)


def empty(spec: Spec) -> Picture:
    """Return a picture (h, w, 3) of the level, empty board, taken before the runs."""
    return _still(spec, now(spec), finer=1, what=8, plate=False)


def _still(spec: Spec, camera: Camera, *, finer: int, what: int, plate: bool) -> Picture:
    p = bullet()
    client = p.connect(p.DIRECT)
    try:
        scene = _Scene(p, client, plate=plate)
        sharp = _sampled(scene.render(camera, NOWHERE, finer), camera.straightened())
        light = _Light.of(spec)
        # The mean of sixteen pictures has less noise.
        light = replace(light, grain=light.grain / 4) if plate else light
        return light.on(sharp, spec.random(0, what))
    finally:
        p.disconnect(client)


def perfect(spec: Spec, played: Played) -> Array:
    """Return the positions (n, 2) [board edges] of an errorless tracker on the pictures of a run."""
    plane = _homography(mounted(spec).look(CORNERS_M), CORNERS_M[:, :2] / EDGE_X_M * spec.observation_scale)
    pixels = np.column_stack([now(spec).look(_moved(spec, played)), np.ones(len(played.places))]) @ plane.T
    return np.asarray(pixels[:, :2] / pixels[:, 2:])


def _moved(spec: Spec, played: Played) -> Array:
    """Return the marble's centre in the room (n, 3) [m]."""
    hidden = {one.name: one for one in spec.hidden}
    parallax, yaw = hidden.get("parallax"), hidden.get("yaw")
    height = parallax.height_m_per_rad / spec.observation_scale if isinstance(parallax, Parallax) else 0.0
    about = np.array([yaw.from_x, yaw.from_y]) if isinstance(yaw, Yaw) else np.zeros(2)
    moved = []
    for (x, y), tilt in zip(played.places, played.tilts, strict=True):
        cos, sin = math.cos(tilt @ about), math.sin(tilt @ about)
        place = _turned(tilt) @ [cos * x - sin * y, sin * x + cos * y, RADIUS_M]
        moved.append(place + height * np.array([tilt[1], -tilt[0], 0.0]))
    return np.array(moved)


def _turned(tilt: Array) -> Array:
    """Return the rotation (3, 3) of a board turned about x, then about its y."""
    (sin_x, sin_y), (cos_x, cos_y) = np.sin(tilt), np.cos(tilt)
    about_x = np.array([[1, 0, 0], [0, cos_x, -sin_x], [0, sin_x, cos_x]])
    return np.asarray(about_x @ np.array([[cos_y, 0, sin_y], [0, 1, 0], [-sin_y, 0, cos_y]]))


def _aimed(lean: Array, turn: float, aside: Array, lens: float) -> Camera:
    """Return a camera over a point of the board [m], tilted, and rotated about its line of sight [rad].

    It is tilted about a horizontal axis. A camera that keeps its sideways axis horizontal while it tilts both
    ways rotates about its line of sight besides, by about half the product of the sines.
    """
    sines = np.clip(lean, -0.6, 0.6)
    down = -math.sqrt(1.0 - float(sines @ sines))
    forward = np.array([-sines[0], -sines[1], down])
    eye = np.array([*aside, RADIUS_M]) - DISTANCE_M * forward
    level = np.array([math.sin(turn), math.cos(turn), 0.0])
    up = level - (level @ forward) / (1.0 - down) * (forward - [0.0, 0.0, 1.0])
    return Camera(eye, forward, up, lens)


class _Scene:
    """The rendered scene: board, frame, table and marble."""

    def __init__(self, p: ModuleType, client: int, *, board: bool = True, plate: bool = False) -> None:
        self.p, self.client = p, client
        half_x, half_y, thick = EDGE_X_M / 2, EDGE_Y_M / 2, 0.005
        boxes = [((half_x, half_y, thick), (0.0, 0.0, -thick), BOARD)]
        for side in (-1.0, 1.0):
            boxes.append(((0.01, half_y + 0.02, 0.001), (side * (half_x + 0.01), 0.0, -0.001), FRAME))
            boxes.append(((half_x + 0.02, 0.01, 0.001), (0.0, side * (half_y + 0.01), -0.001), FRAME))
        boxes.append(((1.0, 1.0, 0.01), (0.0, 0.0, -0.15), TABLE))
        if plate:
            boxes.append(((half_x, half_y, RADIUS_M / 2), (0.0, 0.0, RADIUS_M / 2), BOARD))
        for half, centre, colour in boxes if board else ():
            self._body(centre, shapeType=p.GEOM_BOX, halfExtents=half, rgbaColor=colour)
        self.marble = self._body((0, 0, -1), shapeType=p.GEOM_SPHERE, radius=RADIUS_M, rgbaColor=MARBLE)

    def _body(self, place: tuple[float, float, float], **shape: Any) -> int:
        visual = self.p.createVisualShape(**shape, physicsClientId=self.client)
        body = self.p.createMultiBody(0, -1, visual, basePosition=place, physicsClientId=self.client)
        return int(body)

    def render(self, camera: Camera, place: Array, finer: int = 1) -> Picture:
        """Return a pinhole's picture (h, w, 3); the board's tilt of a hundredth shows in the marble alone.

        The renderer has no antialiasing; an odd `finer` averages squares of that many pixels per side.
        """
        fine, _ = self.seen(camera, place, finer)
        # Pixels stand for their corner, so that those of a square are moved to be about it.
        fine = np.roll(fine, (-(finer // 2), finer // 2), axis=(0, 1))
        squares = fine.reshape(HEIGHT, finer, WIDTH, finer, 3)
        return np.asarray(np.rint(squares.mean(axis=(1, 3))), dtype=np.uint8)

    def seen(self, camera: Camera, place: Array, finer: int = 1) -> tuple[Picture, NDArray[np.bool_]]:
        """Return colours (h, w, 3) at `finer` times the resolution, and the foreground mask (h, w)."""
        p, size = self.p, (finer * HEIGHT, finer * WIDTH)
        p.resetBasePositionAndOrientation(
            self.marble, place.tolist(), [0, 0, 0, 1], physicsClientId=self.client
        )
        view = p.computeViewMatrix(
            camera.eye.tolist(), (camera.eye + camera.forward).tolist(), camera.up.tolist()
        )
        angle = 2.0 * math.degrees(math.atan(HALF_VIEW_M / DISTANCE_M))
        _, _, colours, depth, _ = p.getCameraImage(
            size[1],
            size[0],
            view,
            p.computeProjectionMatrixFOV(angle, WIDTH / HEIGHT, 0.05, 3.0),
            renderer=p.ER_TINY_RENDERER,
            shadow=0,
            lightDirection=[0.3, 0.2, 1.0],
            flags=p.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self.client,
        )
        picture = np.reshape(np.asarray(colours, dtype=np.uint8), (*size, 4))[:, :, :3]
        return picture, np.reshape(np.asarray(depth), size) < NOTHING


@dataclass(frozen=True)
class _Light:
    """Uneven light (h, w, 1), and the noise of the pixels [levels]."""

    level: NDArray[np.float32]
    grain: float

    @classmethod
    def of(cls, spec: Spec) -> _Light:
        """Draw the light of a rig."""
        random = spec.random(0, 7)
        fall, grain = random.uniform(-0.15, 0.15, 2), float(random.uniform(3.0, 20.0))
        down, right = np.mgrid[-0.5 : 0.5 : HEIGHT * 1j, -0.5 : 0.5 : WIDTH * 1j]
        level = 1.0 + fall[0] * right + fall[1] * down
        return cls(level[:, :, None].astype(np.float32), grain)

    def on(self, picture: Picture, random: np.random.Generator) -> Picture:
        """Return a picture under this light, with fresh noise."""
        noise = random.standard_normal(picture.shape, dtype=np.float32)
        noisy = np.rint(picture * self.level + np.float32(self.grain) * noise)
        return np.asarray(np.clip(noisy, 0, 255), dtype=np.uint8)


def _sampled(picture: Picture, where: tuple[Array, Array] | None) -> Picture:
    """Return a picture interpolated at pixels (h, w) of another; its margin is repeated outside."""
    if where is None:
        return picture
    right, down = np.clip(where[0], 0, WIDTH - 1.001), np.clip(where[1], 0, HEIGHT - 1.001)
    column, row = right.astype(int), down.astype(int)
    u = (right - column)[:, :, None].astype(np.float32)
    v = (down - row)[:, :, None].astype(np.float32)
    above = picture[row, column] * (1 - u) + picture[row, column + 1] * u
    below = picture[row + 1, column] * (1 - u) + picture[row + 1, column + 1] * u
    return np.asarray(np.rint(above * (1 - v) + below * v), dtype=np.uint8)


def _homography(pixels: Array, plane: Array) -> Array:
    """Return the matrix (3, 3) that takes four pixels to four points of a plane."""
    rows = []
    for (u, v), (x, y) in zip(pixels, plane, strict=True):
        rows.append([u, v, 1, 0, 0, 0, -u * x, -v * x, -x])
        rows.append([0, 0, 0, u, v, 1, -u * y, -v * y, -y])
    return np.asarray(np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3), dtype=np.float64)
