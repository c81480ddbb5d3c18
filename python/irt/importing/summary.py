"""Summary of an import as lines of text."""

from __future__ import annotations

import numpy as np

from irt.importing.axes import Axes, gain_is_odd, gain_ratio, tilt_zero
from irt.importing.conventions import DECIDED, ROLLING_GAIN
from irt.importing.logs import Summary
from irt.importing.rates import Rates
from irt.recording import MARBLE

#: Explained share of the variance above which the tilt follows its command directly.
_WELL = 0.8
#: A dead time longer than this [s] is unusual for a servo.
_LONG_S = 0.25


def summary_lines(summary: Summary) -> list[str]:
    """Return the lines that `irt import` prints."""
    return [
        *_source(summary),
        "found from the data:",
        *_marble(summary),
        *_tilt(summary),
        *_commands(summary),
        *_clocks(summary),
        *_cleaned(summary),
        *_written(summary),
    ]


def _source(summary: Summary) -> list[str]:
    lines = []
    for log in summary.logs:
        seconds = log.stamps[-1] - log.stamps[0]
        lines.append(
            f"{log.path}: {summary.lab.name}, {len(log.stamps)} states in {seconds:.1f} s at "
            f"{1.0 / log.period:.1f} Hz, {len(log.commands)} commands"
        )
        lines += [f"  {note}" for note in log.notes]
    return lines


def _marble(summary: Summary) -> list[str]:
    names = summary.logs[0].marble_names
    if names == ("-", "-"):
        return ["  no marble: runs of tilt alone"]
    if summary.swapped:
        return [
            f'  marble: "{names[0]}" is our x and "{names[1]}" our y: exchanged, by the board\'s size; surely'
        ]
    return []


def _tilt(summary: Summary) -> list[str]:
    log = summary.logs[0]
    if log.tilt is None:
        return ["  no measured tilt"]
    if summary.tilt_map is None or not summary.tilt.decided:
        return [
            "  tilt: too little free motion of the marble to decide its axes; kept as declared; undecided"
        ]
    lines = []
    for axis, (name, moved) in enumerate((("tilt_x", "y"), ("tilt_y", "x"))):
        lines.append(f"  tilt {_sentence(summary.tilt, axis, log.tilt_names, moved, name)}")
    lines += _mirror(summary)
    ratio = gain_ratio(summary.tilt)
    lines.append(f"  a rolling ball's gain is 5/7 g = {ROLLING_GAIN:.2f}; found {ratio:.0%} of it")
    if gain_is_odd(ratio):
        lines.append("    unlike a rolling ball: are positions in long edges, tilts in radians, stamps in s?")
    if (summary.tilt.mixed > 0.1).any():
        angle = np.rad2deg(np.arctan(float(np.mean(summary.tilt.mixed))))
        lines.append(
            f"    each tilt moves both axes: the camera is rotated by about {angle:.0f} degrees; kept"
        )
    if not log.stamped and np.isfinite(ratio):
        lines.append(
            f"    without stamps: rows {summary.period * np.sqrt(ratio):.4f} s apart would make it 5/7 g"
        )
    return lines


def _sentence(axes: Axes, axis: int, names: tuple[str, str], moved: str, ours: str) -> str:
    column = names[axes.order[axis]]
    if axes.sure[axis] == "undecided":
        return f'"{column}": no effect found; assumed to be {ours}, sign kept; undecided'
    turned = "kept" if axes.signs[axis] > 0.0 else "turned"
    return (
        f'"{column}" moves {moved} by {axes.gains[axis]:+.2f} +- {axes.errors[axis]:.2f} m/s^2 per rad: '
        f"our {ours}, sign {turned}; {axes.sure[axis]}"
    )


def _mirror(summary: Summary) -> list[str]:
    if "undecided" in summary.tilt.sure:
        return []
    flips = np.prod(summary.tilt.signs) * (1.0 if summary.tilt.order == (0, 1) else -1.0)
    if flips > 0.0:
        return []
    return [
        "    mirrored against the declared axes; motion does not show whether tilt or marble is: the "
        "marble's axes are kept as the frame"
    ]


def _rates(summary: Summary, rates: Rates) -> list[str]:
    log, axes = summary.logs[0], summary.commands
    lines = []
    for axis, name in enumerate(("tilt_x", "tilt_y")):
        if axes.sure[axis] == "undecided":
            continue
        column = summary.tilt.order[axis]
        dead = f" beyond {rates.dead[column]:.2g}" if rates.dead[column] else ""
        lines.append(
            f'  command "{log.command_names[axes.order[axis]]}" turns {name} at {axes.gains[axis]:+.3g} +- '
            f"{axes.errors[axis]:.2g} rad/s per {_short_unit(summary)}{dead}, dead time "
            f"{rates.map.delay[column]:.3f} s, lag of the speed {rates.map.lag[column]:.3f} s; explains "
            f"{rates.map.explained[column]:.1%} of its changes"
        )
    if summary.matrix:
        lines.append("    each command turns the board about both axes")
    lines += [
        "    a rate and no angle (a motor's speed or current), whose errors add up: the measured tilt is",
        "    written as the command (knob_x_rad, knob_y_rad). Diagnosed are board, marble and camera",
    ]
    zeros, errors = (1e3 * values for values in tilt_zero(summary.tilt_map, summary.tilt))
    if np.isfinite(errors).any():
        texts = [
            f"{zero:+.1f} +- {error:.1f}" if np.isfinite(error) else "an unknown"
            for zero, error in zip(zeros, errors, strict=True)
        ]
        lines.append(f"    without its zero, by the marble {' and '.join(texts)} mrad about x and y")
    return lines


def _short_unit(summary: Summary) -> str:
    unit = "rad" if summary.logs[0].columns[0].endswith("_rad") else summary.lab.unit
    return unit if len(unit) < 12 else "unit"


def _commands(summary: Summary) -> list[str]:
    log, found, axes = summary.logs[0], summary.command_map, summary.commands
    if summary.rates is not None:
        return _rates(summary, summary.rates)
    if found is None:
        return ["  commands: none changes; kept as declared"]
    if not axes.decided:
        return ["  commands: no effect on tilt or marble found; kept as declared; undecided"]
    lines = []
    for axis, name in enumerate(("tilt_x", "tilt_y")):
        column = log.command_names[axes.order[axis]]
        if axes.sure[axis] == "undecided":
            lines.append(f'  command "{column}" has no visible effect on {name}; kept; undecided')
            continue
        lines.append(
            f'  command "{column}" tilts {name} by {axes.gains[axis]:+.3g} +- {axes.errors[axis]:.2g} rad '
            f"per {_short_unit(summary)}: our {log.columns[axis]}; {axes.sure[axis]}"
            f"{_through_marble(summary)}"
        )
    if summary.matrix:
        lines.append("    each command moves both axes: [commands] matrix = true")
    return lines


def _through_marble(summary: Summary) -> str:
    return " (by the marble's acceleration)" if summary.by_marble else ""


def _clocks(summary: Summary) -> list[str]:
    lines = []
    found = summary.tilt_map
    if summary.tilt_offset is not None and found is not None:
        error = float(np.nanmin(found.delay_error))
        lines.append(
            f"  clock of the tilt: {summary.tilt_offset:+.4f} +- {error:.4f} s added, by the marble's "
            "acceleration"
        )
    elif found is not None and summary.tilt.decided:
        weights = 1.0 / np.where(np.isfinite(found.delay_error), found.delay_error, np.inf) ** 2
        late = float(np.sum(weights * np.nan_to_num(found.delay)) / max(weights.sum(), 1e-12))
        error = float(1.0 / np.sqrt(max(weights.sum(), 1e-12)))
        if abs(late) > 4.0 * error and abs(late) > 0.004:
            when = "early" if late > 0.0 else "late"
            lines.append(
                f"  the tilt is {when} by {1e3 * abs(late):.0f} +- {1e3 * error:.0f} ms against the marble "
                "(filters of the estimator); not corrected"
            )
    found = summary.command_map
    if found is None or not summary.commands.decided or summary.rates is not None:
        return lines
    decided = (np.abs(found.z) >= DECIDED).any(axis=1) & np.isfinite(found.delay)
    if not decided.any():
        return lines
    delay = found.delay[decided]
    pairs = zip(delay, found.delay_error[decided], strict=True)
    text = " and ".join(f"{one:+.4f} +- {one_error:.4f} s" for one, one_error in pairs)
    lags = " and ".join(f"{one:.3f} s" for one in found.lag[decided])
    lines.append(f"  command to {'marble' if summary.by_marble else 'tilt'}: dead time {text}, lag {lags}")
    lines.append(
        "    (dead time = the actuator's delay + any offset between the clocks of commands and states)"
    )
    if summary.command_shift:
        lines.append(
            "    commands are stamped after their effect: clocks differ by at least "
            f"{-summary.command_shift:.4f} s; corrected by this"
        )
    elif float(delay.max()) > _LONG_S:
        lines.append("    long for a servo: the clocks of commands and states may differ; not corrected")
    return lines


def _cleaned(summary: Summary) -> list[str]:
    counts = summary.counts
    parts = [
        (counts.lost, "lost"),
        (counts.held, "held at the last position of a lost marble"),
        (counts.jumps, "with a jump of the tilt (hidden marker)"),
        (counts.garbage, "invalid at the start"),
        (counts.before_commands, "before the first command"),
    ]
    shown = [f"{count} {text}" for count, text in parts if count]
    lines = [f"cleaned: of {counts.rows} rows {', '.join(shown)}" if shown else "cleaned: nothing to clean"]
    if counts.uncertain:
        lines.append(
            f"  {counts.uncertain} rows repeat a position exactly, as a marble at rest does without noise: "
            "kept; uncertain"
        )
    splits = [
        (counts.gaps, "gaps of the stamps"),
        (counts.episodes, "new episodes"),
        (counts.losses, "losses of over 1 s"),
    ]
    shown = [f"{count} {text}" for count, text in splits if count]
    if shown:
        lines.append(f"  split at {', '.join(shown)}")
    if summary.without_tilt:
        lines.append(f"  {summary.without_tilt} runs without a measured tilt left out: commands are rates")
    if counts.short_runs:
        lines.append(f"  {counts.short_runs} runs of under 30 rows or 1 s dropped ({counts.short_rows} rows)")
    return lines


def _written(summary: Summary) -> list[str]:
    runs = summary.recordings
    rows = sum(len(run.knobs) for run in runs)
    missing = sum(int((~run.seen).sum()) for run in runs)
    verb = "wrote" if summary.written else "would write"
    folder = runs[0].path.parent
    names = runs[0].path.name if len(runs) == 1 else f"{runs[0].path.name} ... {runs[-1].path.name}"
    lines = [
        f"{verb} {folder}: {len(runs)} recording{'s' if len(runs) > 1 else ''} ({names}), {rows} rows, the "
        f"{MARBLE[0][:6]} missing in {missing}"
    ]
    if summary.settings is None:
        lines.append("  rig.toml kept as it was")
    else:
        lines.append(f"  {verb} rig.toml: check the sizes of board and marble in it, which are assumed")
    if summary.motors is not None:
        lines.append(f"  {verb} twin.toml: these motors, for `rig twin --as cyberrunner --config twin.toml`")
    if not summary.written:
        lines.append("dry run: nothing was written")
    return lines
