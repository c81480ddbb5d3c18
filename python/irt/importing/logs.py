"""Import of other labs' logs: read, clean, detect conventions, write recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import noise_of
from irt.errors import IrtError
from irt.files import PathLike, make_folder, read_toml, write_atomic
from irt.importing.axes import (
    Axes,
    command_axes,
    direct,
    gain_ratio,
    is_matrix,
    tilt_axes,
    tilt_zero,
)
from irt.importing.conventions import (
    DECIDED,
    MOST_OF_IT,
    commands_to_marble,
    commands_to_tilt,
    tilt_to_marble,
)
from irt.importing.labs import Lab
from irt.importing.log import Log
from irt.importing.mapping import parse_mapping
from irt.importing.rates import Rates, commands_to_rates
from irt.importing.settings import rig_toml, twin_toml
from irt.importing.sources import (
    Kind,
    Progress,
    Reading,
    lab_of,
    read_log,
)
from irt.importing.splitting import Cleaned, Counts, Stretch, clean
from irt.importing.units import check_places, check_tilt_gain, check_tilt_size, marble_is_swapped
from irt.importing.weak_form import Map, Run
from irt.measured_tilt import has_both_tilts, play_tilt
from irt.recording import CMD, KNOBS, Recording
from irt.rig import Board, Commands, Marble, read_dimensions, read_signals

Array = NDArray[np.float64]

#: Offset [s], and its number of standard errors, above which the tilt has another clock than the marble.
_OFFSET_S, _OFFSET_ERRORS = 0.004, 4.0


@dataclass(frozen=True, eq=False)
class Summary:
    """Result of an import.

    Attributes
    ----------
    lab : Lab
        The lab of the first source.
    logs : tuple of Log
        The cleaned logs.
    counts : Counts
        Numbers of removed rows.
    tilt_map, command_map : Map or None
        Acceleration of the marble by tilt; tilt by command, or without tilt the acceleration by command.
    tilt, commands : Axes
        Assignment of the logged columns.
    rates : Rates or None
        How fast the commands turn the board, if they are rates. Recordings then have the measured tilt as
        their command.
    by_marble : bool
        Whether `command_map` is of the marble's acceleration.
    swapped : bool
        Whether the marble's axes were swapped.
    matrix : bool
        Whether each command moves both axes.
    tilt_offset : float or None
        Shift of the tilt's stamps [s], if they have a separate clock.
    command_shift : float
        Shift of the commands [s], if they were stamped after their effects.
    noise : (2,) array
        Noise of the measured tilt about x and y [rad]; NaN without any.
    edge_x_m : float
        The board's long edge [m].
    period : float
        Median time from row to row [s].
    recordings : tuple of Recording
        The recordings in the package's convention.
    settings : str or None
        The text of rig.toml; None if the folder has one.
    without_tilt : int
        Number of runs that were left out because commands are rates and their tilt was not measured.
    motors : str or None
        The text of twin.toml; None unless the commands are currents that set rates.
    written : bool
        Whether files were written.
    """

    lab: Lab
    logs: tuple[Log, ...]
    counts: Counts
    tilt_map: Map | None
    command_map: Map | None
    tilt: Axes
    commands: Axes
    rates: Rates | None
    by_marble: bool
    swapped: bool
    matrix: bool
    tilt_offset: float | None
    command_shift: float
    noise: Array
    edge_x_m: float
    period: float
    recordings: tuple[Recording, ...]
    settings: str | None
    without_tilt: int
    motors: str | None
    written: bool


def import_logs(
    sources: Sequence[PathLike],
    folder: PathLike,
    kind: Kind,
    *,
    mapping: Sequence[str] = (),
    topics: Sequence[str] = (),
    episode: str | None = None,
    home_after: float | None = None,
    dry_run: bool = False,
    progress: Progress | None = None,
) -> Summary:
    """Read logs of one rig, detect their conventions from all of them together, and write recordings.

    Parameters
    ----------
    sources : sequence of path
        Logs of one rig.
    folder : path
        The rig's folder. Existing recordings are kept, and so is rig.toml, whose board is then used.
    kind : {"cyberrunner", "tag", "csv"}
        Format of the logs.
    mapping : sequence of str
        ``TARGET=EXPRESSION``, instead of the format's own.
    topics : sequence of str
        Topics to use if a bag has several.
    episode : str, optional
        A column that changes at the start of each run.
    home_after : float, optional
        Seconds without a command after which the driver returns to 0.
    dry_run : bool
        Whether nothing is written.
    progress : callable, optional
        Called with done, total and a text.

    Raises
    ------
    IrtError
        If a log cannot be read or has no usable runs; then nothing is written.
    """
    expressions = parse_mapping(mapping)
    lab = lab_of(Path(sources[0]), kind)
    target = Path(folder)
    board, marble = _dimensions(target, lab)
    unit = _unit(target)
    reading = Reading(expressions, tuple(topics), episode, board.edge_x_m)
    logs = [read_log(Path(source), kind, reading, progress) for source in sources]
    if swapped := marble_is_swapped(logs, board):
        logs = [replace(log, marble=log.marble[:, ::-1], marble_names=log.marble_names[::-1]) for log in logs]
    for log in logs:
        check_tilt_size(log)
        check_places(log, board)
    cleaned = [clean(log, home_after) for log in logs]
    if not any(one.runs for one in cleaned):
        raise IrtError(f"{sources[0]}: no run of at least 30 rows and 1 s between gaps; record longer runs")
    report = progress or (lambda done, total, text: None)
    found = _conventions(cleaned, board, marble, report)
    tilt = tilt_axes(found.tilt_map)
    check_tilt_gain(cleaned[0].log, gain_ratio(tilt))
    commands = command_axes(found.command_map, tilt, by_marble=found.by_marble)
    columns = KNOBS if found.rates else cleaned[0].log.columns
    for log in logs:
        _check_unit(target, unit, log, columns)
    matrix = is_matrix(commands)
    placed = _Placed(tilt, commands, found.tilt_offset or 0.0, found.command_shift)
    recordings = _recordings(cleaned, target, placed)
    noise = _noise(recordings)
    without_tilt = 0
    if found.rates:
        zero = tilt_zero(found.tilt_map, tilt)[0]
        played = [play_tilt(one, zero, np.ones(2)) for one in recordings if has_both_tilts(one)]
        without_tilt, recordings = len(recordings) - len(played), played
    period = float(np.median([one.log.period for one in cleaned]))
    settings = None
    if not (target / "rig.toml").exists():
        spoken = Commands("rad" if columns == KNOBS else lab.unit, matrix and not found.rates)
        settings = rig_toml(
            board,
            marble,
            spoken,
            direct() if found.rates else commands,
            np.full(2, np.nan) if found.rates else noise,
            period=period,
            stamped=cleaned[0].log.stamped,
        )
    motors = twin_toml(found.rates, tilt, commands, lab.current) if found.rates else None
    if not dry_run:
        make_folder(target)
        if settings is not None:
            write_atomic(target / "rig.toml", settings)
        if motors is not None:
            write_atomic(target / "twin.toml", motors)
        for one in recordings:
            write_atomic(one.path, one.to_csv())
    counts = Counts()
    for each in cleaned:
        counts.add(each.counts)
    return Summary(
        lab=lab,
        logs=tuple(one.log for one in cleaned),
        counts=counts,
        tilt_map=found.tilt_map,
        command_map=found.command_map,
        tilt=tilt,
        commands=commands,
        rates=found.rates,
        by_marble=found.by_marble,
        swapped=swapped,
        matrix=matrix,
        tilt_offset=found.tilt_offset,
        command_shift=found.command_shift,
        noise=noise,
        edge_x_m=board.edge_x_m,
        period=period,
        recordings=tuple(recordings),
        settings=settings,
        without_tilt=without_tilt,
        motors=motors,
        written=not dry_run,
    )


def _dimensions(folder: Path, lab: Lab) -> tuple[Board, Marble]:
    """Return the sizes from the folder's rig.toml, else those of the lab."""
    path = folder / "rig.toml"
    return read_dimensions(read_toml(path)) if path.exists() else (lab.board, lab.marble)


def _unit(folder: Path) -> str | None:
    """Return the unit of commands of the rig in a folder; None if the folder has no rig."""
    path = folder / "rig.toml"
    if path.exists():
        return read_signals(read_toml(path))[0].unit
    # Recordings without a rig.toml are of knob angles.
    return "rad" if folder.is_dir() and any(folder.glob("*.csv")) else None


def _runs(cleaned: Sequence[Cleaned], edge: float) -> list[Run]:
    return [
        Run(
            log.stamps[run.rows],
            log.marble[run.rows] * edge,
            None if log.tilt is None else log.tilt[run.rows],
            (log.stamps if log.tilt_stamps is None else log.tilt_stamps)[run.rows],
            run.commands,
        )
        for one in cleaned
        for run in one.runs
        for log in (run.log,)
    ]


def _check_unit(folder: Path, unit: str | None, log: Log, columns: tuple[str, str]) -> None:
    """Raise `IrtError` if the commands of the rig in a folder are of another kind than those of a log."""
    if unit is None or (unit == "rad") == (columns == KNOBS):
        return
    if columns != log.columns:
        raise IrtError(
            f"{folder}: commands of this rig are in {unit}, but those of {log.path} are rates, for which the "
            "measured tilt is written [rad]; import into another folder"
        )
    raise IrtError(
        f"{folder}: commands of this rig are in {unit}, but those of {log.path} go to "
        f"{' and '.join(columns)}; import into another folder, or map "
        f"{' and '.join(KNOBS if unit == 'rad' else CMD)}"
    )


@dataclass(frozen=True, eq=False)
class _Conventions:
    """What the data say: both maps, whether commands are rates, and both shifts of clocks [s]."""

    tilt_map: Map | None
    command_map: Map | None
    by_marble: bool
    rates: Rates | None
    tilt_offset: float | None
    command_shift: float


def _conventions(
    cleaned: Sequence[Cleaned], board: Board, marble: Marble, report: Callable[[int, int, str], None]
) -> _Conventions:
    runs = _runs(cleaned, board.edge_x_m)
    edges = (board.edge_x_m - 2.0 * marble.radius_m, board.edge_y_m - 2.0 * marble.radius_m)
    own_clock = cleaned[0].log.tilt_stamps is not None
    report(0, 3, "fitting tilt to marble")
    tilt_map = tilt_to_marble(runs, edges, search=own_clock)
    offset = None
    if own_clock:
        offset = 0.0
        if tilt_map is not None and (np.abs(tilt_map.z) >= DECIDED).any():
            offset = float(tilt_map.delay[0])
        runs = [replace(run, tilt_stamps=run.tilt_stamps + offset) for run in runs]
    report(1, 3, "fitting commands to tilt")
    if rates := commands_to_rates([run for run in runs if _shows_both_tilts(run)]):
        report(3, 3, "fitted")
        return _Conventions(tilt_map, rates.map, False, rates, offset, 0.0)
    command_map = commands_to_tilt(runs)
    by_marble = False
    if command_map is None or not (np.abs(command_map.z) >= DECIDED).any():
        report(2, 3, "fitting commands to marble")
        other = commands_to_marble(runs, edges)
        if other is not None and (command_map is None or (np.abs(other.z) >= DECIDED).any()):
            command_map, by_marble = other, True
    report(3, 3, "fitted")
    shift = _least_shift(command_map, by_marble=by_marble) if command_map is not None else 0.0
    return _Conventions(tilt_map, command_map, by_marble, None, offset, shift)


def _shows_both_tilts(run: Run) -> bool:
    return run.tilt is not None and bool(np.isfinite(run.tilt).any(axis=0).all())


def _least_shift(found: Map, *, by_marble: bool) -> float:
    """Return by how much commands have to be moved [s], because no board moves before its command."""
    sure = (np.abs(found.z) >= DECIDED).any(axis=1) & np.isfinite(found.delay)
    if not by_marble:
        # Commands of a controller follow the tilt. A map that explains little may well be of that.
        sure &= found.explained > MOST_OF_IT
    if not sure.any():
        return 0.0
    # The marble alone shows only their sum: an overestimated lag comes with an underestimated dead time.
    late = found.delay + found.lag if by_marble else found.delay
    least = float(late[sure].min())
    error = float(np.nanmax(found.delay_error[sure]))
    return least if least < -max(_OFFSET_S, _OFFSET_ERRORS * error) else 0.0


@dataclass(frozen=True)
class _Placed:
    """Detected axes and clocks, which convert a log into a recording."""

    tilt: Axes
    commands: Axes
    tilt_offset: float
    command_shift: float


def _recordings(cleaned: Sequence[Cleaned], folder: Path, placed: _Placed) -> list[Recording]:
    taken = {path.stem for path in folder.glob("*.csv")} if folder.is_dir() else set()
    recordings = []
    for one in cleaned:
        for number, run in enumerate(one.runs, start=1):
            name = one.log.name if len(one.runs) == 1 else f"{one.log.name}-{number}"
            unique, count = name, 2
            while unique in taken:
                unique, count = f"{name}-{count}", count + 1
            taken.add(unique)
            recordings.append(_recording(run, folder / f"{unique}.csv", placed))
    return recordings


def _recording(run: Stretch, path: Path, placed: _Placed) -> Recording:
    log = run.log
    stamps = log.stamps[run.rows]
    ends = np.append(stamps[1:], stamps[-1] + log.period)
    if run.commands.stamps.size:
        sent = run.commands.shifted(placed.command_shift) if placed.command_shift else run.commands
        means = sent.mean(stamps, ends)
        # Rows before a shifted first command have its value.
        means = np.where(np.isfinite(means), means, sent.values[0])
    else:
        means = np.zeros((len(stamps), 2))
    measured = None
    if log.tilt is not None:
        measured = log.tilt[run.rows]
        if log.tilt_stamps is not None:
            at = log.tilt_stamps + placed.tilt_offset
            columns = [np.interp(stamps, at, column, left=np.nan, right=np.nan) for column in log.tilt.T]
            measured = np.column_stack(columns)
        measured = placed.tilt.apply(measured)
        if not np.isfinite(measured).any():
            measured = None
    return Recording(
        path.stem,
        path,
        placed.commands.apply(means),
        log.marble[run.rows],
        # Row numbers at a nominal rate are no stamps; the time scale is then a free parameter.
        stamps - stamps[0] if log.stamped else None,
        measured,
        log.columns,
    )


def _noise(recordings: Sequence[Recording]) -> Array:
    tilts = [one.tilt for one in recordings if one.tilt is not None]
    if not tilts:
        return np.full(2, np.nan)
    noises = np.array([[noise_of(tilt[:, axis]) for axis in (0, 1)] for tilt in tilts])
    known = np.isfinite(noises).any(axis=0)
    return np.array([np.nanmedian(noises[:, axis]) if known[axis] else np.nan for axis in (0, 1)])
