"""The way through: pictures in, the marble's path out, and what there is to know of it."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.blob_detector import Box
from irt.tracking.board_edges import BoardEdges
from irt.tracking.board_texture import BoardTexture
from irt.tracking.corners import MISSHAPEN, checked, mean_side
from irt.tracking.geometry import Geometry, Lens, Plane, Pose, Size
from irt.tracking.learning import learn, scale_of
from irt.tracking.markers import Markers
from irt.tracking.nested import require_board
from irt.tracking.opencv import opencv
from irt.tracking.outline import board_outline, board_sides
from irt.tracking.partial import Partial
from irt.tracking.separation import Clue
from irt.tracking.source import Frame, Picture, Source
from irt.tracking.stabilised import Stabilised
from irt.tracking.standing import absences
from irt.tracking.timing import repeated_by_encoder
from irt.tracking.tracker import Learned, Sighting, Tracker

Array = NDArray[np.float64]
Progress = Callable[[int, int, str], None]

#: Pictures that board, light and marble are learned from.
SAMPLE = 48
#: How far a marble may be seen beyond the corners, in its radii: it stands on the board, and the board tilts.
BEYOND = 2.5
#: Every so many pictures are looked at for whether the board is where it was.
LOOKED_AT = 10
#: A picture that differs from the one before by less than this share of what is usual is that one again.
SAME = 0.05
#: Standard error of corners given in whole pixels [pixels].
GIVEN_PX = float(np.sqrt(2.0 / 12.0))
#: Every so many pixels are compared for that.
SPARSE = 7


@dataclass(frozen=True)
class Question:
    """What is asked of a run.

    Attributes
    ----------
    size : Size
        Of board and marble [board edges].
    lens : Lens or None
        Of the camera.
    corners : sequence of (x, y) or None
        The board's [pixels], clockwise from the one of least x and greatest y; by default they are found.
    clue : Clue
        What is known of the marble.
    """

    size: Size
    lens: Lens | None = None
    corners: tuple[tuple[float, float], ...] | None = None
    clue: Clue = field(default_factory=Clue)


@dataclass(frozen=True, eq=False)
class Scene:
    """A board before a camera, as learned.

    Attributes
    ----------
    size : Size
        Of board and marble [board edges].
    corners : (4, 2) array
        Of the level board [pixels].
    corners_px : float
        Standard error of the corners, of whole pixels where they were given [pixels].
    found_by : str
        How the corners were found, in words.
    geometry : Plane or Pose
        Of the level board.
    markers : Markers or None
        Those on the board, where they show its tilt.
    edges : BoardEdges or None
        The board's sides, where they show its tilt.
    texture : BoardTexture or None
        What is on the board, where it alone shows the tilt.
    sides : BoardEdges or None
        The board's sides, where they are clear.
    learned : Learned
        Light and marble.
    usual_change : float
        How much a picture differs from the one before [levels].
    """

    size: Size
    corners: Array
    corners_px: float
    found_by: str
    geometry: Geometry
    markers: Markers | None
    edges: BoardEdges | None
    texture: BoardTexture | None
    sides: BoardEdges | None
    learned: Learned
    usual_change: float

    @property
    def tilt_noise(self) -> Array | None:
        """Standard error (2,) of the measured tilt about x and y [rad], None where it is not measured."""
        return None if self.shows_tilt is None else self.shows_tilt.tilt_noise()

    @property
    def shows_tilt(self) -> Markers | BoardEdges | BoardTexture | None:
        """What shows the board's tilt."""
        return self.markers or self.edges or self.texture

    def tracker(self) -> Tracker:
        """Return a tracker for this board."""
        return Tracker(self.learned, scale_of(self.geometry, self.learned.finder.middle))


@dataclass(frozen=True, eq=False)
class Track:
    """Where a marble was seen in n pictures.

    Attributes
    ----------
    name : str
        Of the run.
    scene : Scene
        As learned.
    stamps : (n,) array
        [s] from the first picture.
    pixels : (n, 2) array
        The marble's middle, NaN where it is lost.
    marble : (n, 2) array
        The same on the board [board edges].
    confidence : (n,) array
        From 0 to 1.
    repeated : (n,) bool array
        Pictures that show the one before once more; their positions are NaN.
    in_window : (n,) bool array
        Where the search of a window was enough.
    tilt : (n, 2) array
        The board's angles about x and y [rad] by the right-hand rule, from their mean where its sides show
        them, from the first picture where markers or its texture do; NaN where they were not measured.
    away : tuple of (first, count)
        Stretches of pictures in which the board is not where it was; their positions are NaN.
    stopped : str
        Why the run ended early, or nothing.
    """

    name: str
    scene: Scene
    stamps: Array
    pixels: Array
    marble: Array
    confidence: Array
    repeated: NDArray[np.bool_]
    in_window: NDArray[np.bool_]
    tilt: Array
    away: tuple[tuple[int, int], ...]
    stopped: str = ""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Pictures in which the marble is seen (n,)."""
        return ~np.isnan(self.marble[:, 0])

    def new(self) -> Track:
        """Return the track without the pictures that repeat the one before."""
        names = ("stamps", "pixels", "marble", "confidence", "repeated", "in_window", "tilt")
        return replace(self, away=(), **{name: getattr(self, name)[~self.repeated] for name in names})


def prepare(source: Source, question: Question, progress: Progress) -> Scene:
    """Find the board, and learn light and marble from a sample of the pictures.

    Raises
    ------
    IrtError
        If there is no board, no marble, or the calibration is of other pictures.
    """
    progress(0, 3, "a sample of the pictures")
    pictures = source.sample(SAMPLE)
    if len(pictures) < 2:
        raise IrtError(f"{source.name}: {len(pictures)} pictures only; a marble is known by its motion")
    height, width = pictures[0].shape[:2]
    lens = question.lens
    if lens is not None and lens.size != (width, height):
        raise IrtError(
            f"the calibration is of pictures of {lens.size[0]} x {lens.size[1]} pixels, these have {width} x "
            f"{height}: calibrate with this resolution"
        )
    progress(1, 3, "the board")
    size = question.size
    edges: BoardEdges | None = None
    if question.corners is not None:
        corners, found_by, mean = checked(question.corners, size), "given", False
    else:
        corners, found_by, mean = board_outline(pictures, lens, size)
        edges = board_sides(pictures, corners, lens)
    if edges is not None:
        corners = edges.corners
        is_known = edges.clear and edges.error_px < MISSHAPEN * mean_side(corners)
        if lens is None or is_known:
            require_board(np.median(np.stack(pictures), axis=0).astype(np.uint8), corners, lens, size)
    if edges is not None and edges.clear:
        # A board that is elsewhere is no ground for the marble.
        pictures = [pictures[0], *(one for one in pictures[1:] if edges.stand(one))]
    geometry: Geometry = Plane.of(corners, size)
    if lens is not None:
        geometry = Pose.of(lens, corners, size.corners, size.radius)
    markers = Markers(pictures[0], geometry, size, lens)
    follows = edges is not None and not markers.enough and edges.watch(geometry, size)
    texture = None if follows or markers.enough else _texture(pictures, geometry, size, mean=mean)
    shows = markers if markers.enough else edges if follows else texture
    progress(2, 3, "the marble")
    sample = _stabilised(pictures, shows, geometry, size)
    clue = replace(question.clue, places=sample.to_stabilised(question.clue.places))
    learned = learn(sample.pictures, geometry, board_box(corners, geometry, (width, height)), clue)
    if learned.first is not None:
        learned = replace(learned, first=sample.to_taken(learned.first))
    return Scene(
        size,
        corners,
        GIVEN_PX if edges is None else edges.error_px,
        found_by,
        geometry,
        markers if markers.enough else None,
        edges if follows else None,
        texture,
        edges if edges is not None and edges.clear else None,
        learned,
        _usual_change(pictures),
    )


def _stabilised(
    pictures: list[Picture], shows: Markers | BoardEdges | BoardTexture | None, geometry: Geometry, size: Size
) -> Stabilised:
    """Return a sample with the board in one place, as it was taken where nothing shows its tilt."""
    if shows is None:
        return Stabilised(pictures, geometry, geometry)
    if isinstance(shows, BoardTexture):
        return Stabilised.of(pictures, shows.sample, geometry, size)
    # The noise that a run states is that of its own pictures.
    measures = deepcopy(shows)
    return Stabilised.of(pictures, [measures.follow(one) for one in pictures], geometry, size)


def _texture(pictures: list[Picture], geometry: Geometry, size: Size, *, mean: bool) -> BoardTexture | None:
    """Return what is on the board, where that shows its tilt before a calibrated lens."""
    if not isinstance(geometry, Pose):
        return None
    texture = BoardTexture(pictures, geometry, size, mean=mean)
    return texture if texture.shows else None


def board_box(corners: Array, geometry: Geometry, size: tuple[int, int]) -> Box:
    """Return where in pictures of this size the marble can be."""
    middle = corners.mean(axis=0)
    margin = BEYOND * geometry.radius_at((float(middle[0]), float(middle[1])))
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    whole = Box(0, 0, *size)
    return Box(
        max(int(low[0]), whole.left),
        max(int(low[1]), whole.top),
        min(int(high[0]) + 1, whole.right),
        min(int(high[1]) + 1, whole.bottom),
    )


def _usual_change(pictures: list[Picture]) -> float:
    """Return how much pictures differ [levels]; of a sample, which is more than from one to the next."""
    changes = [_change(one, other) for one, other in pairwise(pictures)]
    return float(np.median(changes))


def _change(one: Picture, other: Picture) -> float:
    apart = opencv().absdiff(
        np.ascontiguousarray(one[::SPARSE, ::SPARSE]), np.ascontiguousarray(other[::SPARSE, ::SPARSE])
    )
    return float(apart.mean())


@dataclass(frozen=True, eq=False)
class Seen:
    """A picture and what was seen on it.

    Attributes
    ----------
    frame : Frame
        The picture.
    sighting : Sighting
        What was seen on it.
    place : (2,) array
        Where that is on the board [board edges], NaN where it is lost.
    repeated : bool
        Whether the picture shows the one before once more; then there is no place.
    geometry : Plane or Pose
        Of the board in this picture.
    tilt : (2,) array
        Its angles about x and y [rad], NaN where they were not measured.
    """

    frame: Frame
    sighting: Sighting
    place: Array
    repeated: bool
    geometry: Geometry
    tilt: Array

    @classmethod
    def of(cls, frame: Frame, sighting: Sighting, geometry: Geometry, tilt: Array, *, repeated: bool) -> Seen:
        """Return what was seen with its place."""
        place = np.full(2, np.nan)
        if sighting.seen and not repeated:
            place = geometry.positions(np.array([[sighting.x, sighting.y]]))[0]
        return cls(frame, sighting, place, repeated, geometry, tilt)

    @property
    def row(self) -> tuple[float, ...]:
        """Stamp, pixel, place, confidence, repeated, in the window, tilt."""
        pixel = (np.nan, np.nan) if self.repeated else (self.sighting.x, self.sighting.y)
        one = self.sighting
        return (
            self.frame.stamp,
            *pixel,
            *self.place,
            one.confidence,
            self.repeated,
            one.in_window,
            *self.tilt,
        )


class Follower:
    """Takes pictures one by one, and keeps what it saw."""

    def __init__(self, name: str, scene: Scene) -> None:
        self.name, self.scene = name, scene
        self._tracker = scene.tracker()
        self._geometry: Geometry = scene.geometry
        self._last: Seen | None = None
        self._rows: list[tuple[float, ...]] = []
        #: By how much each picture differs from the one before [levels].
        self._changes: list[float] = []
        self._looks: list[tuple[int, bool]] = []
        if scene.learned.first is not None:
            self._tracker.expect(*scene.learned.first)

    def take(self, frame: Frame) -> tuple[Seen | None, Seen]:
        """Return what is seen on the next picture, after the picture before where that is sure only now."""
        picture = frame.picture
        last = self._last
        change = np.inf if last is None else _change(picture, last.frame.picture)
        again = change <= SAME * self.scene.usual_change
        board = self.scene.shows_tilt
        measured = None if board is None else board.follow(picture)
        self._geometry = measured or self._geometry
        moved = None if measured is None else (self.scene.geometry, measured)
        sighting = self._tracker.see(picture, moved)
        before = None
        if last is not None and sighting.confirms is not None:
            before = Seen.of(last.frame, sighting.confirms, last.geometry, last.tilt, repeated=last.repeated)
            self._rows[-1] = before.row
        if self.scene.sides is not None and len(self._rows) % LOOKED_AT == 0:
            self._looks.append((len(self._rows), self.scene.sides.stand(picture)))
        tilt = np.full(2, np.nan)
        if isinstance(measured, Pose) and isinstance(self.scene.geometry, Pose):
            tilt = measured.tilt_from(self.scene.geometry)
        self._last = Seen.of(frame, sighting, self._geometry, tilt, repeated=again)
        self._rows.append(self._last.row)
        self._changes.append(change)
        return before, self._last

    def track(self, stopped: str = "") -> Track:
        """Return all that was seen so far."""
        table = np.array(self._rows, dtype=np.float64).reshape(-1, 10)
        away = absences(self._looks, table[:, 0])
        for first, count in away:
            table[first : first + count, 1:5] = np.nan
            table[first : first + count, 8:10] = np.nan
        again = repeated_by_encoder(np.array(self._changes))
        table[again, 1:5] = np.nan
        table[again, 6] = 1.0
        return Track(
            self.name,
            self.scene,
            table[:, 0],
            table[:, 1:3],
            table[:, 3:5],
            table[:, 5],
            table[:, 6] > 0,
            table[:, 7] > 0,
            table[:, 8:10],
            away,
            stopped,
        )


def follow(
    source: Source,
    scene: Scene,
    partial: Path,
    progress: Progress,
    *,
    seconds: float | None = None,
    watch: Callable[[Frame, Sighting, Array], None] | None = None,
) -> Track:
    """Track a marble through all pictures.

    What was seen is kept where the camera disappears, or Ctrl-C ends the run: `Track.stopped` then says why.

    Parameters
    ----------
    source : Source
        Of the pictures.
    scene : Scene
        What `prepare` learned.
    partial : path
        A file that is written as the run goes on, and removed by whoever has saved the track.
    progress : callable
        Called with pictures done, expected, and a text.
    seconds : float, optional
        When to stop.
    watch : callable, optional
        Called with every picture, what was seen on it, and where that is on the board.

    Raises
    ------
    IrtError
        If there was no picture at all.
    """
    follower = Follower(source.name, scene)
    stopped = ""
    with Partial(partial) as rows:
        held: list[Seen] = []

        def let_go(keep: int) -> None:
            while len(held) > keep:
                one = held.pop(0)
                rows.add(one.frame.stamp, one.place, one.sighting.confidence)
                if watch is not None:
                    watch(one.frame, one.sighting, one.place)

        try:
            for count, frame in enumerate(source.frames()):
                if seconds is not None and frame.stamp > seconds:
                    break
                before, seen = follower.take(frame)
                if before is not None and held:
                    held[-1] = before
                held.append(seen)
                # A point that is read as it comes cannot wait for the picture after.
                let_go(0 if source.live else 1)
                progress(count + 1, max(source.expected, count + 1), "pictures")
        except KeyboardInterrupt:
            stopped = "stopped by hand"
        except IrtError as error:
            stopped = str(error)
        let_go(0)
    track = follower.track(stopped)
    if not len(track.stamps):
        raise IrtError(stopped or f"{source.name}: there were no pictures")
    return track
