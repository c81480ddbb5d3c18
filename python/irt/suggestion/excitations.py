"""Families of excitations within a rig's limits; each member is given by a vector of genes from 0 to 1."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irt.rig import Rig

Array = NDArray[np.float64]

#: Number of genes of an excitation.
GENES = 48
#: Genes for axes, size, start, and two parameters of the family; the rest are levels or phases.
_AXES, _SIZE, _START, _FIRST, _SECOND, _REST = range(6)
#: Starts closer together than this count as the same position [board edges].
_ONE_PLACE = 0.02
#: Smallest and largest amplitude of a drive, and of a creep, as a share of the largest knob angle.
_DRIVE, _CREEP = (0.12, 1.0), (0.02, 0.35)
#: Number of sines of a multisine on each axis.
_LINES = 5
#: Tolerance of limits for rounding.
_BELOW = 1.0 - 1e-9


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the commands, taken from the recordings of a rig.

    Attributes
    ----------
    amplitude : (2,) array
        Largest angle of each knob [rad].
    rate : (2,) array
        Largest change of each knob from row to row [rad].
    rows : int
        Length of a run.
    step_s : float or None
        Duration of a row [s]; None without stamps.
    starts : (k, 2) array
        Possible start positions [board edges].
    unit : str
        Unit of the commands.
    """

    amplitude: Array
    rate: Array
    rows: int
    step_s: float | None
    starts: Array
    unit: str = "rad"

    @classmethod
    def of(cls, rig: Rig, step_s: float | None) -> Limits:
        """Return the limits of a rig's recordings with rows of duration `step_s` [s], if known."""
        knobs = [recording.knobs for recording in rig.recordings]
        # At rest the knobs are level before row 0, so the first command is a change too.
        before = [np.zeros((1, 2)) if rig.start == "rest" else one[:1] for one in knobs]
        changes = [np.diff(one, axis=0, prepend=zero) for one, zero in zip(knobs, before, strict=True)]
        return cls(
            amplitude=np.max([np.abs(one).max(axis=0) for one in knobs], axis=0),
            rate=np.max([np.abs(one).max(axis=0) for one in changes], axis=0),
            rows=max(2, int(np.median([len(one) for one in knobs]))),
            step_s=step_s,
            starts=_starts(rig),
            unit=rig.commands.unit,
        )

    def lasting(self, rows: float) -> str:
        """Return the duration of a number of rows as text, in seconds or, without stamps, in rows."""
        return f"{rows:.0f} rows" if self.step_s is None else f"{rows * self.step_s:.2g} s"

    def kept(self, wanted: Array) -> Array:
        """Return the nearest commands (n, 2) to those wanted that start level and respect all limits."""
        commands = np.zeros_like(wanted)
        for axis in range(2):
            limit, rate = float(self.amplitude[axis]), float(self.rate[axis]) * _BELOW
            at = 0.0
            # Plain numbers, because each row depends on the one before and small arrays are slow.
            for row, aim in enumerate(wanted[1:, axis].tolist(), start=1):
                at = min(max(min(max(aim, -limit), limit), at - rate), at + rate)
                commands[row, axis] = at
        return commands


@dataclass(frozen=True, eq=False)
class Excitation:
    """A run to play.

    Attributes
    ----------
    family : str
        Name of its family.
    words : str
        Its description, to follow the word "play".
    commands : (n, 2) array
        Knob angles [rad].
    start : (2,) array
        Position of the resting marble at row 0 [board edges].
    genes : (g,) array
        Its genes; empty for a recorded run.
    """

    family: str
    words: str
    commands: Array
    start: Array
    genes: Array = field(default_factory=lambda: np.zeros(0))


def draw(family: str, genes: Array, limits: Limits) -> Excitation:
    """Return the member of a family with the given genes, (GENES,) numbers from 0 to 1."""
    axes = int(3 * genes[_AXES] * _BELOW)
    low, high = _CREEP if family == "creep" else _DRIVE
    size = low * (high / low) ** genes[_SIZE]
    shape, words = FAMILIES[family](genes, limits)
    # A gene of 1 selects the last of the choices.
    start = limits.starts[int(len(limits.starts) * genes[_START] * _BELOW)]
    used = np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])[axes]
    commands = limits.kept(shape * used * size * limits.amplitude)
    turned = np.abs(commands).max(axis=0)
    on = ("both knobs", "the x knob alone", "the y knob alone")[axes]
    # The unit of commands without one is 1.
    unit = "" if limits.unit == "1" else f" {limits.unit}"
    return Excitation(family, f"{words}, on {on}, by up to {turned.max():.3g}{unit}", commands, start, genes)


def as_recorded(rig: Rig, limits: Limits) -> list[Excitation]:
    """Return runs like those recorded: each recording and its mirror images, cut to equal length."""
    found = []
    for recording in rig.recordings:
        knobs = np.zeros((limits.rows, 2))
        played = recording.knobs[: limits.rows]
        knobs[: len(played)], knobs[len(played) :] = played, played[-1]
        if rig.start == "moving":
            # Played from rest, the first command would be a jump beyond the recorded rates.
            knobs = limits.kept(knobs)
        for signs in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)):
            # A turn about x drives along y, and the other way round.
            mirrored = recording.marble[0] * [signs[1], signs[0]]
            words = f"the commands of {recording.name} again" + (", mirrored" if min(signs) < 0.0 else "")
            found.append(Excitation("as recorded", words, knobs * signs, mirrored))
    return found


def _starts(rig: Rig) -> Array:
    """Return the start positions of the recordings and the centre, or the one common start, (k, 2)."""
    seen = np.array([recording.marble[0] for recording in rig.recordings])
    middle = np.median(seen, axis=0)
    if np.abs(seen - middle).max() > _ONE_PLACE:
        return np.concatenate([np.zeros((1, 2)), seen])
    return np.zeros((1, 2)) if np.abs(middle).max() < _ONE_PLACE else middle[None]


def _multisine(genes: Array, limits: Limits) -> tuple[Array, str]:
    lowest = (limits.rows / 24.0) ** genes[_FIRST]
    highest = max(1.5 * lowest, lowest * (limits.rows / 6.0 / lowest) ** genes[_SECOND])
    cycles = lowest * (highest / lowest) ** ((np.arange(2 * _LINES) + 0.5) / (2 * _LINES))
    phases = 2.0 * np.pi * genes[_REST : _REST + 2 * _LINES]
    weights = genes[_REST + 2 * _LINES : _REST + 4 * _LINES]
    time = np.arange(limits.rows)[:, None] / limits.rows
    sines = weights * np.sin(2.0 * np.pi * cycles * time + phases)
    # The frequencies of the two knobs interleave, so that cross-axis responses are distinct.
    shape = np.stack([sines[:, ::2].sum(axis=1), sines[:, 1::2].sum(axis=1)], axis=1)
    shortest, longest = limits.lasting(limits.rows / highest), limits.lasting(limits.rows / lowest)
    words = f"a sum of sines with periods from {shortest} to {longest}"
    return shape / np.maximum(np.abs(shape).max(axis=0), 1e-12), words


def _steps(genes: Array, limits: Limits) -> tuple[Array, str]:
    hold = _hold(genes[_FIRST], limits)
    levels = 2.0 * genes[_REST:] - 1.0
    if genes[_SECOND] < 0.5:
        levels = np.where(levels < 0.0, -1.0, 1.0)
    number = np.arange(limits.rows) // hold
    half = len(levels) // 2
    shape = np.stack([levels[number % half], levels[half + number % half]], axis=1)
    return shape, f"a step every {limits.lasting(hold)}"


def _chirp(genes: Array, limits: Limits) -> tuple[Array, str]:
    slow, fast = np.sort((limits.rows / 6.0) ** genes[[_FIRST, _SECOND]])
    first, last = (slow, fast) if genes[_REST] < 0.5 else (fast, slow)
    time = np.arange(limits.rows) / limits.rows
    angle = 2.0 * np.pi * (first * time + 0.5 * (last - first) * time**2)
    begins, ends = limits.lasting(limits.rows / first), limits.lasting(limits.rows / last)
    words = f"a sine whose period goes from {begins} to {ends}"
    turned = 2.0 * np.pi * genes[_REST + 1 : _REST + 3]
    return np.sin(angle[:, None] + turned), words


def _reversals(genes: Array, limits: Limits) -> tuple[Array, str]:
    hold = _hold(genes[_FIRST], limits)
    # Forth, back, back, forth, so that the marble comes to rest at its start.
    pattern = np.array([1.0, -1.0, -1.0, 1.0])
    number = np.arange(limits.rows) // hold
    later = int(4 * genes[_SECOND] * _BELOW)
    shape = np.stack([pattern[number % 4], pattern[(number + later) % 4]], axis=1)
    signs = np.where(genes[_REST : _REST + 2] < 0.5, 1.0, -1.0)
    return shape * signs, f"holds of {limits.lasting(hold)} with reversals"


def _mirrored(genes: Array, limits: Limits) -> tuple[Array, str]:
    shape, words = _steps(genes, limits) if genes[-1] < 0.5 else _multisine(genes, limits)
    half = limits.rows // 2
    pair = np.concatenate([shape[: limits.rows - half], -shape[:half]])
    return pair, f"{words}, and from the middle on the same mirrored"


def _creep(genes: Array, limits: Limits) -> tuple[Array, str]:
    cycles = 1.0 + 5.0 * genes[_FIRST]
    phase = cycles * np.arange(limits.rows)[:, None] / limits.rows + genes[_REST : _REST + 2] * genes[_SECOND]
    shape = 2.0 * np.abs(2.0 * ((phase + 0.25) % 1.0) - 1.0) - 1.0
    return -shape, f"slow small ramps to and fro every {limits.lasting(limits.rows / cycles)}"


def _coast(genes: Array, limits: Limits) -> tuple[Array, str]:
    push = _hold(genes[_FIRST], limits)
    rest = max(push, round(push * 8.0 ** genes[_SECOND]))
    number, within = np.divmod(np.arange(limits.rows), push + rest)
    levels = 2.0 * genes[_REST:] - 1.0
    half = len(levels) // 2
    # The second push of each pair cancels the displacement of the first.
    signs = np.where(number % 2 == 0, 1.0, -1.0)
    shape = np.stack([levels[number // 2 % half], levels[half + number // 2 % half]], axis=1)
    shape = shape * (signs * (within < push))[:, None]
    largest = np.maximum(np.abs(shape).max(axis=0), 1e-12)
    words = f"pushes of {limits.lasting(push)}, each followed by {limits.lasting(rest)} level"
    return shape / largest, words


def _hold(gene: float, limits: Limits) -> int:
    """Return a number of rows from 2 to a quarter of the run."""
    return max(2, round(2.0 * float((limits.rows / 8.0) ** gene)))


#: Function of each family from genes and limits to a shape (n, 2) within -1 and 1, and a description.
FAMILIES: dict[str, Callable[[Array, Limits], tuple[Array, str]]] = {
    "multisine": _multisine,
    "steps": _steps,
    "chirp": _chirp,
    "holds": _reversals,
    "mirrored": _mirrored,
    "creep": _creep,
    "coasting": _coast,
}
