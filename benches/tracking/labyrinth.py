"""A labyrinth as it stands on a table, rendered by Blender's Cycles: pictures of a third kind.

The scenes of `tracking.traced` have a bare board. Here it has inner walls, holes through which the dark is
seen, a printed path with numbers, a rim, and hangs in a frame that tilts about x alone, within a case that
stands still. All of it is wood, so that there are several outlines of the board's shape and colour.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

import irt
from tracking.view import Array, View

Colour = tuple[float, float, float]
Place = tuple[float, float, float]

#: Thickness of the rim and of the frame, gaps between board, frame and case, wall of the case [m].
RIM_M, FRAME_M, GAP_M, CASE_M = 0.006, 0.008, 0.009, 0.014
#: Height of the rim, thickness of the board, depth of the case below the board [m].
RIM_HEIGHT_M, BOARD_M, DEEP_M = 0.011, 0.008, 0.09
#: Half the width of the printed path, and its height above the board [m].
LINE_M, INK_M = 0.0008, 0.0001
#: Bounces of light.
BOUNCES = 3
INK: Colour = (0.01, 0.01, 0.01)


@dataclass(frozen=True)
class Lamp:
    """A square lamp that shines at the board's centre: place [m], side [m], power [W]."""

    place: Place
    side_m: float
    power_w: float
    colour: Colour = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Look:
    """What is seen.

    Attributes
    ----------
    layout : str
        A layout that `irt.Maze.of_layout` knows.
    marble : tuple
        Linear colour of the marble.
    metal, clear, rough : float
        How much of it is metal, how much light it lets through, and the roughness of its gloss.
    edge_px, lean, turn : float, tuple, float
        Length of the board's long edge in the picture [pixels]; the camera's lean and turn [rad].
    lamps : tuple of Lamp
        What shines.
    sky : float
        Light from all around.
    wood : tuple
        Linear colours of the board's grain, from dark to bright.
    printed : bool
        Whether the path is printed on the board.
    case_m : float
        How far the case stands above the board [m].
    shutter : float
        Share of the time between pictures that the shutter is open; 0 for a very short time.
    """

    layout: str = "cyberrunner-easy"
    marble: Colour = (0.8, 0.8, 0.82)
    metal: float = 0.0
    clear: float = 0.0
    rough: float = 0.1
    edge_px: float = 420.0
    lean: tuple[float, float] = (0.0, 0.1)
    turn: float = 0.0
    lamps: tuple[Lamp, ...] = (
        Lamp((0.4, 0.5, 0.9), 0.4, 12.0),
        Lamp((-0.8, 0.2, 1.2), 0.6, 8.0, (0.8, 0.9, 1.0)),
    )
    sky: float = 0.35
    wood: tuple[Colour, Colour] = ((0.35, 0.2, 0.09), (0.55, 0.36, 0.18))
    printed: bool = True
    case_m: float = 0.016
    shutter: float = 0.0


LOOKS = {
    "steel": Look(metal=1.0, rough=0.08, edge_px=430.0, lean=(0.15, 0.3), turn=0.1),
    "blue": Look(marble=(0.02, 0.08, 0.5), rough=0.25, edge_px=380.0),
    "white": Look(
        layout="bare",
        marble=(0.85, 0.85, 0.83),
        rough=0.3,
        edge_px=400.0,
        lean=(-0.2, 0.2),
        turn=-0.1,
        lamps=(Lamp((0.5, -0.4, 0.8), 0.05, 16.0),),
        sky=0.25,
        wood=((0.12, 0.06, 0.025), (0.22, 0.12, 0.06)),
        printed=False,
    ),
    "red": Look(
        layout="cyberrunner-medium",
        marble=(0.5, 0.02, 0.02),
        rough=0.2,
        edge_px=400.0,
        lean=(0.1, 0.2),
        case_m=0.03,
        shutter=0.5,
    ),
    "holes": Look(
        layout="cyberrunner-hard",
        marble=(0.75, 0.75, 0.77),
        metal=1.0,
        rough=0.25,
        lean=(0.1, -0.15),
        turn=0.05,
    ),
    "glass": Look(
        layout="cyberrunner-medium",
        marble=(1.0, 1.0, 1.0),
        clear=1.0,
        rough=0.0,
        edge_px=440.0,
        lean=(0.0, -0.2),
    ),
}


@dataclass
class Labyrinth:
    """The scene, to be built once in a process.

    Attributes
    ----------
    look : Look
        What is seen.
    view : View
        From where.
    edges_m, radius_m : tuple, float
        Of the board and of the marble [m].
    samples, threads : int
        Samples to a pixel before its noise is removed, and threads.
    """

    look: Look
    view: View
    edges_m: tuple[float, float]
    radius_m: float
    samples: int
    threads: int

    def render(self, places: Array, tilts: Array, folder: Path) -> None:
        """Write pictures of a marble at places (n, 2) [board edges] on a board tilted by (n, 2) [rad]."""
        bpy.ops.wm.read_factory_settings(use_empty=True)
        marble, board, frame = self._build()
        for index, (place, tilt) in enumerate(zip(places * self.edges_m[0], tilts, strict=True), start=1):
            board.rotation_euler = (*tilt, 0.0)
            frame.rotation_euler = (tilt[0], 0.0, 0.0)
            marble.location = (*place, self.radius_m)
            for one, what in ((board, "rotation_euler"), (frame, "rotation_euler"), (marble, "location")):
                one.keyframe_insert(what, frame=index)
        for action in bpy.data.actions:
            for point in (point for curve in action.fcurves for point in curve.keyframe_points):
                point.interpolation = "LINEAR"
        self._set_up()
        scene = bpy.context.scene
        for index in range(len(places)):
            scene.frame_set(index + 1)
            scene.render.filepath = str(folder / f"{index:04d}.png")
            bpy.ops.render.render(write_still=True)

    def _set_up(self) -> None:
        """Set the renderer up, and the camera."""
        scene, view, look = bpy.context.scene, self.view, self.look
        scene.render.engine = "CYCLES"
        scene.cycles.samples, scene.cycles.use_denoising = self.samples, True
        scene.cycles.max_bounces, scene.cycles.use_adaptive_sampling = BOUNCES, False
        scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False
        scene.render.threads_mode, scene.render.threads = "FIXED", self.threads
        scene.render.use_persistent_data = True
        scene.render.resolution_x, scene.render.resolution_y = view.width, view.height
        scene.render.resolution_percentage = 100
        scene.render.image_settings.file_format = "PNG"
        scene.view_settings.view_transform = "Standard"
        scene.render.use_motion_blur = look.shutter > 0.0
        scene.render.motion_blur_shutter = look.shutter or 0.5
        camera = bpy.data.cameras.new("camera")
        camera.sensor_width, camera.sensor_fit, camera.clip_start = 36.0, "HORIZONTAL", 0.01
        camera.lens = view.focal * camera.sensor_width / view.width
        pose = np.eye(4)
        # Blender's cameras look against z, with y upwards.
        pose[:3, :3] = (view.rotation * [[1.0], [-1.0], [-1.0]]).T
        pose[:3, 3] = view.eye
        scene.camera = _added("camera", camera)
        scene.camera.matrix_world = Matrix(pose.tolist())
        for lamp in look.lamps:
            light = bpy.data.lights.new("lamp", "AREA")
            light.energy, light.size, light.color = lamp.power_w, lamp.side_m, lamp.colour
            shining = _added("lamp", light)
            shining.location = lamp.place
            shining.rotation_euler = (-Vector(lamp.place)).to_track_quat("-Z", "Y").to_euler()
        world = bpy.data.worlds.new("world")
        world.use_nodes, scene.world = True, world
        sky = world.node_tree.nodes["Background"].inputs
        sky["Strength"].default_value, sky["Color"].default_value = look.sky, (0.8, 0.9, 1.0, 1.0)

    def _build(self) -> tuple[Any, Any, Any]:
        """Build the labyrinth; return marble, board and frame, which move."""
        look, maze = self.look, irt.Maze.of_layout(self.look.layout)
        board, frame = _added("board", None), _added("frame", None)
        # The frame turns about x, and within it the board about its own y.
        board.rotation_mode = "YXZ"
        half_x, half_y = self.edges_m[0] / 2.0, self.edges_m[1] / 2.0
        outer_x, outer_y = half_x + RIM_M, half_y + RIM_M
        floor, trim = (
            _wood(look.wood, 18.0, 0.35),
            _wood(((0.25, 0.13, 0.05), (0.42, 0.25, 0.11)), 22.0, 0.4, 1),
        )
        case, table = (
            _wood(((0.4, 0.25, 0.12), (0.6, 0.42, 0.22)), 12.0, 0.3),
            _plain((0.56, 0.56, 0.54), 0.6),
        )
        plate = _box((-outer_x, -outer_y, -BOARD_M), (outer_x, outer_y, 0.0), floor, board)
        for hole in maze.holes:
            _drill(plate, hole, maze.hole_radius_m, board)
        _ring((half_x, half_y), RIM_M, (-0.001, RIM_HEIGHT_M), trim, board)
        thick = maze.wall_thickness_m / 2.0
        for x0, y0, x1, y1 in maze.walls:
            low = (min(x0, x1) - thick, min(y0, y1) - thick, -0.001)
            _box(low, (max(x0, x1) + thick, max(y0, y1) + thick, maze.wall_height_m), trim, board, 0.0012)
        if look.printed:
            _print(maze.path, board)
        _ring((outer_x + GAP_M, outer_y + GAP_M), FRAME_M, (-0.012, 0.009), trim, frame)
        inner = outer_x + 2.0 * GAP_M + FRAME_M, outer_y + 2.0 * GAP_M + FRAME_M
        _ring(inner, CASE_M, (-DEEP_M, look.case_m), case, None)
        _box((-inner[0], -inner[1], -DEEP_M), (inner[0], inner[1], 0.005 - DEEP_M), case, None)
        _box((-1.5, -1.5, -DEEP_M - 0.02), (1.5, 1.5, -DEEP_M - 0.01), table, None)
        for place, turn in (
            ((inner[0] + 0.034, 0.0), (0.0, math.pi / 2, 0.0)),
            ((0.0, -inner[1] - 0.034), (math.pi / 2, 0.0, 0.0)),
        ):
            bpy.ops.mesh.primitive_cylinder_add(
                radius=0.02, depth=0.024, location=(*place, -0.03), rotation=turn
            )
            bpy.context.object.data.materials.append(_plain(INK, 0.3))
        bpy.ops.mesh.primitive_uv_sphere_add(radius=self.radius_m, segments=64, ring_count=32)
        marble = bpy.context.object
        bpy.ops.object.shade_smooth()
        marble.data.materials.append(_plain(look.marble, look.rough, look.metal, look.clear))
        marble.parent = board
        return marble, board, frame


def _added(name: str, data: Any) -> Any:
    """Return a new object of the scene."""
    one = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(one)
    return one


def _plain(colour: Colour, rough: float, metal: float = 0.0, clear: float = 0.0) -> Any:
    """Return a material of one colour."""
    material = bpy.data.materials.new("plain")
    material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value, inputs["Roughness"].default_value = (*colour, 1.0), rough
    inputs["Metallic"].default_value, inputs["Transmission Weight"].default_value = metal, clear
    inputs["IOR"].default_value = 1.5
    return material


def _wood(colours: tuple[Colour, Colour], fine: float, rough: float, along: int = 0) -> Any:
    """Return wood with its grain along x, or along y."""
    material = _plain(colours[0], rough)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    place, stretched = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping")
    grain, ramp = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeValToRGB")
    stretched.inputs["Scale"].default_value = (14.0, 1.0, 14.0) if along else (1.0, 14.0, 14.0)
    grain.inputs["Scale"].default_value, grain.inputs["Detail"].default_value = fine, 2.0
    grain.inputs["Distortion"].default_value = 0.6
    for end, position, colour in zip(ramp.color_ramp.elements, (0.35, 0.7), colours, strict=True):
        end.position, end.color = position, (*colour, 1.0)
    links.new(place.outputs["Object"], stretched.inputs["Vector"])
    links.new(stretched.outputs["Vector"], grain.inputs["Vector"])
    links.new(grain.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return material


def _box(low: Place, high: Place, material: Any, parent: Any, rounded_m: float = 0.0) -> Any:
    """Add a box between two corners."""
    middle, size = (np.add(low, high) / 2.0).tolist(), np.subtract(high, low).tolist()
    bpy.ops.mesh.primitive_cube_add(size=1, location=middle)
    box = bpy.context.object
    box.scale = size
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    if rounded_m:
        bevel = box.modifiers.new("bevel", "BEVEL")
        bevel.width, bevel.segments = rounded_m, 3
    box.data.materials.append(material)
    box.parent = parent
    return box


def _ring(
    inner: tuple[float, float], thick: float, heights: tuple[float, float], material: Any, parent: Any
) -> None:
    """Add four walls about the middle, each so thick, from one height to another [m]."""
    (x, y), (low, high) = inner, heights
    for start, end in (
        ((x, -y - thick), (x + thick, y + thick)),
        ((-x - thick, -y - thick), (-x, y + thick)),
        ((-x, y), (x, y + thick)),
        ((-x, -y - thick), (x, -y)),
    ):
        _box((*start, low), (*end, high), material, parent, 0.001)


def _drill(plate: Any, hole: tuple[float, float], radius_m: float, parent: Any) -> None:
    """Cut a hole through a plate."""
    bpy.ops.mesh.primitive_cylinder_add(radius=radius_m, depth=0.04, location=(*hole, 0.0), vertices=48)
    cutter = bpy.context.object
    cutter.hide_render, cutter.parent = True, parent
    cut = plate.modifiers.new("hole", "BOOLEAN")
    cut.object, cut.operation, cut.solver = cutter, "DIFFERENCE", "EXACT"


def _print(path: Sequence[tuple[float, float]], board: Any) -> None:
    """Print a path onto the board, with numbers at every other corner."""
    ink = _plain(INK, 0.6)
    for start, end in itertools.pairwise(path):
        low, high = np.minimum(start, end) - LINE_M, np.maximum(start, end) + LINE_M
        _box((*low, 0.0), (*high, INK_M), ink, board)
    for number, (x, y) in enumerate(path[::2], start=1):
        text = bpy.data.curves.new("number", "FONT")
        text.body, text.size = str(number), 0.009
        printed = _added("number", text)
        printed.location, printed.parent = (x + 0.004, y + 0.004, 2.0 * INK_M), board
        printed.data.materials.append(ink)
