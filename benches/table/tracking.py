"""The results of `track.py`: the tracker beside other ways to find a ball."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np

from table.words import markdown, significant

Results = dict[str, Any]

#: Draws of runs for an interval.
DRAWS = 2000


def tracking_table(results: Results) -> str | None:
    """Return error, loss, false positions and speed of each way on each set."""
    scores = results.get("scores")
    if not scores:
        return None
    sets = list(dict.fromkeys(one["set"] for one in scores))
    names = list(dict.fromkeys(one["name"] for one in scores))
    columns = [
        "way",
        "set",
        "RMS error",
        "worst run",
        "found where visible",
        "false",
        "time",
        "whole board",
    ]
    rows = []
    for which in sets:
        for name in names:
            some = [one for one in scores if one["name"] == name and one["set"] == which]
            rows.append([name, which, *_row(some)])
    return f"{markdown(columns, rows)}\n\n{_note(results)}"


def _row(scores: Sequence[Results]) -> list[str]:
    low, high = _interval(scores)
    errors = [_error([one]) for one in scores if one["given"]]
    visible = _total(scores, "visible")
    found = 100 * _total(scores, "found") / visible if visible else float("nan")
    lost = sorted(100 * one["found"] / one["visible"] for one in scores if one["visible"])
    seconds = [one["seconds"] / one["pictures"] for one in scores]
    window = [time for one in scores for time in one["window"]]
    whole = [time for one in scores for time in one["whole"]]
    return [
        f"{_error(scores):.3f} px ({low:.3f} to {high:.3f})" if errors else "",
        f"{max(errors):.3f} px" if errors else "",
        f"{found:.2f} % (worst run {lost[0]:.1f})",
        f"{_total(scores, 'false'):,} of {_total(scores, 'pictures'):,}",
        f"{_milliseconds(window)}" if window else "",
        f"{_milliseconds(whole)}" if whole else _milliseconds(seconds),
    ]


def _total(scores: Sequence[Results], key: str) -> int:
    return int(sum(one[key] for one in scores))


def _error(scores: Sequence[Results]) -> float:
    """Return the root mean square error [pixels]."""
    given = sum(one["given"] for one in scores)
    return float((sum(one["squares"] for one in scores) / given) ** 0.5) if given else float("nan")


def _interval(scores: Sequence[Results]) -> tuple[float, float]:
    """Return the 95 % interval of that, by drawing runs anew."""
    random = np.random.default_rng(0)
    squares, given = (np.array([one[key] for one in scores], dtype=float) for key in ("squares", "given"))
    drawn = random.integers(0, len(scores), (DRAWS, len(scores)))
    errors = np.sqrt(squares[drawn].sum(axis=1) / np.maximum(given[drawn].sum(axis=1), 1.0))
    low, high = np.quantile(errors, [0.025, 0.975])
    return float(low), float(high)


def _milliseconds(seconds: Sequence[float]) -> str:
    return f"{significant(1e3 * statistics.median(seconds))} ms"


def _late(seconds: Sequence[float]) -> str:
    """Return the time that 99 % stay below."""
    return f"{significant(1e3 * float(np.quantile(seconds, 0.99)))} ms"


def _note(results: Results) -> str:
    ours = [one for one in results["scores"] if one["window"] or one["failed"]]
    times = [time for one in ours for time in (*one["window"], *one["lost"])]
    published = [time for one in ours for time in one["published"]]
    late = f" 99 % of its pictures take less than {_late(times)}" if times else ""
    if published:
        late += f", and {_late(published)} from the picture to its published point by the clock on the wall"
    failed = [f"{one['set']} {one['clip']}: {one['failed']}" for one in ours if one["failed"]]
    said = f" Refused: {'; '.join(failed)}." if failed else ""
    absent = "".join(f" {name} is left out: {why}." for name, why in results["absent"].items())
    busy = results["busy"]
    load = f"; {busy:.1f} of them busy with other work" if busy > 0.2 else ""
    return (
        "Errors are of the marble's middle, with their 95 % interval by drawing runs anew, without the false "
        "positions: those more than half a marble off, or given where all of it is hidden. Visible is a "
        "marble of which three quarters are seen. The others are given its colour and size, its first places "
        "and the board's box, and see the first pictures of each run; the tracker learns and finds these. "
        "Medians of the processor time of a picture of 640 x 480 on one core, in the tracker's window and "
        f"over the whole board.{late}.{said}{absent} Measured on {results['machine']}{load}."
    )
