"""The results of `track.py`: the tracker beside other ways to find a ball."""

from __future__ import annotations

import statistics
from typing import Any

from table.words import markdown, significant

Results = dict[str, Any]


def tracking_table(results: Results) -> str | None:
    """Return error, loss, false positions and speed of each way on each set."""
    scores = results.get("scores")
    if not scores:
        return None
    sets = list(dict.fromkeys(one["set"] for one in scores))
    names = list(dict.fromkeys(one["name"] for one in scores))
    columns = ["way", "set", "RMS error", "found where visible", "false", "processor time"]
    rows = []
    for name in names:
        for which in sets:
            some = [one for one in scores if one["name"] == name and one["set"] == which]
            if some:
                rows.append([name, which, *_row(some)])
    return f"{markdown(columns, rows)}\n\n{_note(results)}"


def _row(scores: list[Results]) -> list[str]:
    total = {
        key: sum(one[key] for one in scores) for key in ("squares", "given", "false", "visible", "found")
    }
    pictures = sum(one["pictures"] for one in scores)
    error = (total["squares"] / total["given"]) ** 0.5 if total["given"] else float("nan")
    found = 100 * total["found"] / total["visible"] if total["visible"] else float("nan")
    return [
        f"{error:.3f} px",
        f"{found:.2f} %",
        f"{total['false']:,} of {pictures:,}",
        _time(scores),
    ]


def _time(scores: list[Results]) -> str:
    window = [one for score in scores for one in score["window"]]
    full = [one for score in scores for one in score["full"]]
    if not window:
        seconds = [one["seconds"] / one["pictures"] for one in scores]
        return f"{significant(1e3 * statistics.median(seconds))} ms"
    told = f"{significant(1e3 * statistics.median(window))} ms"
    return f"{told}; {significant(1e3 * statistics.median(full))} ms where lost" if full else told


def _note(results: Results) -> str:
    ours = [one for one in results["scores"] if one["window"] or one["failed"]]
    times = sorted(one for score in ours for one in (*score["window"], *score["full"]))
    late = significant(1e3 * times[int(0.99 * (len(times) - 1))]) if times else "-"
    failed = [f"{one['set']} {one['clip']}: {one['failed']}" for one in ours if one["failed"]]
    said = f" Refused: {'; '.join(failed)}." if failed else ""
    absent = "".join(f" {name} is left out: {why}." for name, why in results["absent"].items())
    busy = results["busy"]
    load = f", {busy:.1f} of them busy" if busy > 0.2 else ""
    return (
        "Errors are of the marble's middle, without the false positions: those more than 2 pixels off, or "
        "given where all of the marble is hidden. Visible is a marble of which three quarters are seen. The "
        "others are told the marble's colour, size and first places; the tracker learns them. Processor time "
        "of one core a picture of 640 x 480, medians; 99 % of the tracker's pictures took less than "
        f"{late} ms.{said}{absent} Measured on {results['machine']}{load}."
    )
