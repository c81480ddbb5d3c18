"""What a check returns: facts about runs and signals, findings, and what the recordings identify."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from irt import display
from irt.errors import IrtError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that a user should know before a fit.

    Attributes
    ----------
    severity : {"error", "warning", "note"}
        An error leaves nothing to fit, or certainly makes a fit wrong; a warning probably makes it wrong or
        much worse; a note explains a limit.
    what : str
        What was found, in one sentence without its full stop.
    where : str
        Run, column or signal.
    advice : str
        What to do, in the imperative.
    """

    severity: Severity
    what: str
    where: str
    advice: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}; {self.advice}"


def warning_lines(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the warnings among findings as lines."""
    return tuple(str(one) for one in findings if one.severity == "warning")


def require(rig: str, findings: Iterable[Finding]) -> None:
    """Raise `IrtError` for the first error among findings about a rig."""
    for one in findings:
        if one.severity == "error":
            raise IrtError(f"{rig}: {one.what}; {one.advice}")


@dataclass(frozen=True)
class RunFacts:
    """What one recording holds. Pairs are for x and y; shares are of its rows, from 0 to 1.

    Attributes
    ----------
    name : str
        Of the recording.
    rows : int
        Rows.
    seconds, rate_hz, jitter_s : float or None
        Length, median rate, and standard deviation of the time between rows without the pauses; None
        without stamps.
    pauses : int
        Steps between stamps that are longer than 1.5 times the median: rows are missing there.
    lost : float
        Share of rows without the marble.
    longest_gap : int
        Longest stretch of such rows [rows].
    held : float
        Share of rows that hold the last place of a lost marble.
    tilt_jumps : int
        Rows in which a tilt is wrong because a marker was hidden, of both axes.
    garbage : int
        Rows at the start that were logged before the tracker worked.
    at_rest, at_rim : float
        Share of the rows that saw the marble in which it rests, and touches the rim.
    command_range : ((float, float), (float, float))
        Least and greatest command of each axis, in the rig's unit.
    clipped : (float, float)
        Share of rows in which the command stays at the extreme value of the rig.
    idle : tuple of str
        Columns that are exactly constant.
    repeats : str or None
        An earlier run with the same commands.
    """

    name: str
    rows: int
    seconds: float | None
    rate_hz: float | None
    jitter_s: float | None
    pauses: int
    lost: float
    longest_gap: int
    held: float
    tilt_jumps: int
    garbage: int
    at_rest: float
    at_rim: float
    command_range: tuple[tuple[float, float], tuple[float, float]]
    clipped: tuple[float, float]
    idle: tuple[str, ...]
    repeats: str | None


@dataclass(frozen=True)
class SignalFacts:
    """Noise and resolution of one measured column, over all runs.

    Attributes
    ----------
    column : str
        Its name.
    unit : str
        Of noise and resolution.
    noise : float or None
        Standard deviation of white noise; None of an axis that never moves.
    resolution : float or None
        Step to which values are rounded; None where there is no common step.
    """

    column: str
    unit: str
    noise: float | None
    resolution: float | None


@dataclass(frozen=True)
class ResponseFacts:
    """How one pair of signals drives another, by regression. Rows are outputs, columns inputs.

    Attributes
    ----------
    inputs, outputs : (str, str)
        Columns.
    unit : str
        Of the gains.
    gain, error : 2 x 2
        Gains and standard errors; None where an axis does not move.
    delay : (float or None, float or None)
        Of each output, in `delay_unit`.
    delay_unit : str
        "s", or "rows" without stamps.
    explained : float
        Share of the variance that the declared axes and signs explain.
    best : str
        The correction under which most is explained; empty where the declared axes and signs are best.
    best_explained : float
        Share of the variance that it explains.
    contradicts : bool
        Whether another convention than the declared one is significantly better.
    """

    inputs: tuple[str, str]
    outputs: tuple[str, str]
    unit: str
    gain: tuple[tuple[float | None, float | None], tuple[float | None, float | None]]
    error: tuple[tuple[float | None, float | None], tuple[float | None, float | None]]
    delay: tuple[float | None, float | None]
    delay_unit: str
    explained: float
    best: str
    best_explained: float
    contradicts: bool


@dataclass(frozen=True)
class Detectable:
    """From which size on an effect shows in these recordings.

    Attributes
    ----------
    effect, parameter, unit : str
        The effect, the parameter that is its size, and its unit, which without stamps has rows for seconds.
    smallest : float or None
        Smallest distance from the neutral value that changes the marble's path by `irt.check.SHOWS` standard
        errors, over what start states and the five parameters could change as well; None where no plausible
        size does.
    usual : float
        Half of the largest plausible distance.
    runs : float
        How many times these recordings it takes until the usual size shows; infinite where none suffices.
    """

    effect: str
    parameter: str
    unit: str
    smallest: float | None
    usual: float
    runs: float


@dataclass(frozen=True)
class Identified:
    """What the recordings could identify if the noise were all that is left.

    Attributes
    ----------
    intervals : dict
        Half width of the 95 % interval of each of the five parameters [its own unit]; None where it is not
        identified.
    values : dict
        Where that was linearised: a quick fit.
    unidentifiable : tuple of str
        Sentences on parameters and combinations that cannot be identified.
    effects : tuple of Detectable
        One for each effect and size of the catalogue, but for effects that draw random numbers, and without
        stamps those whose size depends on how long a row lasts.
    """

    intervals: dict[str, float | None]
    values: dict[str, float]
    unidentifiable: tuple[str, ...]
    effects: tuple[Detectable, ...]


@dataclass(frozen=True)
class Check:
    """What is in a rig's recordings, and what they could identify.

    Attributes
    ----------
    rig : str
        The folder.
    runs : tuple of RunFacts
        One for each recording.
    signals : tuple of SignalFacts
        Measured columns.
    responses : tuple of ResponseFacts
        Commands to marble; where the tilt was measured also tilt to marble and commands to tilt.
    identified : Identified or None
        None where axes or signs are wrong, or nothing can be identified.
    findings : tuple of Finding
        Errors first, then warnings, then notes.
    next_recording : str
        The one thing to record next.
    """

    rig: str
    runs: tuple[RunFacts, ...]
    signals: tuple[SignalFacts, ...]
    responses: tuple[ResponseFacts, ...]
    identified: Identified | None
    findings: tuple[Finding, ...]
    next_recording: str

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings as lines, for the answers of other verbs."""
        return warning_lines(self.findings)

    def require(self) -> None:
        """Raise `IrtError` where the recordings can identify nothing, or are certainly wrong."""
        require(self.rig, self.findings)

    def plot(self) -> Figure:
        """Draw in which share of its rows each run has lost the marble, or sees it at rest or at the rim."""
        from irt import pictures  # noqa: PLC0415

        kinds = {"lost": "lost", "at rest": "at_rest", "at the rim": "at_rim"}
        groups = {label: [100.0 * getattr(run, name) for run in self.runs] for label, name in kinds.items()}
        return pictures.bars([run.name for run in self.runs], groups, "share of the rows  [%]")

    def _repr_html_(self) -> str:
        findings = [(one.severity, one.where, one.what, one.advice) for one in self.findings]
        runs = [
            (run.name, f"{run.rows}", "-" if run.rate_hz is None else f"{run.rate_hz:.3g}", f"{run.lost:.1%}")
            for run in self.runs
        ]
        return display.page(
            f"Check of {self.rig}",
            display.table(("", "where", "what", "what to do"), findings),
            display.table(("run", "rows", "rows a second", "marble lost"), runs),
            display.paragraph(self.next_recording),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON takes it; an infinite number of runs becomes None."""
        found = asdict(self)
        for one in (found["identified"] or {}).get("effects", ()):
            if one["runs"] == float("inf"):
                one["runs"] = None
        return found
