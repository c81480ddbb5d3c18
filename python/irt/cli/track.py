"""`irt track`: track the marble in a video, and write a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import positive
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.rig import Board
    from irt.tracking.recorded import Summary, Timed

NAME = "track"
HELP = "track the marble in a video, a folder of images or a camera, and write a recording"

#: File of the lens calibration, in the folder of results.
_LENS = "camera.toml"
#: File of the markers to print.
_SHEET = "markers.pdf"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt track`."""
    parser.add_argument(
        "video",
        metavar="VIDEO",
        nargs="?",
        help="a video file, a folder of images, the number of a camera (0), or an address",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="folder for the recording and the report (default: irt-track-NAME for a video NAME)",
    )
    parser.add_argument(
        "--commands",
        metavar="CSV",
        type=Path,
        help="played commands, with their times in t_s; the two clocks are aligned",
    )
    parser.add_argument(
        "--offset",
        metavar="SECONDS",
        type=float,
        help="offset from the commands' clock to the video's (default: by cross-correlation)",
    )
    parser.add_argument(
        "--rig",
        metavar="RIG",
        type=Path,
        help="a rig.toml or its folder, with the sizes of board and marble (default: that of DIR, or the "
        "paper's sizes)",
    )
    parser.add_argument(
        "--lens",
        metavar="FILE",
        type=Path,
        help=f"lens calibration of the camera (default: {_LENS} of DIR, if present)",
    )
    parser.add_argument(
        "--corners",
        metavar="X,Y",
        type=_pair,
        nargs=4,
        help="the board's corners in the first picture [pixels], clockwise from least x, greatest y "
        "(default: detected)",
    )
    parser.add_argument(
        "--marble",
        metavar="X,Y",
        type=_pair,
        action="append",
        default=[],
        help="position of the marble in the first picture [pixels] (default: learned from motion)",
    )
    parser.add_argument(
        "--colour", metavar="R,G,B", type=_colour, help="the marble's colour, 0 to 255 (default: learned)"
    )
    parser.add_argument(
        "--fps", metavar="RATE", type=positive, help="pictures per second, if those of the file are wrong"
    )
    parser.add_argument("--seconds", metavar="S", type=positive, help="stop after this time")
    parser.add_argument(
        "--publish", action="store_true", help="publish each position on /marble/position, for ROS 2 nodes"
    )
    parser.add_argument(
        "--calibrate",
        action="store_true",
        help=f"calibrate the lens with a VIDEO of a chessboard or ChArUco board; write {_LENS} to DIR",
    )
    parser.add_argument(
        "--pattern",
        metavar="COLUMNSxROWS",
        type=_pattern,
        default=(9, 6),
        help="inner corners of the chessboard, or squares of the ChArUco board (default: 9x6)",
    )
    parser.add_argument(
        "--markers",
        action="store_true",
        help=f"write {_SHEET}, four markers to print for the board's corners, to DIR (default: here)",
    )
    parser.add_argument("--charuco", action="store_true", help="the pattern is a ChArUco board (4x4_50)")
    parser.set_defaults(wrong_usage=parser.error)
    parser.epilog = (
        "examples:\n"
        "  irt track run-1.mp4 --commands knobs-1.csv --out my-rig     then: irt diagnose my-rig\n"
        "  irt track chessboard.mp4 --calibrate --out my-rig           calibrate the lens for later tracks\n"
        "  irt track --markers                                         markers to print for the tilt\n"
        "  irt track 0 --publish                                       a camera, live; Ctrl-C ends it"
    )


def run(args: argparse.Namespace) -> None:
    """Track the marble, write the recording and the report, and print the accuracy."""
    if args.markers:
        _markers(args)
    elif args.video is None:
        args.wrong_usage("the following arguments are required: VIDEO (or --markers)")
    elif args.calibrate:
        _calibrate(args)
    else:
        _track(args)


def _markers(args: argparse.Namespace) -> None:
    """Write the sheet of markers."""
    from irt.cli.inputs import results_folder
    from irt.tracking.marker_sheet import write_marker_sheet

    path = results_folder(args.out or Path(), (_SHEET,)) / _SHEET
    write_marker_sheet(path)
    print("print it at 100 %, check that the bar is 100 mm long, and follow the sheet")
    print(f"\nwrote {path}")


def _calibrate(args: argparse.Namespace) -> None:
    """Calibrate the lens from pictures of a pattern, and write it."""
    from irt.cli.inputs import results_folder
    from irt.cli.progress import progress_bar
    from irt.tracking.calibration import Pattern, calibrate, save_lens
    from irt.tracking.source import open_source

    source = open_source(args.video, args.fps)
    try:
        folder = results_folder(args.out or Path(f"irt-track-{source.name}"), (_LENS,))
        with progress_bar() as progress:
            progress(0, 1, "reading pictures")
            pictures = source.sample(120)
            columns, rows = args.pattern
            lens, count = calibrate(pictures, Pattern(columns, rows, args.charuco), progress)
    finally:
        source.close()
    save_lens(folder / _LENS, lens, count)
    print(
        f"{lens.size[0]} x {lens.size[1]} pixels, focal length {lens.matrix[0, 0]:.1f}; {count} of ", end=""
    )
    print(f"{len(pictures)} pictures show the pattern; reprojection error {lens.error_px:.2f} pixels")
    print(f"\nwrote {folder / _LENS}")


def _track(args: argparse.Namespace) -> None:
    """Track the marble; positions found before an error are kept."""
    from irt.cli.inputs import print_replaced
    from irt.cli.progress import progress_bar
    from irt.report.tracked import track

    name = Path(args.video).stem
    print_replaced([(args.out or Path(f"irt-track-{name}")) / f"{name}.csv"])
    with progress_bar() as progress:
        found = track(
            args.video,
            out=args.out,
            commands=args.commands,
            offset=args.offset,
            rig=args.rig,
            lens=args.lens,
            corners=args.corners,
            marble=args.marble,
            colour=args.colour,
            fps=args.fps,
            seconds=args.seconds,
            publish=args.publish,
            progress=progress,
        )
    for line in _answer(found.summary, found.timed, found.board):
        print(line)
    for finding in found.findings:
        print(
            f"warning: {finding}; if the picture is upside down, start --corners at the opposite corner; "
            "if it is mirrored, mirror the video"
        )
    if found.timed is None:
        print("no commands are known: add them with --commands CSV to make a recording for irt diagnose")
    print(f"\nwrote {found.path}, {found.page} and its pictures")
    if found.track.stopped:
        raise IrtError(f"{found.track.stopped}: the positions of {len(found.track.stamps)} pictures are kept")


def _answer(summary: Summary, timed: Timed | None, board: Board) -> list[str]:
    """Return the lines of the printed summary."""
    from irt.report.words import counted
    from irt.tracking.doubts import doubts

    mm = 1000.0 * board.edge_x_m
    lines = [
        f"the marble is seen in {summary.seen:,} of {counted(summary.shown, 'picture')} "
        f"({100 * summary.detection:.2f} %); noise {summary.noise * summary.pixels_per_edge:.2f} pixels, "
        f"{summary.noise * mm:.2f} mm"
    ]
    gaps = summary.gaps
    if gaps.dropped or gaps.repeated:
        lines.append(f"{counted(gaps.dropped, 'picture')} missing, {gaps.repeated:,} repeated")
    if gaps.uneven > _UNEVEN:
        lines.append(
            f"the frame rate varies: {100 * gaps.uneven:.0f} % of the intervals are not "
            f"{1000 * gaps.interval:.1f} ms, the longest is {1000 * gaps.longest:.1f} ms; times are from "
            f"{summary.stamps}"
        )
    if timed is not None and timed.alignment is not None:
        found = timed.alignment
        lines.append(
            f"offset of the commands' clock to the video's {found.offset:.4f} +- {found.error:.4f} s "
            "(includes the rig's own delay)"
        )
    lines += [f"height of the marble {summary.height}", f"tilt of the board {summary.tilt}"]
    parts = ", ".join(f"{name} {value:.2f}" for name, value in summary.budget.parts.items())
    unknown = f"; unknown: {', '.join(summary.budget.unknown)}" if summary.budget.unknown else ""
    lines.append(f"standard error on the board {summary.budget.total:.2f} mm: {parts}{unknown}")
    lines += [f"warning: {one}" for one in doubts(summary)]
    if summary.moving:
        lines.append('the marble moves in the first picture: set [recordings] start = "moving" in rig.toml')
    return lines


#: Largest share of uneven intervals of a constant frame rate; cameras drop a picture now and then.
_UNEVEN = 0.05


def _numbers(text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(one) for one in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(abs(one) < 1e6 for one in numbers):
        raise argparse.ArgumentTypeError(f"expected {count} numbers separated by commas, found {text}")
    return numbers


def _pair(text: str) -> tuple[float, ...]:
    return _numbers(text, 2)


def _colour(text: str) -> tuple[float, ...]:
    """Return a colour as blue, green, red, the order of pictures."""
    numbers = _numbers(text, 3)
    if not all(0 <= one <= 255 for one in numbers):
        raise argparse.ArgumentTypeError(f"expected red, green, blue from 0 to 255, found {text}")
    return numbers[::-1]


def _pattern(text: str) -> tuple[int, int]:
    columns, _, rows = text.partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and min(int(columns), int(rows)) >= 3):
        raise argparse.ArgumentTypeError(f"expected COLUMNSxROWS, at least 3x3, found {text}")
    return int(columns), int(rows)
