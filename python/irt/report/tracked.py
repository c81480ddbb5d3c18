"""Track a video, and write the recording and its report: `irt.track`, as behind ``irt track``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irt import arguments
from irt.errors import IrtError
from irt.files import PathLike, TomlTable, atomic_path, make_folder, read_toml
from irt.fitting.fit import Progress
from irt.fitting.problem import noise_in
from irt.recording import Commands, Recording, load_commands
from irt.rig import Board, Marble, Rig, read_dimensions

if TYPE_CHECKING:
    from irt.checking import Finding
    from irt.tracking.recorded import Summary, Timed
    from irt.tracking.run import Question, Track
    from irt.tracking.source import Source

#: File of the lens calibration, in the folder of results.
LENS = "camera.toml"
#: Frame rate of the overlay if that of the source is unknown [Hz].
_OVERLAY_FPS = 30.0


@dataclass(frozen=True, eq=False)
class Tracked:
    """A tracked video.

    Attributes
    ----------
    path : Path
        The CSV file: a recording if commands are known, else the positions only.
    page : Path
        The report on the quality of the track.
    track : Track
        The marble in each picture; `Track.stopped` gives the reason if tracking ended early.
    summary : Summary
        Quality of the track.
    timed : Timed or None
        The recording, if commands are known.
    board : Board
        Dimensions of the board.
    findings : tuple of Finding
        Errors of axes, signs and units of the recording, inferred from the marble's response to the commands.
    """

    path: Path
    page: Path
    track: Track
    summary: Summary
    timed: Timed | None
    board: Board
    findings: tuple[Finding, ...]

    @property
    def recording(self) -> Recording | None:
        """The recording; None if commands are unknown."""
        return None if self.timed is None else self.timed.recording


@arguments.entry
def track(
    video: str | PathLike,
    *,
    out: PathLike | None = None,
    commands: PathLike | None = None,
    offset: float | None = None,
    rig: PathLike | None = None,
    lens: PathLike | None = None,
    corners: Sequence[tuple[float, float]] | None = None,
    marble: Sequence[tuple[float, float]] = (),
    colour: tuple[float, float, float] | None = None,
    fps: float | None = None,
    seconds: float | None = None,
    publish: bool = False,
    progress: Progress | None = None,
) -> Tracked:
    """Track the marble in a video, and write the recording, an overlay video and a report.

    Parameters
    ----------
    video : str or path
        A video file, a folder of images, the number of a camera ("0"), or an address.
    out : path, optional
        Folder for the results; default ``irt-track-NAME`` for a video ``NAME``.
    commands : path, optional
        CSV of the played commands, with their times in ``t_s``; the two clocks are aligned.
    offset : float, optional
        Offset from the commands' clock to the video's [s]; default by cross-correlation.
    rig : path, optional
        A ``rig.toml`` or its folder, with the sizes of board and marble; default that of `out`, or the
        paper's sizes.
    lens : path, optional
        Lens calibration of the camera; default ``camera.toml`` of `out`, if present.
    corners : sequence of 4 (x, y), optional
        The board's corners in the first picture [pixels], clockwise from least x, greatest y.
    marble : sequence of (x, y)
        Position of the marble in the first picture [pixels]; default learned from motion.
    colour : (blue, green, red), optional
        The marble's colour, 0 to 255; default learned.
    fps : float, optional
        Pictures per second, if those of the file are wrong.
    seconds : float, optional
        Stop after this time [s].
    publish : bool
        Publish each position on ``/marble/position``, for ROS 2 nodes.
    progress : callable, optional
        Called with (done, total, text).

    Raises
    ------
    IrtError
        If the video cannot be read, the board or the marble is not found, or the commands do not match the
        video. Positions found before the error are kept, and the message gives their path.
    """
    from irt.tracking.source import open_source  # noqa: PLC0415  # OpenCV loads only where it is used

    for name, value in (("offset", offset), ("fps", fps), ("seconds", seconds)):
        if value is not None:
            arguments.number(name, value)
    for name, given in (("out", out), ("commands", commands), ("rig", rig), ("lens", lens)):
        if given is not None:
            arguments.path(name, given)
    arguments.progress(progress)
    video = f"{arguments.path('video', video)}"
    source = open_source(video, fps)
    try:
        folder = make_folder(Path(f"irt-track-{source.name}") if out is None else out)
        board, ball = _sizes(rig, folder)
        question = _question(folder, board, ball, lens=lens, corners=corners, marble=marble, colour=colour)
        played = None if commands is None else load_commands(commands)
        with ExitStack() as stack:
            stack.enter_context(_kept(_partial(folder, source)))
            seen = _follow(
                source, question, folder, fps=fps, seconds=seconds, publish=publish, progress=progress
            )
            path = folder / f"{source.name}.csv"
            timed = _saved(seen, played, path, offset)
            facts = _facts(video, commands, timed)
            findings = () if timed is None else _axes(timed.recording, board, ball)
            return _described(
                seen, timed, path, facts=facts, board=board, stamps=source.stamped_by, findings=findings
            )
    finally:
        source.close()


@contextmanager
def _kept(partial: Path) -> Iterator[None]:
    """Add the path of partial positions to an error; remove them if the block succeeds."""
    try:
        yield
    except IrtError as error:
        if not partial.exists():
            raise
        if len(partial.read_text(encoding="utf-8").splitlines()) < 2:
            partial.unlink()
            raise
        raise IrtError(f"{error}; the positions found before are kept in {partial}") from error
    partial.unlink(missing_ok=True)


def _partial(folder: Path, source: Source) -> Path:
    return folder / f"{source.name}.partial"


def _follow(
    source: Source,
    question: Question,
    folder: Path,
    *,
    fps: float | None,
    seconds: float | None,
    publish: bool,
    progress: Progress | None,
) -> Track:
    """Track the marble; write an overlay video and a sheet of the least certain pictures."""
    from irt.tracking.nested import AmbiguousBoardError  # noqa: PLC0415
    from irt.tracking.outline_sheet import write_outlines  # noqa: PLC0415
    from irt.tracking.overlay import ContactSheet, Overlay  # noqa: PLC0415
    from irt.tracking.run import follow, prepare  # noqa: PLC0415

    report: Progress = progress if progress is not None else lambda *_: None
    publisher = _publisher() if publish else None
    with ExitStack() as stack:
        try:
            scene = prepare(source, question, report)
        except AmbiguousBoardError as error:
            path = folder / f"{source.name}-outlines.png"
            write_outlines(path, error)
            raise IrtError(f"{error}; {path} shows what was found, with its corners") from error
        sheet = ContactSheet(scene, source.expected)
        overlay = None
        if not source.live:
            beside = stack.enter_context(atomic_path(folder / f"{source.name}-overlay.mp4"))
            overlay = Overlay(beside, scene, fps or _OVERLAY_FPS)
            stack.callback(overlay.close)

        def watch(frame: Any, sighting: Any, place: Any) -> None:
            if publisher is not None and place[0] == place[0]:
                publisher.publish(float(place[0]), float(place[1]), frame.wall)
            sheet.add(frame, sighting)
            if overlay is not None:
                overlay.add(frame, sighting)

        found = follow(source, scene, _partial(folder, source), report, seconds=seconds, watch=watch)
        if overlay is not None:
            overlay.finish()
    sheet.write(folder / f"{source.name}-unsure.png")
    return found


def _saved(found: Track, commands: Commands | None, path: Path, offset: float | None) -> Timed | None:
    """Write the recording, or only the positions."""
    from irt.tracking.recorded import laid_on, save_positions, save_timed  # noqa: PLC0415

    if commands is None:
        save_positions(path, found)
        return None
    timed = laid_on(found, commands, path, offset)
    save_timed(timed)
    return timed


def _axes(recording: Recording, board: Board, ball: Marble) -> tuple[Finding, ...]:
    """Return errors of the axes of a recording, such as an upside-down or mirrored picture."""
    from irt.checking.run import axes_and_units  # noqa: PLC0415

    rig = Rig.from_recordings([recording], board=board, marble=ball, start="moving")
    return tuple(one for one in axes_and_units(rig) if one.severity != "note")


def _described(
    found: Track,
    timed: Timed | None,
    path: Path,
    *,
    facts: dict[str, Any],
    board: Board,
    stamps: str,
    findings: tuple[Finding, ...],
) -> Tracked:
    """Write the metadata and the report of a track beside it."""
    from irt.report.tracking_report import write_tracking_report  # noqa: PLC0415
    from irt.tracking.recorded import save_metadata, summarise  # noqa: PLC0415

    folder = path.parent
    summary = summarise(found, noise_in([found.new().marble]), 1000.0 * board.edge_x_m, stamps)
    save_metadata(folder / f"{found.name}.json", found, summary, facts)
    page = write_tracking_report(folder, found, summary, timed, facts=facts, edge_m=board.edge_x_m)
    return Tracked(path, page, found, summary, timed, board, findings)


def _question(
    folder: Path,
    board: Board,
    ball: Marble,
    *,
    lens: PathLike | None,
    corners: Sequence[tuple[float, float]] | None,
    marble: Sequence[tuple[float, float]],
    colour: tuple[float, float, float] | None,
) -> Question:
    """Return the input of the tracker, with the folder's calibration."""
    from irt.tracking.calibration import load_lens  # noqa: PLC0415
    from irt.tracking.geometry import Size  # noqa: PLC0415
    from irt.tracking.run import Question  # noqa: PLC0415
    from irt.tracking.separation import Clue  # noqa: PLC0415

    if lens is None and (folder / LENS).exists():
        lens = folder / LENS
    edge = board.edge_x_m
    return Question(
        size=Size(1.0, board.edge_y_m / edge, ball.radius_m / edge),
        lens=None if lens is None else load_lens(lens),
        corners=None if corners is None else _places("corners", corners),
        clue=Clue(_places("marble", marble), None if colour is None else _triple(colour)),
    )


def _places(name: str, values: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise IrtError(f"{name}: expected pairs of pixels, got {arguments.shown(values)}")
    return tuple(arguments.pair(name, one) for one in values)


def _triple(values: tuple[float, float, float]) -> tuple[float, float, float]:
    if not isinstance(values, tuple | list) or len(values) != 3:
        raise IrtError(f"colour: expected three numbers from 0 to 255, got {arguments.shown(values)}")
    blue, green, red = (arguments.number("colour", one) for one in values)
    return blue, green, red


def _sizes(named: PathLike | None, folder: Path) -> tuple[Board, Marble]:
    """Return the sizes of board and marble: of the given rig, of the folder's rig, or the paper's."""
    settings = folder / "rig.toml" if named is None else Path(named)
    if settings.is_dir():
        settings /= "rig.toml"
    if named is None and not settings.exists():
        return read_dimensions(TomlTable("rig.toml", {}))
    return read_dimensions(read_toml(settings))


def _publisher() -> Any:
    from irt.tracking.live import Publisher  # noqa: PLC0415

    return Publisher()


def _facts(video: str, commands: PathLike | None, timed: Timed | None) -> dict[str, Any]:
    """Return the inputs of the track."""
    facts: dict[str, Any] = {"video": video}
    if timed is not None:
        facts["commands"] = str(commands)
        facts["offset_s"] = timed.offset
        if timed.alignment is not None:
            facts["offset_error_s"] = timed.alignment.error
            facts["explained"] = timed.alignment.explained
    return facts
