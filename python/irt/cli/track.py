"""`irt track`: from a video of the board to a recording."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.rig import Board, Marble
    from irt.tracking.recorded import Summary, Timed
    from irt.tracking.run import Question, Track
    from irt.tracking.source import Source

NAME = "track"
HELP = "follow the marble through a video, a folder of images or a camera, into a recording"

#: The lens, in the folder of results.
_LENS = "camera.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt track`."""
    parser.add_argument(
        "video",
        metavar="VIDEO",
        help="a video file, a folder of images, the number of a camera (0), or an address",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="folder for the recording and what was seen (default: irt-track-NAME, for a video NAME)",
    )
    parser.add_argument(
        "--commands",
        metavar="CSV",
        type=Path,
        help="the commands that were played, with their times in t_s: the two clocks are aligned",
    )
    parser.add_argument(
        "--offset",
        metavar="SECONDS",
        type=float,
        help="from the commands' clock to the video's (default: found by cross-correlation)",
    )
    parser.add_argument(
        "--rig",
        metavar="RIG",
        type=Path,
        help="a rig.toml, or its folder, with sizes of board and marble (default: DIR's, else the paper's)",
    )
    parser.add_argument(
        "--lens",
        metavar="FILE",
        type=Path,
        help=f"the camera's calibration (default: {_LENS} of DIR, where it is)",
    )
    parser.add_argument(
        "--corners",
        metavar="X,Y",
        type=_pair,
        nargs=4,
        help="the board's corners in the first picture [pixels], clockwise from least x, greatest y "
        "(default: found)",
    )
    parser.add_argument(
        "--marble",
        metavar="X,Y",
        type=_pair,
        action="append",
        default=[],
        help="where the marble is in the first picture [pixels] (default: learned from what moves)",
    )
    parser.add_argument(
        "--colour", metavar="R,G,B", type=_colour, help="the marble's colour, 0 to 255 (default: learned)"
    )
    parser.add_argument(
        "--fps", metavar="RATE", type=_positive, help="pictures a second, where the file is wrong"
    )
    parser.add_argument("--seconds", metavar="S", type=_positive, help="stop after so long")
    parser.add_argument(
        "--publish", action="store_true", help="publish each position on /marble/position, for ROS 2 nodes"
    )
    parser.add_argument(
        "--calibrate",
        action="store_true",
        help=f"VIDEO shows a chessboard or ChArUco board: write the lens to {_LENS} of DIR",
    )
    parser.add_argument(
        "--pattern",
        metavar="COLUMNSxROWS",
        type=_pattern,
        default=(9, 6),
        help="inner corners of the chessboard, or squares of the ChArUco board (default: 9x6)",
    )
    parser.add_argument("--charuco", action="store_true", help="the pattern is a ChArUco board (4x4_50)")
    parser.epilog = (
        "examples:\n"
        "  irt track run-1.mp4 --commands knobs-1.csv --out my-rig     then: irt diagnose my-rig\n"
        "  irt track chessboard.mp4 --calibrate --out my-rig           the lens, used by all later tracks\n"
        "  irt track 0 --publish                                       a camera, live; Ctrl-C ends it\n\n"
        "example:\n"
        "  irt track run-1.mp4"
    )


def run(args: argparse.Namespace) -> None:
    """Track, write what was seen, and say how well."""
    from irt.files import make_folder
    from irt.tracking.source import open_source

    source = open_source(args.video, args.fps)
    try:
        folder = make_folder(args.out or Path(f"irt-track-{source.name}"))
        if args.calibrate:
            _calibrate(args, source, folder)
        else:
            _track(args, source, folder)
    finally:
        source.close()


def _calibrate(args: argparse.Namespace, source: Source, folder: Path) -> None:
    """Write the lens that the pictures show."""
    from irt.cli.progress import progress_bar
    from irt.tracking.calibration import Pattern, calibrate, save_lens

    with progress_bar() as progress:
        progress(0, 1, "reading pictures")
        pictures = source.sample(120)
        columns, rows = args.pattern
        lens, count = calibrate(pictures, Pattern(columns, rows, args.charuco), progress)
    save_lens(folder / _LENS, lens, count)
    print(
        f"{lens.size[0]} x {lens.size[1]} pixels, focal length {lens.matrix[0, 0]:.1f}; {count} of ", end=""
    )
    print(f"{len(pictures)} pictures show the pattern; {lens.error_px:.2f} pixels are left over")
    print(f"\nwrote {folder / _LENS}")


def _track(args: argparse.Namespace, source: Source, folder: Path) -> None:
    """Follow the marble; keep what was seen, however the run ends."""
    from irt.cli.progress import progress_bar
    from irt.recording import load_commands
    from irt.report.tracking_report import write_tracking_report
    from irt.tracking.overlay import ContactSheet, Overlay
    from irt.tracking.recorded import laid_on, save_metadata, save_positions, save_timed
    from irt.tracking.run import follow, prepare

    board, marble = _sizes(args, folder)
    commands = load_commands(args.commands) if args.commands else None
    question = _question(args, folder, board, marble)
    publisher = _publisher() if args.publish else None
    path = folder / f"{source.name}.csv"
    partial = folder / f"{source.name}.partial"
    with ExitStack() as stack:
        progress = stack.enter_context(progress_bar())
        scene = prepare(source, question, progress)
        sheet = ContactSheet(scene, source.expected)
        overlay = None
        if not source.live:
            from irt.files import atomic_path

            beside = stack.enter_context(atomic_path(folder / f"{source.name}-overlay.mp4"))
            overlay = Overlay(beside, scene, args.fps or 30.0)
            stack.callback(overlay.close)

        def watch(frame: Any, sighting: Any, place: Any) -> None:
            if publisher is not None and place[0] == place[0]:
                publisher.publish(float(place[0]), float(place[1]), frame.wall)
            sheet.add(frame, sighting)
            if overlay is not None:
                overlay.add(frame, sighting)

        track = follow(source, scene, partial, progress, seconds=args.seconds, watch=watch)
    timed = laid_on(track, commands, path, args.offset) if commands is not None else None
    if timed is not None:
        save_timed(timed)
    else:
        save_positions(path, track)
    summary = _summary(track)
    sheet.write(folder / f"{source.name}-unsure.png")
    facts = _facts(args, source, timed)
    save_metadata(folder / f"{source.name}.json", track, summary, facts)
    page = write_tracking_report(folder, track, summary, timed, facts=facts, edge_m=board.edge_x_m)
    partial.unlink(missing_ok=True)
    for line in _answer(summary, timed, board):
        print(line)
    if commands is None:
        print("no commands are known: --commands CSV makes this a recording for irt diagnose")
    print(f"\nwrote {path}, {page} and what they show")
    if track.stopped:
        raise IrtError(f"{track.stopped}: what was seen in {len(track.stamps)} pictures is kept")


def _question(args: argparse.Namespace, folder: Path, board: Board, marble: Marble) -> Question:
    """Return what is asked, from the command line and the folder's calibration."""
    from irt.tracking.calibration import load_lens
    from irt.tracking.geometry import Size
    from irt.tracking.learning import Clue
    from irt.tracking.run import Question

    lens = args.lens or (folder / _LENS if (folder / _LENS).exists() else None)
    edge = board.edge_x_m
    return Question(
        size=Size(1.0, board.edge_y_m / edge, marble.radius_m / edge),
        lens=load_lens(lens) if lens else None,
        corners=tuple(args.corners) if args.corners else None,
        clue=Clue(tuple(args.marble), args.colour),
    )


def _sizes(args: argparse.Namespace, folder: Path) -> tuple[Board, Marble]:
    """Return the sizes of board and marble: of a rig that was named, of the folder's, or the paper's."""
    from irt.files import TomlTable, read_toml
    from irt.rig import read_dimensions

    named = args.rig
    if named is not None and named.is_dir():
        named = named / "rig.toml"
    if named is None and (folder / "rig.toml").exists():
        named = folder / "rig.toml"
    return read_dimensions(read_toml(named) if named is not None else TomlTable("rig.toml", {}))


def _publisher() -> Any:
    from irt.tracking.live import Publisher

    return Publisher()


def _summary(track: Track) -> Summary:
    """Return what the track is worth, its noise estimated as that of a recording is."""
    from irt.fitting.problem import noise_in
    from irt.tracking.recorded import summarise

    return summarise(track, noise_in([track.marble]))


def _facts(args: argparse.Namespace, source: Source, timed: Timed | None) -> dict[str, Any]:
    """Return what the track was made from."""
    facts: dict[str, Any] = {"video": args.video, "stamps": source.stamped_by}
    if timed is not None:
        facts["commands"] = str(args.commands)
        facts["offset_s"] = timed.offset
        if timed.alignment is not None:
            facts["offset_error_s"] = timed.alignment.error
            facts["explained"] = timed.alignment.explained
    return facts


def _answer(summary: Summary, timed: Timed | None, board: Board) -> list[str]:
    """Return what a user wants to know first."""
    from irt.report.words import counted

    mm = 1000.0 * board.edge_x_m
    lines = [
        f"the marble is seen in {summary.seen:,} of {summary.pictures:,} pictures "
        f"({100 * summary.detection:.2f} %); noise {summary.noise * summary.pixels_per_edge:.2f} pixels, "
        f"{summary.noise * mm:.2f} mm"
    ]
    gaps = summary.gaps
    if gaps.dropped or gaps.repeated:
        lines.append(f"{counted(gaps.dropped, 'picture')} missing, {gaps.repeated:,} shown twice")
    if timed is not None and timed.alignment is not None:
        found = timed.alignment
        lines.append(
            f"commands lie {found.offset:.4f} +- {found.error:.4f} s from the video's clock (the rig's own "
            "delay is in this)"
        )
    lines += [f"height of the marble {summary.height}", f"tilt of the board {summary.tilt}"]
    if summary.moving:
        lines.append('the marble moves in the first picture: rig.toml needs [recordings] start = "moving"')
    return lines


def _numbers(text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(one) for one in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(abs(one) < 1e6 for one in numbers):
        raise argparse.ArgumentTypeError(f"expected {count} numbers with commas between them, found {text}")
    return numbers


def _pair(text: str) -> tuple[float, ...]:
    return _numbers(text, 2)


def _colour(text: str) -> tuple[float, ...]:
    """Return a colour, blue first, as pictures have them."""
    numbers = _numbers(text, 3)
    if not all(0 <= one <= 255 for one in numbers):
        raise argparse.ArgumentTypeError(f"expected red, green, blue from 0 to 255, found {text}")
    return numbers[::-1]


def _positive(text: str) -> float:
    (number,) = _numbers(text, 1)
    if number <= 0:
        raise argparse.ArgumentTypeError(f"expected a number above 0, found {text}")
    return number


def _pattern(text: str) -> tuple[int, int]:
    columns, _, rows = text.partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and min(int(columns), int(rows)) >= 3):
        raise argparse.ArgumentTypeError(f"expected COLUMNSxROWS, at least 3x3, found {text}")
    return int(columns), int(rows)
