"""The steps of a check: facts, findings, identifiability, advice on the next recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt import arguments
from irt.checking.advice import next_recording
from irt.checking.findings import SHORT_ROWS, run_findings
from irt.checking.identify import identify
from irt.checking.odd_runs import odd_runs
from irt.checking.positions import position_findings
from irt.checking.rates import rate_findings
from irt.checking.responses import Answer, response_findings, responses
from irt.checking.result import Check, Finding, RunFacts, SignalFacts, require, warning_lines
from irt.checking.runs import rim_masks, run_facts
from irt.checking.signals import clean, signal_facts
from irt.checking.units import unit_findings
from irt.files import PathLike
from irt.recording import MARBLE
from irt.rig import Rig, as_rig

Array = NDArray[np.float64]

#: Minimum number of tracked rows in all runs, for five parameters and start states.
LEAST_ROWS = 12
#: Extent, in standard deviations of the tracker, below which the marble never moved: noise alone reaches it.
_STILL = 8.0
_LONGER = "record runs of 5 s or more, at 10 to 60 rows a second"
_ORDER = ("error", "warning", "note")


@arguments.entry
def check(rig: Rig | PathLike, *, threads: int | None = None) -> Check:
    """Check the recordings of a rig before a fit.

    Parameters
    ----------
    rig : Rig or path
        A rig, or its folder.
    threads : int, optional
        Threads of the engine; by default one for each core.

    Returns
    -------
    Check
        Facts about runs, noise, axes and signs, findings, and identifiability.

    Raises
    ------
    IrtError
        If the folder is not a rig.
    """
    arguments.threads(threads)
    rig = as_rig(rig).on_bare_board()
    look = _Look.at(rig, threads)
    identified = None
    # With wrong axes or units the base model does not fit, and its sensitivities are meaningless.
    if look.is_sound:
        noise = {one.column: one.noise for one in look.signals}
        identified = identify(rig, noise, look.answers, threads=threads)
    return Check(
        rig=f"{rig.path}",
        runs=look.runs,
        signals=look.signals,
        responses=tuple(one.facts for one in look.answers.values()),
        identified=identified,
        findings=look.findings,
        next_recording=next_recording(rig, look.runs, look.findings, identified),
    )


def required(rig: Rig, *, threads: int | None = None) -> tuple[str, ...]:
    """Return the warnings of a check before a fit as lines, without identifiability.

    Raises
    ------
    IrtError
        If the recordings can identify nothing or are certainly wrong.
    """
    findings = _Look.at(rig, threads).findings
    require(f"{rig.path}", findings)
    return warning_lines(findings)


def axes_and_units(rig: Rig) -> tuple[Finding, ...]:
    """Return findings on axes, signs and units, errors first, which need no model."""
    return _ordered(_Look.at(rig, None).wrong)


@dataclass(frozen=True, eq=False)
class _Look:
    """Results of a check before identifiability; fields as in `Check`.

    Attributes
    ----------
    answers : dict
        Responses by name; empty if a finding prevents a fit.
    wrong : tuple of Finding
        Findings about axes, signs and units.
    is_sound : bool
        Whether axes and units are right and a fit is possible.
    """

    runs: tuple[RunFacts, ...]
    signals: tuple[SignalFacts, ...]
    answers: dict[str, Answer]
    findings: tuple[Finding, ...]
    wrong: tuple[Finding, ...]
    is_sound: bool

    @classmethod
    def at(cls, rig: Rig, threads: int | None) -> _Look:
        """Check the recordings of a rig."""
        cleaned = [clean(recording) for recording in rig.recordings]
        signals = signal_facts(rig, cleaned)
        noise = max((one.noise or 0.0 for one in signals if one.column in MARBLE), default=0.0)
        runs = run_facts(rig, cleaned, signals)
        findings = [*_fatal(rig, [marble for marble, _ in cleaned], noise), *run_findings(rig, runs)]
        answers: dict[str, Answer] = {}
        wrong: list[Finding] = []
        can_be_fitted = not any(one.severity == "error" for one in findings)
        if can_be_fitted:
            answers, wrong = _wrong(rig, cleaned, noise, threads)
        is_sound = can_be_fitted and not wrong
        return cls(runs, signals, answers, _ordered([*findings, *wrong]), tuple(wrong), is_sound)


def _ordered(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return findings, errors first."""
    return tuple(sorted(findings, key=lambda one: _ORDER.index(one.severity)))


def _wrong(
    rig: Rig, cleaned: Sequence[tuple[Array, Array | None]], noise: float, threads: int | None
) -> tuple[dict[str, Answer], list[Finding]]:
    """Return the responses between signals, and findings on their axes, signs and units."""
    marbles = [marble for marble, _ in cleaned]
    rim = rim_masks(rig, marbles, noise)
    answers = responses(rig, cleaned, rim)
    # Where all runs contradict physics, a single one says nothing more.
    axes = response_findings(rig, answers) or odd_runs(rig, cleaned, rim)
    found = [
        *axes,
        *unit_findings(rig, answers),
        *rate_findings(rig, cleaned, rim),
        *position_findings(rig, marbles, noise, threads),
    ]
    return answers, found


def _fatal(rig: Rig, marbles: Sequence[Array], noise: float) -> Iterator[Finding]:
    """Yield the error that prevents any identification, if there is one."""
    commands = [one.knobs for one in rig.recordings]
    moved = (
        any(np.ptp(one, axis=0).any() for one in commands) or len({one[0].tobytes() for one in commands}) > 1
    )
    if not moved:
        yield Finding("error", "no command ever changes", "commands", "record runs in which the knobs move")
        return
    tilt_moves = any(
        np.nanmax(np.ptp(one.tilt, axis=0)) > 0.0
        for one in rig.recordings
        if one.tilt is not None and not one.has_marble
    )
    seen = sum(int(np.isfinite(one[:, 0]).sum()) for one in marbles)
    if tilt_moves:
        return
    if not any(np.isfinite(one[1:]).any() for one in marbles):
        yield Finding(
            "error",
            "no run says where the marble is after row 0; these look like commands to be played",
            "marble",
            "play each file, and write where the camera sees the marble into marble_x and marble_y",
        )
        return
    if seen < LEAST_ROWS:
        yield Finding(
            "error",
            f"the marble is seen in {seen} rows of all runs together, at least {LEAST_ROWS} are needed",
            "marble",
            _LONGER,
        )
        return
    if max(int(np.isfinite(one[:, 0]).sum()) for one in marbles) < SHORT_ROWS:
        yield Finding(
            "error",
            f"no run has {SHORT_ROWS} rows with the marble; fewer determine little but a start state",
            "marble",
            _LONGER,
        )
        return
    # A few outliers are no motion.
    ends = [np.nanquantile(one, [0.01, 0.99], axis=0) for one in marbles if np.isfinite(one).any()]
    extent = max(float((high - low).max()) for low, high in ends)
    if extent <= _STILL * noise or extent == 0.0:
        yield Finding(
            "error",
            f"the marble never moves: it stays within {extent:.2g} edges, and the noise is {noise:.2g}",
            "marble",
            "tilt the board more, and check that the tracker follows the marble",
        )
