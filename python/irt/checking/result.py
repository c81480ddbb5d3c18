"""Result of a check: facts about runs and signals, findings, and identifiability."""

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
    """A finding that matters for a fit.

    Attributes
    ----------
    severity : {"error", "warning", "note"}
        An error prevents a fit or certainly makes it wrong; a warning probably makes it wrong or much worse;
        a note explains a limit.
    what : str
        The finding, one sentence without a full stop.
    where : str
        Run, column or signal.
    advice : str
        The remedy, in the imperative.
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
    """Facts about one recording. Pairs are for x and y; shares are of its rows, from 0 to 1.

    Attributes
    ----------
    name : str
        Name of the recording.
    rows : int
        Number of rows.
    seconds, rate_hz, jitter_s : float or None
        Duration, median rate, and standard deviation of the time between rows without pauses; None without
        stamps.
    pauses : int
        Number of steps between stamps longer than 1.5 times the median, where rows are missing.
    lost : float
        Share of rows without the marble.
    longest_gap : int
        Longest stretch of such rows [rows].
    held : float
        Share of rows with the held last position of a lost marble.
    tilt_jumps : int
        Number of rows with a wrong tilt of either axis because of a hidden marker.
    garbage : int
        Number of first rows that were logged before the tracker had found the marble.
    at_rest, at_rim : float
        Shares of the tracked rows in which the marble rests, and in which it touches the rim.
    command_range : ((float, float), (float, float))
        Smallest and largest command of each axis, in the rig's unit.
    clipped : (float, float)
        Share of rows in which the command stays at the rig's extreme value.
    idle : tuple of str
        Constant columns.
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
        Unit of noise and resolution.
    noise : float or None
        Standard deviation of white noise; None for a constant axis, and for too few rows.
    resolution : float or None
        Step of the rounding; None without a common step.
    moves : bool
        Whether the values differ within any run.
    """

    column: str
    unit: str
    noise: float | None
    resolution: float | None
    moves: bool


@dataclass(frozen=True)
class ResponseFacts:
    """Regression of one pair of signals on another. Rows are outputs, columns inputs.

    Attributes
    ----------
    inputs, outputs : (str, str)
        Columns.
    unit : str
        Unit of the gains.
    gain, error : 2 x 2
        Gains and standard errors; None for a constant axis.
    delay : (float or None, float or None)
        Delay of each output, in `delay_unit`.
    delay_unit : str
        "s", or "rows" without stamps.
    explained : float
        Share of the variance explained by the declared axes and signs.
    best : str
        The correction with the largest explained share; empty if the declared axes and signs are best.
    best_explained : float
        Its explained share of the variance.
    contradicts : bool
        Whether another convention is significantly better than the declared one.
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
    """Detectability of an effect in these recordings.

    Attributes
    ----------
    effect, parameter, unit : str
        The effect, the parameter that is its size, and its unit, which has rows for seconds without stamps.
    smallest : float or None
        Smallest distance from the neutral value from which on, up to the usual size, all change the marble's
        path by `irt.checking.identify.SHOWS` standard errors, beyond changes by start states and the five
        parameters; None if the usual size does not.
    usual : float
        Half of the largest plausible distance.
    runs : float
        Factor on the number of these recordings until the usual size is detectable; infinite if none
        suffices.
    """

    effect: str
    parameter: str
    unit: str
    smallest: float | None
    usual: float
    runs: float


@dataclass(frozen=True)
class Identified:
    """Identifiability if the residuals were only noise.

    Attributes
    ----------
    intervals : dict
        Half width of the 95 % interval of each of the five parameters [its own unit]; None if it is not
        identified.
    values : dict
        The fit at which the model was linearised.
    misses : float
        Its mean absolute error in free runs over that of noise alone.
    unidentifiable : tuple of str
        Sentences on parameters and combinations that cannot be identified.
    effects : tuple of Detectable
        One for each effect and size of the catalogue, except effects with random numbers and, without stamps,
        those whose size depends on the duration of a row.
    """

    intervals: dict[str, float | None]
    values: dict[str, float]
    misses: float
    unidentifiable: tuple[str, ...]
    effects: tuple[Detectable, ...]


@dataclass(frozen=True)
class Check:
    """Facts about a rig's recordings, findings, and identifiability.

    Attributes
    ----------
    rig : str
        The folder.
    runs : tuple of RunFacts
        One for each recording.
    signals : tuple of SignalFacts
        Measured columns.
    responses : tuple of ResponseFacts
        Commands to marble; with measured tilt also tilt to marble and commands to tilt.
    identified : Identified or None
        None if axes or signs are wrong, or nothing can be identified.
    findings : tuple of Finding
        Errors first, then warnings, then notes.
    next_recording : str
        Advice on the next recording.
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
        """The warnings as lines, for the output of other commands."""
        return warning_lines(self.findings)

    def require(self) -> None:
        """Raise `IrtError` if the recordings can identify nothing or are certainly wrong."""
        require(self.rig, self.findings)

    def plot(self) -> Figure:
        """Draw the shares of rows of each run with a lost marble, at rest and at the rim."""
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
        """Return the check as JSON content; an infinite number of runs becomes None."""
        found = asdict(self)
        for one in (found["identified"] or {}).get("effects", ()):
            if one["runs"] == float("inf"):
                one["runs"] = None
        return found
