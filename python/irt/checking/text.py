"""A check as text for the terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from irt.checking.result import Check, Detectable, Identified, ResponseFacts, RunFacts, SignalFacts

#: Characters of a line.
_WIDTH = 100
#: Number of runs from which on an effect counts as not detectable with any.
_NEVER_RUNS = 1000
#: Widths of the columns of the table of runs.
_COLUMNS = (6, 6, 5, 7, 5, 4, 5, 5, 5, 7)
#: Error of a fit that is clearly more than noise, over that of noise: as if the variance doubled.
_CLEARLY = math.sqrt(2.0)
#: Number of runs with a line of their own; others are summed up in a last line.
_MOST_RUNS = 12


def page(found: Check) -> str:
    """Return a check as lines of at most 100 characters."""
    return "\n".join(_lines(found))


def _lines(found: Check) -> Iterator[str]:
    yield from _runs(found.runs)
    if found.signals:
        yield ""
        yield from _signals(found.signals)
    if found.responses:
        yield ""
        yield f"{'response':<26}{'gain (95 %)':>14}".ljust(62) + f"  {'delay, by axis':<16}  explained"
        for response in found.responses:
            yield from _response(response)
    if found.identified is not None:
        yield ""
        yield from _identified(found.identified, len(found.runs))
        if any(run.seconds is None for run in found.runs):
            yield from _bullet(
                "time scale unknown: without stamps (t_s) times are in rows; tilts and pushes are unknown"
            )
    for severity, title in (("error", "errors"), ("warning", "warnings"), ("note", "notes")):
        chosen = [one for one in found.findings if one.severity == severity]
        if chosen:
            yield f"\n{title}"
            for one in chosen:
                yield from _bullet(f"{one}.")
    yield "\nto record next"
    yield from _bullet(found.next_recording)


def _runs(runs: Sequence[RunFacts]) -> Iterator[str]:
    width = max(3, *(len(run.name) for run in runs))
    header = ("rows", "s", "Hz", "jitter", "lost", "gap", "held", "rest", "rim", "clipped")
    yield f"{'run':<{width}} {_columns(header)}  commands x, y"
    for run in runs[:_MOST_RUNS]:
        (x0, x1), (y0, y1) = run.command_range
        cells = (
            f"{run.rows}",
            "-" if run.seconds is None else f"{run.seconds:.1f}",
            "-" if run.rate_hz is None else f"{run.rate_hz:.1f}",
            "-" if run.jitter_s is None else f"{1000 * run.jitter_s:.1f} ms",
            _share(run.lost),
            f"{run.longest_gap}",
            _share(run.held),
            _share(run.at_rest),
            _share(run.at_rim),
            _share(max(run.clipped)),
        )
        yield f"{run.name:<{width}} {_columns(cells)}  {x0:.2g}..{x1:.2g}, {y0:.2g}..{y1:.2g}"
    if len(runs) > _MOST_RUNS:
        rest = runs[_MOST_RUNS:]
        yield f"and {len(rest)} more runs of {sum(run.rows for run in rest)} rows"


def _columns(cells: Sequence[str]) -> str:
    return " ".join(f"{cell:>{width}}" for cell, width in zip(cells, _COLUMNS, strict=True))


def _share(share: float) -> str:
    percent = 100.0 * share
    return "0 %" if percent == 0.0 else "<1 %" if percent < 1.0 else f"{percent:.0f} %"


def _signals(signals: Sequence[SignalFacts]) -> Iterator[str]:
    yield "signal        noise               resolution"
    for one in signals:
        scale, unit = (100.0, "% of an edge") if one.unit == "edge" else (1000.0, "mrad")
        unknown = "too few rows" if one.moves else "never moves"
        noise = unknown if one.noise is None else f"{scale * one.noise:.3g} {unit}"
        step = "-" if one.resolution is None else f"{scale * one.resolution:.2g} {unit}"
        yield f"{one.column:<12}  {noise:<18}  {step}"


def _response(one: ResponseFacts) -> Iterator[str]:
    gains = []
    for row, output in enumerate(one.outputs):
        # Only the strongest input of each output is shown.
        known = [(abs(gain), column) for column, gain in enumerate(one.gain[row]) if gain is not None]
        if not known:
            continue
        column = max(known)[1]
        gain, error = one.gain[row][column] or 0.0, one.error[row][column] or 0.0
        pair = f"{one.inputs[column]} -> {output}"
        gains.append(f"{pair:<24} {gain:8.3g} +- {1.96 * error:.2g}")
    delays = ", ".join("-" if delay is None else f"{delay:.2g}" for delay in one.delay)
    wrong = f", {100 * one.best_explained:.0f} % after: {one.best}" if one.contradicts else ""
    for index, line in enumerate(gains):
        tail = (
            f"  {delays} {one.delay_unit:<6} {100 * max(one.explained, 0.0):4.0f} %{wrong}"
            if index == 0
            else ""
        )
        yield (f"  {line} {one.unit}".ljust(62) + tail).rstrip()


def _identified(found: Identified, runs: int) -> Iterator[str]:
    yield "identifiable from these recordings if the residuals are only noise (95 % intervals)"
    if found.misses > _CLEARLY:
        yield from _bullet(
            f"values are of a fit that misses by {found.misses:.2g} times the noise: the intervals say what "
            "these runs could show; irt tune and irt diagnose find the values"
        )
    known = [
        f"{name} {found.values[name]:.3g} +- {half:.2g}"
        if half
        else f"{name} {found.values[name]:.3g} (stamps)"
        for name, half in found.intervals.items()
        if half is not None
    ]
    yield from _bullet(", ".join(known) or "none of the five parameters")
    for sentence in found.unidentifiable:
        yield from _bullet(sentence)
    kinds = [_kind(one, runs) for one in found.effects]
    for kind, text, word in (
        ("shown", "effects are detectable from these sizes", _size),
        (
            "later",
            f"detectable at half their largest size with this many runs like these ({runs} so far)",
            partial(_runs_needed, runs=runs),
        ),
        ("never", "not detectable with any number of runs like these", None),
    ):
        chosen = [one for one, its in zip(found.effects, kinds, strict=True) if its == kind]
        if chosen:
            others = {one.effect for one, its in zip(found.effects, kinds, strict=True) if its != kind}
            yield from _bullet(f"{text}: {_grouped(chosen, word, others)}")


def _kind(one: Detectable, runs: int) -> str:
    if one.smallest is not None:
        return "shown"
    return "later" if runs * one.runs < _NEVER_RUNS else "never"


def _grouped(effects: Sequence[Detectable], word: Callable[[Detectable], str] | None, split: set[str]) -> str:
    """Return the effects, with the parameters of one effect grouped; named if it is ``split`` over lines."""
    found: dict[str, list[Detectable]] = {}
    for one in effects:
        found.setdefault(one.effect, []).append(one)
    parts = []
    for name, of_one in found.items():
        part = name.replace("_", " ")
        if name in split:
            part += f" ({', '.join(one.parameter for one in of_one)})"
        if word is not None:
            part += f" {' / '.join(word(one) for one in of_one)}"
        if word is _size and of_one[0].unit:
            part += f" {of_one[0].unit}"
        parts.append(part)
    return ", ".join(parts)


def _size(one: Detectable) -> str:
    return f"{one.smallest:.1g}"


def _runs_needed(one: Detectable, runs: int) -> str:
    return f"{math.ceil(runs * one.runs)}"


def _bullet(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)
