"""Table of the failed cases, each with a short reason."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from irt.diagnosis.result import UNLISTED
from irt.proof.metrics import world_of
from irt.proof.score import RigScore
from irt.proof.wording import counted, header, row

#: Right answers that close less than this share of the gap are listed too.
OPEN = 0.85

#: Description of the hidden physics of a group of rigs.
GROUPS = {
    "single": "one effect",
    "pair": "two effects",
    "triple": "three effects",
    UNLISTED: "physics not in the catalogue",
    "none": "nothing",
    "outliers": "nothing, with outliers of the tracker",
}


def failures(scores: Sequence[RigScore]) -> Iterator[str]:
    """Yield the section about wrong answers and open gaps: by cause, then one by one."""
    wrong = [one for one in scores if not one.found or (one.closed is not None and one.closed < OPEN)]
    yield "\n## What failed\n"
    if not wrong:
        yield "Nothing: every answer was right, and no gap was left open."
        return
    yield (
        f"{len(wrong)} of {len(scores)} rigs: answers that were not right, and right answers that leave more "
        f"than {1.0 - OPEN:.0%} of the gap open. By cause:\n".replace("%", " %")
    )
    yield from header(["cause", "rigs"])
    causes = Counter("the diagnosis failed" if one.verdict == "failed" else _reason(one) for one in wrong)
    for cause, count in causes.most_common():
        yield row([cause, f"{count}"])
    yield "\nOne by one, the largest signal first:\n"
    yield from header(
        ["rig", "world", "hidden", "answer", "ties", "signal over noise", "gap closed", "noise", "reason"]
    )
    for one in sorted(wrong, key=lambda one: -(one.errors.signal if one.errors else math.inf)):
        hidden = " + ".join(one.kinds) or GROUPS[one.group]
        answer = " + ".join(one.named) or one.verdict
        ties = "; ".join(f"{name} or {', '.join(rest)}" for name, rest in one.ties.items())
        signal = f"{one.errors.signal:.1f}" if one.errors else ""
        closed = f"{one.closed:.2f}" if one.closed is not None else ""
        yield row([one.rig, world_of(one), hidden, answer, ties, signal, closed, one.noise, _reason(one)])


def unread_rigs(scores: Sequence[RigScore]) -> Iterator[str]:
    """Yield the sentence about rigs without a diagnosis because the tracker lost the marble."""
    names = _unread(scores)
    if names:
        yield (
            f"\nThe tracker lost the marble in {counted(len(names), 'rig')} ({', '.join(names)}). These rigs "
            "could not be diagnosed and count as failed: as missed where physics was hidden, and as a false "
            "alarm where none was."
        )


def short_unread(scores: Sequence[RigScore]) -> str:
    """Return a sentence with the number of such rigs; empty if there are none."""
    count = len(_unread(scores))
    if not count:
        return ""
    return f" The tracker lost the marble in {counted(count, 'rig')}, counted as failed."


def left_out_runs(scores: Sequence[RigScore]) -> Iterator[str]:
    """Yield the sentence about held-out runs that are left out of all errors."""
    runs = [f"{one.rig} {name}" for one in scores for name in one.left_out]
    if runs:
        many, are = counted(len(runs), "run"), "is" if len(runs) == 1 else "are"
        yield (
            f"\nThe tracker lost the marble in {many} held out, which {are} left out of all errors: "
            f"{', '.join(runs)}."
        )


def _unread(scores: Sequence[RigScore]) -> list[str]:
    return [one.rig for one in scores if one.unread]


def _reason(score: RigScore) -> str:
    """Return a short reason why a rig counts as failed."""
    hidden, named = set(score.kinds), set(score.named)
    faint = score.errors is not None and score.errors.signal < 1.0
    cases = (
        (score.verdict == "failed", score.reason.replace("|", "/")),
        (score.false_alarm, "false alarm"),
        (score.found, "right, but the gap stays open"),
        (score.verdict == "sufficient" and faint, "below the noise once refitted"),
        (score.verdict == "sufficient", "missed"),
        (score.group == UNLISTED, "named as effects of the catalogue"),
        (score.verdict == UNLISTED, "reported as unlisted physics"),
        (hidden < named, "one effect too many"),
        (bool(hidden & named), "only some of them"),
    )
    return next((words for holds, words in cases if holds), "another effect named")
