"""Runs rendered by a path tracer, Mitsuba 3: pictures from other hands than those the tracker was made with.

Light is added up linearly. The board is rendered without the marble, once for each group of lamps; a window
about the marble and its shadow is rendered anew for each picture. Lamps that dim and shadows that pass
scale the light of their group. The tilt moves the picture of the board by its homography, which is exact for
the board's surface. A marble's middle, above that, is moved as well; so it is rendered where this homography
shows it in its place.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracking.cases import Case, Shine
from tracking.view import Array, turned

Linear = NDArray[np.float32]
Picture = NDArray[np.uint8]

#: Mitsuba's, by default; `scalar_rgb` needs no LLVM.
VARIANT = "llvm_ad_rgb"
#: Samples to a pixel of the board, and of the window about the marble.
BOARD_SAMPLES, MARBLE_SAMPLES = 96, 64
#: Bounces of light.
DEPTH = 5
#: The window about the marble reaches so far beyond it and its shadow, in radii.
BEYOND = 1.6
#: Moments of an exposure that are rendered.
MOMENTS = 3
#: Height and width of a rim [m].
RIM_HEIGHT_M, RIM_WIDTH_M = 0.008, 0.006


@dataclass(frozen=True)
class Truth:
    """Where the marble's middle is in a picture [pixels], and on the board [board edges]."""

    pixel: Array
    place: Array


class Traced:
    """A run to be rendered; Mitsuba is imported where one is made."""

    def __init__(self, case: Case, samples: float = 1.0, variant: str = VARIANT) -> None:
        mitsuba = importlib.import_module("mitsuba")

        mitsuba.set_variant(variant)
        self._mi: Any = mitsuba
        self.case = case
        self._samples = samples
        self._boards = [self._board(group) for group in self.groups]
        self._scenes = [self._scene(group, marble=True) for group in self.groups]

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Lamps whose light changes together."""
        return (("lamp",), ("day", "second")) if self.case.changes else (("lamp", "day", "second"),)

    def frames(self) -> Iterator[tuple[Picture, Truth]]:
        """Yield pictures, blue first, with their truth."""
        for index in range(len(self.case.places)):
            yield self._exposed(index), self.truth(index)

    def truth(self, index: int) -> Truth:
        """Return the truth of a picture: the marble's at the middle of the exposure."""
        moment = self._moment(index)
        return Truth(self._seen_at(moment), self.case.place_at(moment))

    def corners(self) -> Array:
        """Return the level board's corners (4, 2) [pixels], clockwise from least x and greatest y."""
        x, y = self.case.edges_m[0] / 2, self.case.edges_m[1] / 2
        return self.case.view.project(np.array([[-x, y, 0], [x, y, 0], [x, -y, 0], [-x, -y, 0.0]]))

    def _moment(self, index: int) -> float:
        """Return when the marble's row of a picture is exposed [pictures]."""
        moment, case = float(index), self.case
        for _ in range(3):
            moment = index + case.readout * (float(self._seen_at(moment)[1]) / case.view.height - 0.5)
        return moment

    def _middle(self, moment: float) -> Array:
        """Return the place of the marble's middle in the board's frame (3,) [m]."""
        return np.array([*(self.case.place_at(moment) * self.case.edges_m[0]), self.case.radius_m])

    def _seen_at(self, moment: float) -> Array:
        """Return where the middle of the marble is seen (2,) [pixels]."""
        turn = turned(self.case.tilt_at(moment))
        return np.asarray(self.case.view.project((turn @ self._middle(moment))[None])[0])

    def _rendered_at(self, moment: float) -> Array:
        """Return where the marble is rendered on the level board (3,) [m]."""
        view = self.case.view
        back = np.linalg.inv(self._tilted(moment))
        x, y = cv2.perspectiveTransform(self._seen_at(moment).reshape(1, 1, 2), back).ravel()
        ray = np.array([(x - view.matrix[0, 2]) / view.focal, (y - view.matrix[1, 2]) / view.focal, 1.0])
        way = view.rotation.T @ ray
        return np.asarray(view.eye + way * (self.case.radius_m - view.eye[2]) / way[2])

    def _tilted(self, moment: float) -> Array:
        """Return the homography that the tilt moves the picture of the board by (3, 3)."""
        x, y = self.case.edges_m[0] / 2, self.case.edges_m[1] / 2
        flat = np.array([[-x, y, 0], [x, y, 0], [x, -y, 0], [-x, -y, 0.0]])
        level, tilted = (
            self.case.view.project(one) for one in (flat, flat @ turned(self.case.tilt_at(moment)).T)
        )
        there = cv2.getPerspectiveTransform(level.astype(np.float32), tilted.astype(np.float32))
        return np.asarray(there, dtype=np.float64)

    def _board(self, group: tuple[str, ...]) -> Linear:
        """Return the board without a marble (h, w, 3), red first."""
        scene = self._scene(group, marble=False)
        return np.asarray(self._mi.render(scene, spp=round(BOARD_SAMPLES * self._samples), seed=1))

    def _lit(self, index: int) -> Linear:
        """Return light in the level view (h, w, 3): each group by the light that its lamps give."""
        strengths = self.case.strengths(index)
        shade = self.case.shade(index)
        total = np.zeros_like(self._boards[0])
        for group, board, scene in zip(self.groups, self._boards, self._scenes, strict=True):
            light = board.copy()
            rows, columns = self._window(index)
            middle = self._moment(index)
            parts = [
                self._rendered(scene, middle + moment, (rows, columns), MOMENTS * index + number)
                for number, moment in enumerate(self.case.moments(MOMENTS))
            ]
            light[rows, columns] = np.mean(parts, axis=0)
            total += light * np.float32(strengths[group[0]]) * (shade if "lamp" in group else 1.0)
        return total

    def _window(self, index: int) -> tuple[slice, slice]:
        """Return rows and columns that the marble and its shadows change."""
        case = self.case
        points = []
        for moment in (-0.5, 0.0, 0.5):
            middle = self._rendered_at(self._moment(index) + moment)
            points.append(middle)
            for lamp in case.lamps:
                away = (middle - lamp.place) * (lamp.strength > 0)
                # Where the ray from the lamp through the marble's middle meets the board.
                points.append(middle + away * middle[2] / (lamp.place[2] - middle[2]))
        seen = case.view.project(np.array(points))
        radius = case.view.focal * case.radius_m / float(np.linalg.norm(case.view.eye))
        low = np.maximum((seen.min(axis=0) - (1.0 + BEYOND) * radius).astype(int), 0)
        high = (seen.max(axis=0) + (1.0 + BEYOND) * radius).astype(int) + 1
        right, bottom = np.minimum(high, [case.view.width, case.view.height])
        return slice(low[1], bottom), slice(low[0], right)

    def _rendered(self, scene: Any, moment: float, window: tuple[slice, slice], seed: int) -> Linear:
        """Return a window of the picture at a moment [pictures]."""
        mi = self._mi
        settings = mi.traverse(scene)
        rows, columns = window
        settings["sensor.film.crop_size"] = [columns.stop - columns.start, rows.stop - rows.start]
        settings["sensor.film.crop_offset"] = [columns.start, rows.start]
        place = self._rendered_at(moment)
        turn = self.case.turn_at(moment)
        settings["marble.to_world"] = (
            mi.Transform4f().translate([float(place[0]), float(place[1]), self.case.radius_m])
            @ mi.Transform4f(np.vstack([np.column_stack([turn, np.zeros(3)]), [0, 0, 0, 1]]).tolist())
            @ mi.Transform4f().scale(self.case.radius_m)
        )
        settings.update()
        spp = max(round(MARBLE_SAMPLES * self._samples / len(self.case.moments(MOMENTS))), 4)
        return np.asarray(mi.render(scene, spp=spp, seed=seed))

    def _exposed(self, index: int) -> Picture:
        """Return what the camera makes of light: levels, blue first."""
        case = self.case
        random = np.random.default_rng([case.seed, 11, index])
        scene = self._lit(index) * np.float32(case.exposure(index))
        moved = cv2.remap(scene, *self._from(index), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        light = cv2.GaussianBlur(np.maximum(moved, 0.0), (0, 0), case.blur)
        # Shot noise grows with the light, reading noise does not; then the curve of sRGB, close to a power.
        variance = case.shot**2 * light + case.read**2
        light = np.clip(light + np.sqrt(variance) * random.standard_normal(light.shape), 0.0, 1.0)
        curve = np.where(
            light < 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
        )
        return np.asarray(np.rint(255.0 * curve[:, :, ::-1]), dtype=np.uint8)

    def _from(self, index: int) -> tuple[Linear, Linear]:
        """Return the pixels of the level view that a picture's pixels show (h, w), row by row as exposed."""
        case = self.case
        height, width = case.view.height, case.view.width
        columns = np.arange(width, dtype=np.float64)
        across, down = np.empty((2, height, width), np.float32)
        back = np.linalg.inv(self._tilted(index))
        for row in range(height):
            if case.readout:
                back = np.linalg.inv(self._tilted(index + case.readout * (row / height - 0.5)))
            there = back @ np.array([columns, np.full(width, row), np.ones(width)])
            across[row], down[row] = there[:2] / there[2]
        return across, down

    def _scene(self, group: tuple[str, ...], *, marble: bool) -> Any:
        """Return Mitsuba's scene of a group of lamps."""
        mi, case = self._mi, self.case
        move = mi.ScalarTransform4f
        view = case.view
        axes = np.stack([-view.rotation[0], -view.rotation[1], view.rotation[2]], axis=1)
        pose = np.vstack([np.column_stack([axes, view.eye]), [0, 0, 0, 1]])
        width, height = case.edges_m
        texture = {
            "type": "bitmap",
            "bitmap": mi.Bitmap(case.texture()),
            "raw": True,
        }
        painted: dict[str, Any] = {"type": "diffuse", "reflectance": texture}
        if case.varnish:
            painted = {"type": "roughplastic", "diffuse_reflectance": texture, "alpha": case.varnish}
        parts: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": DEPTH},
            "sensor": {
                "type": "perspective",
                "to_world": move(pose),
                "fov_axis": "x",
                "fov": float(2 * np.degrees(np.arctan(view.width / 2 / view.focal))),
                "film": {
                    "type": "hdrfilm",
                    "width": view.width,
                    "height": view.height,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
            },
            "board": {
                "type": "rectangle",
                "to_world": move().scale([width / 2, height / 2, 1.0]),
                "bsdf": painted,
            },
            "slab": self._block(
                (0, 0, -case.slab_m / 2 - 1e-5),
                (width, height, case.slab_m),
                case.slab_colour or case.rim_colour,
            ),
            "table": {
                "type": "rectangle",
                "to_world": move().translate([0, 0, -case.table_m]).scale([3.0, 3.0, 1.0]),
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(case.table_colour)}},
            },
        }
        if case.rim:
            across, along = width / 2 + RIM_WIDTH_M / 2, height / 2 + RIM_WIDTH_M / 2
            tall = RIM_HEIGHT_M + case.slab_m
            middle = RIM_HEIGHT_M - tall / 2
            for name, place, size in (
                ("east", (across, 0, middle), (RIM_WIDTH_M, height + 2 * RIM_WIDTH_M, tall)),
                ("west", (-across, 0, middle), (RIM_WIDTH_M, height + 2 * RIM_WIDTH_M, tall)),
                ("north", (0, along, middle), (width, RIM_WIDTH_M, tall)),
                ("south", (0, -along, middle), (width, RIM_WIDTH_M, tall)),
            ):
                parts[name] = self._block(place, size, case.rim_colour)
        for lamp in case.lamps:
            if lamp.name in group and lamp.strength > 0:
                toward = move().look_at(list(lamp.place), [0, 0, 0], [0.1, 0.2, 0.97])
                power = [lamp.strength * one / (4 * lamp.half_m**2) for one in lamp.colour]
                parts[lamp.name] = {
                    "type": "rectangle",
                    "to_world": toward @ move().scale(lamp.half_m),
                    "emitter": {"type": "area", "radiance": {"type": "rgb", "value": power}},
                }
        if "day" in group:
            parts["day"] = {
                "type": "envmap",
                "bitmap": mi.Bitmap(case.room()),
                "to_world": move().rotate([1, 0, 0], 90),
            }
        if marble:
            parts["marble"] = {
                "type": "sphere",
                "to_world": move().scale(case.radius_m),
                "bsdf": self._surface(case.shine),
            }
        return mi.load_dict(parts)

    def _block(
        self, place: tuple[float, ...], size: tuple[float, ...], colour: tuple[float, ...]
    ) -> dict[str, Any]:
        move = self._mi.ScalarTransform4f
        return {
            "type": "cube",
            "to_world": move().translate(list(place)).scale([one / 2 for one in size]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(colour)}},
        }

    def _surface(self, shine: Shine) -> dict[str, Any]:
        """Return what the marble is made of."""
        if shine.kind == "steel":
            return {"type": "roughconductor", "material": "Cr", "alpha": shine.rough}
        if shine.kind == "glass":
            tint = {"type": "rgb", "value": list(shine.colour)}
            return {"type": "dielectric", "int_ior": 1.5, "specular_transmittance": tint}
        painted = {"type": "bitmap", "bitmap": self._mi.Bitmap(shine.texture()), "raw": True}
        return {"type": "roughplastic", "diffuse_reflectance": painted, "alpha": shine.rough}
