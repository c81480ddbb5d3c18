from __future__ import annotations

import dataclasses
import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import irt
from irt.dimensions import Board, Marble
from irt.engine import rollouts
from irt.errors import IrtError
from irt.maze import Maze, layouts
from irt.model import Model, Parameter, load_model, save_model
from irt.report.plots import draw_rim
from irt.rig import PARAMETERS, RANGES, Rig, load_rig

RUN = (np.zeros((3, 2)), np.zeros((3, 2)))
VALUES = (0.07, 0.06, 3e-4, 24.0, 1.0)
PARAMETERS_OF = {name: Parameter(value) for name, value in zip(PARAMETERS, VALUES, strict=True)}


@pytest.mark.parametrize(("name", "holes"), [("bare", 0), ("easy", 8), ("medium", 16), ("hard", 40)])
def test_a_marble_has_room_along_the_path_of_each_layout(name: str, holes: int) -> None:
    maze = Maze.of_layout(name if name == "bare" else f"cyberrunner-{name}")
    marble = Marble()
    maze.check(Board(), marble)
    assert len(maze.holes) == holes
    assert maze.is_bare == (name == "bare")
    path = np.array(maze.path)
    assert maze.start == maze.path[0]
    places = np.concatenate(
        [a + (b - a) * np.linspace(0.0, 1.0, 400)[:, None] for a, b in itertools.pairwise(path)]
    )
    for x0, y0, x1, y1 in maze.walls:
        from_end, wall = places - [x0, y0], np.array([x1 - x0, y1 - y0])
        along = np.clip(from_end @ wall / (wall @ wall), 0.0, 1.0)
        gaps = np.linalg.norm(from_end - along[:, None] * wall, axis=1) - maze.wall_thickness_m / 2.0
        assert gaps.min() > marble.radius_m
    for hole in maze.holes:
        assert np.linalg.norm(places - hole, axis=1).min() > maze.hole_radius_m + 0.001


def test_layouts_differ() -> None:
    assert layouts() == ("bare", "cyberrunner-easy", "cyberrunner-hard", "cyberrunner-medium")
    assert len({Maze.of_layout(name) for name in layouts()}) == 4


def test_a_rig_names_a_layout_and_its_model_holds_the_numbers(write_rig, tmp_path: Path) -> None:
    rig = load_rig(write_rig({"run": RUN}, '[maze]\nlayout = "cyberrunner-medium"\n'))
    assert rig.maze == Maze.of_layout("cyberrunner-medium")
    model = Model.from_rig(rig, VALUES)
    save_model(tmp_path / "model.toml", model)
    assert load_model(tmp_path / "model.toml") == model
    assert "layout" not in (tmp_path / "model.toml").read_text()


def test_a_rig_of_a_bare_board_says_nothing_of_a_maze(write_rig, tmp_path: Path) -> None:
    rig = load_rig(write_rig({"run": RUN}))
    assert rig.maze is None
    save_model(tmp_path / "model.toml", Model.from_rig(rig, VALUES))
    assert "maze" not in (tmp_path / "model.toml").read_text()
    with_maze = Rig.from_recordings(rig.recordings, maze=Maze())
    assert with_maze.digest != Rig.from_recordings(rig.recordings).digest


def test_walls_and_holes_are_read_in_metres(write_rig) -> None:
    toml = """
    [maze]
    walls = [[0, 0, 0.05, 0], [-0.1, -0.1, -0.1, 0.1155]]
    wall_thickness_m = 0.004
    wall_height_m = 0.02
    holes = [[0.1, 0.05]]
    hole_radius_m = 0.008
    start = [-0.05, 0]
    path = [[-0.05, 0], [-0.05, 0.05], [0.05, 0.05]]
    """
    maze = load_rig(write_rig({"run": RUN}, toml)).maze
    assert maze == Maze(
        walls=((0.0, 0.0, 0.05, 0.0), (-0.1, -0.1, -0.1, 0.1155)),
        holes=((0.1, 0.05),),
        start=(-0.05, 0.0),
        path=((-0.05, 0.0), (-0.05, 0.05), (0.05, 0.05)),
        wall_thickness_m=0.004,
        wall_height_m=0.02,
        hole_radius_m=0.008,
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            'layout = "cyberrunner-eazy"',
            'unknown layout "cyberrunner-eazy"; did you mean "cyberrunner-easy"?',
        ),
        ('layout = "bare"\nholes = []', "layout brings its own holes"),
        ("walls = [[0, 0, 0.2, 0]]", "wall 1, [0, 0, 0.2, 0], leaves the board"),
        ("walls = [[0, 0, 0.1]]", "walls: number 1: expected [x0, y0, x1, y1] in metres"),
        ("walls = [[0, 0, 0.1, nan]]", "walls: number 1: expected finite numbers"),
        ("walls = 3", "walls: expected a list of [x0, y0, x1, y1]"),
        ("holes = [[0.135, 0]]", "hole 1 at [0.135, 0] leaves the board"),
        ("holes = [[0, 0], [0.01, 0]]", "hole 2 at [0.01, 0] overlaps hole 1"),
        ("walls = [[-0.1, 0.009, 0.1, 0.009]]\nholes = [[0, 0]]", "hole 1 at [0, 0] overlaps wall 1"),
        ("holes = [[0, 0]]\nhole_radius_m = 0.0068", "the marble would not fall through"),
        ("walls = [[0, 0, 0.1, 0]]\nwall_height_m = 0.006", "below the marble's centre"),
        ("hole_radius_m = -1", "hole_radius_m: expected a number from"),
        ("walls = [[0, 0, 0.1, 0]]\nstart = [0.05, 0.009]", "start: [0.05, 0.009] is no place"),
        ("holes = [[0, 0]]\nstart = [0.007, 0]", "lies over hole 1"),
        ("start = [0.135, 0]", "off the board for a marble"),
        ("start = [0]", "start: expected [x, y]"),
        ("path = [[0, 0]]", "path: expected at least two points"),
        ("path = [[0, 0], [0.2, 0]]", "step 1, [0, 0, 0.2, 0], leaves the board"),
        (
            "walls = [[0.05, -0.1, 0.05, 0.1]]\npath = [[0, 0], [0, 0.05], [0.1, 0.05]]",
            "step 2, [0, 0.05, 0.1, 0.05],",
        ),
        ("holes = [[0.05, 0.007]]\npath = [[0, 0], [0.1, 0]]", "leads over hole 1 at [0.05, 0.007]"),
        ("wall = []", 'unknown key "wall"; did you mean "walls"?'),
    ],
)
def test_what_no_maze_can_be_is_named(write_rig, text: str, said: str) -> None:
    folder = write_rig({"run": RUN}, f"[maze]\n{text}\n")
    with pytest.raises(IrtError, match=re.escape(said)) as error:
        load_rig(folder)
    assert str(error.value).startswith(f"{folder / 'rig.toml'}, [maze]") or "unknown key" in said


def test_a_maze_is_checked_against_the_board_it_is_put_on() -> None:
    maze = Maze.of_layout("cyberrunner-easy")
    with pytest.raises(IrtError, match="off the board"):
        maze.check(Board(edge_x_m=0.25), Marble())
    with pytest.raises(IrtError, match="fall through"):
        maze.check(Board(), Marble(radius_m=0.0076))
    recording = {
        "knob_x_rad": [0.0, 0.0],
        "knob_y_rad": [0.0, 0.0],
        "marble_x": [0.0, 0.0],
        "marble_y": [0.0, 0.0],
    }
    with pytest.raises(IrtError, match="leaves the board"):
        Rig.from_recordings([recording], board=Board(edge_y_m=0.2), maze=maze)


@pytest.mark.parametrize("angle", [0.1, 0.9, 1.5, 2.2, 3.0])
def test_a_path_between_the_ends_of_a_wall_crosses_it(angle: float) -> None:
    end = (0.02 * math.cos(angle), 0.02 * math.sin(angle))
    maze = Maze(walls=((0.0, -0.05, 0.0, 0.05),), path=((-end[0], -end[1]), end))
    with pytest.raises(IrtError, match="leads through wall 1"):
        maze.check(Board(), Marble())


HOLE = Maze(holes=((0.05, 0.0),), start=(-0.05, 0.0))


def test_a_marble_that_falls_is_gone_and_the_hole_is_named() -> None:
    commands = np.full((2, 60, 2), [0.0, 0.1])
    commands[1] = 0.0
    rig = Model(Board(), Marble(), "rest", dict(RANGES), PARAMETERS_OF, maze=HOLE)
    falls = np.empty((2, 2), dtype=np.int64)
    for engine in ("rolling", "rapier"):
        marble, tilt = rollouts([VALUES] * 2, commands, rig=rig, engine=engine, tilt=True, falls=falls)
        row = falls[0, 0]
        assert falls.tolist() == [[row, 0], [-1, -1]]
        assert (np.isnan(marble[0]).all(axis=1) == (np.arange(60) >= row)).all()
        assert np.linalg.norm(0.276 * marble[0, row - 1] - HOLE.holes[0]) < 0.012
        assert np.isfinite(tilt).all()
        np.testing.assert_array_equal(marble[1], np.tile([-0.05 / 0.276, 0.0], (60, 1)))


def test_a_model_brings_its_maze() -> None:
    model = Model(Board(), Marble(), "rest", dict(RANGES), PARAMETERS_OF, maze=HOLE)
    commands = np.full((60, 2), [0.0, 0.1])
    assert np.isnan(model.predict(commands)[-1]).all()
    bare = dataclasses.replace(model, maze=None)
    np.testing.assert_array_equal(
        dataclasses.replace(model, maze=Maze(start=(0.0, 0.0))).predict(commands), bare.predict(commands)
    )


def test_falls_need_an_array_of_their_shape() -> None:
    with pytest.raises(IrtError, match="falls: expected an int64 array of shape"):
        rollouts([VALUES], np.zeros((3, 2)), falls=np.zeros((2, 2), dtype=np.int64))


@pytest.mark.parametrize("function", ["tune", "diagnose", "check"])
def test_what_fits_refuses_walls_and_holes(function: str, write_rig) -> None:
    folder = write_rig({"run": RUN}, '[maze]\nlayout = "cyberrunner-easy"\n')
    with pytest.raises(IrtError, match="fits know the bare board alone") as error:
        getattr(irt, function)(load_rig(folder))
    assert f"{folder}" in str(error.value)


def test_the_bare_layout_is_no_obstacle_to_a_fit(write_rig) -> None:
    rig = load_rig(write_rig({"run": RUN}, '[maze]\nlayout = "bare"\n'))
    assert rig.on_bare_board() is rig


def test_walls_and_holes_are_drawn() -> None:
    model = Model(
        Board(), Marble(), "rest", dict(RANGES), PARAMETERS_OF, maze=Maze.of_layout("cyberrunner-medium")
    )
    axes = Figure().subplots()
    draw_rim(axes, model)
    # The rim and where a marble touches it, then one patch for each wall and hole.
    assert len(axes.patches) == 2 + 15 + 16
    wall, (x0, y0, x1, y1) = axes.patches[2], model.maze.walls[0]
    box = wall.get_window_extent().transformed(axes.transData.inverted())
    assert box.x0 * 0.276 == pytest.approx(min(x0, x1) - 0.0025, abs=2e-4)
    assert box.height * 0.276 == pytest.approx(abs(y1 - y0) + 0.005, abs=2e-4)
