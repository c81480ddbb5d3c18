"""From commands to where the plate's hinges should be: delays, clocks, drives and gears."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = Mapping[str, float]
Hidden = Mapping[str, Values]
#: A drive is asked for the knobs (n, 2) after a step of so many seconds, given what is wanted of it.
Drive = Callable[[Array, float], Array]

#: Physics steps in each of the 1/240 s that rows are counted in, and how long they are [s].
STEPS_PER_UPDATE = 8
STEP_S = 1.0 / 240.0 / STEPS_PER_UPDATE


@dataclass(frozen=True)
class Clock:
    """When commands are issued and pictures taken.

    Attributes
    ----------
    commands, pictures : (rows,) arrays
        Seconds after row 0.
    steps : int
        Physics steps until the last picture, and a little longer.
    """

    commands: Array
    pictures: Array
    steps: int

    @classmethod
    def of(cls, time_scale: float, rows: int, hidden: Hidden) -> Clock:
        """Return the clocks of a recording: two that drift apart, if that is hidden."""
        row_s = round(time_scale) * STEPS_PER_UPDATE * STEP_S
        part = (np.arange(rows - 1) + 0.5) / max(rows - 1, 1) - 0.5
        lasting = row_s * (1.0 + hidden.get("clock_drift", {}).get("drift", 0.0) * part)
        pictures = np.zeros(rows)
        pictures[1:] = np.cumsum(lasting)
        return cls(row_s * np.arange(float(rows)), pictures, int(np.ceil(pictures[-1] / STEP_S)) + 2)


def tilts(values: Array, knobs: Array, hidden: Hidden, seeds: NDArray[np.int64], clock: Clock) -> Array:
    """Return where the plate's hinges should be (n, steps, 2) [rad], the first before any command."""
    moments = STEP_S * (np.arange(float(clock.steps)) - 0.5)
    return Linkage(values, hidden).turn(arrived(knobs, clock.commands, moments, hidden, seeds))


class Linkage:
    """What turns the plate when commands have come: drives, gears, and how the plate stands by itself."""

    def __init__(self, values: Array, hidden: Hidden) -> None:
        self._gears, self._hidden = values[:2], hidden
        self._drives = [drive(hidden[name]) for name, drive in TURNS.items() if name in hidden]

    def turn(self, wanted: Array) -> Array:
        """Return where hinges should be in the next steps, by the knobs wanted, both (n, steps, 2) [rad]."""
        turned = np.zeros_like(wanted)
        for step in range(wanted.shape[1]):
            knob = wanted[:, step]
            for drive in self._drives:
                knob = drive(knob, STEP_S)
            turned[:, step] = knob
        tilt = turned * self._gears
        for name, lean in TILTS.items():
            if name in self._hidden:
                tilt = lean(self._hidden[name], tilt, turned)
        return np.asarray(tilt)


def arrived(knobs: Array, issued: Array, moments: Array, hidden: Hidden, seeds: NDArray[np.int64]) -> Array:
    """Return the commands that have come by each moment (n, moments, 2) [rad]; none at first.

    Commands (n, rows, 2) are issued at times (rows,) [s].
    """
    runs, rows = knobs.shape[:2]
    jitter = hidden.get("delay_jitter", {}).get("sd_s", 0.0)
    wanted = np.zeros((runs, len(moments), 2))
    for run in range(runs):
        late = jitter * np.random.default_rng(int(seeds[run])).normal(size=rows)
        for axis, delay in enumerate(_by_axis(hidden.get("delay", {}), "delay_s", "y_minus_x_s")):
            came = issued + np.maximum(late + max(delay, 0.0), 0.0)
            # A command that a later one has overtaken is dropped.
            soonest = np.minimum.accumulate(came[::-1])[::-1]
            last = np.searchsorted(soonest, moments, side="right") - 1
            wanted[run, :, axis] = np.where(last < 0, 0.0, knobs[run, np.maximum(last, 0), axis])
    return wanted


def _by_axis(values: Values, mean: str, difference: str) -> Array:
    """Return what a value is about x and about y."""
    return values.get(mean, 0.0) + np.array([-0.5, 0.5]) * values.get(difference, 0.0)


def _pair(values: Values, x: str, y: str) -> Array:
    return np.array([values[x], values[y]])


def _quantised(values: Values) -> Drive:
    return lambda knob, _: values["step_rad"] * np.round(knob / values["step_rad"])


def _slack(values: Values) -> Drive:
    width = np.maximum(_by_axis(values, "half_width_rad", "y_minus_x_rad"), 0.0)
    return lambda knob, _: knob - np.clip(knob, -width, width)


def _limited(values: Values) -> Drive:
    rate = np.maximum(_by_axis(values, "rate_rad_per_s", "y_minus_x_rad_per_s"), 0.0)
    at = np.zeros(2)

    def drive(knob: Array, seconds: float) -> Array:
        nonlocal at
        at = at + np.clip(knob - at, -rate * seconds, rate * seconds)
        return at

    return drive


def _lagging(values: Values) -> Drive:
    time = np.maximum(_by_axis(values, "time_constant_s", "y_minus_x_s"), 1e-9)
    at = np.zeros(2)

    def drive(knob: Array, seconds: float) -> Array:
        nonlocal at
        at = knob + np.exp(-seconds / time) * (at - knob)
        return at

    return drive


def _swinging(values: Values) -> Drive:
    time = np.maximum(_by_axis(values, "time_constant_s", "y_minus_x_s"), 1e-3)
    damping = values.get("damping_ratio", 1.0)
    at, rate = np.zeros(2), np.zeros(2)
    parts = 16

    def drive(knob: Array, seconds: float) -> Array:
        nonlocal at, rate
        for _ in range(parts):
            push = (knob - at - 2.0 * damping * time * rate) / time**2
            rate = rate + seconds / parts * push
            at = at + seconds / parts * rate
        return at

    return drive


def _with_play(values: Values) -> Drive:
    half = 0.5 * _pair(values, "width_x_rad", "width_y_rad")
    at = np.zeros(2)

    def drive(knob: Array, _: float) -> Array:
        nonlocal at
        at = np.clip(at, knob - half, knob + half)
        return at

    return drive


def _sprung(values: Values) -> Drive:
    """Bouc and Wen's hysteresis: the spring stretches with the turn and gives way at its width."""
    strength, width = values["strength"], values["width_rad"]
    jumps = values.get("jumps", 1.0) > 0.0
    held, before = np.zeros(2), np.zeros(2)

    def drive(knob: Array, _: float) -> Array:
        nonlocal held, before
        way = knob - before
        if jumps:
            gives = np.where(way * held > 0.0, np.minimum(np.abs(way) / width, 1.0), 0.0)
            held = held * (1.0 - gives) + way
        else:
            off = np.where(way * held < 0.0, np.clip(way, -np.abs(held), np.abs(held)), 0.0)
            end = np.copysign(width, way)
            held = end + (held + off - end) * np.exp(-np.abs(way - off) / width)
        before = knob
        return knob + strength * held

    return drive


def _bent(values: Values) -> Drive:
    cubic = _by_axis(values, "cubic_per_rad2", "y_minus_x_per_rad2")
    return lambda knob, _: knob + cubic * knob**3


def _lopsided(values: Values) -> Drive:
    part = _pair(values, "asymmetry_x", "asymmetry_y")
    return lambda knob, _: knob + part * np.abs(knob)


#: Drives, in the order in which commands pass them.
TURNS: dict[str, Callable[[Values], Drive]] = {
    "command_quantisation": _quantised,
    "dead_band": _slack,
    "slew_limit": _limited,
    "lag": _lagging,
    "second_order_lag": _swinging,
    "backlash": _with_play,
    "spring_hysteresis": _sprung,
    "gear_nonlinearity": _bent,
    "gear_asymmetry": _lopsided,
}


def _mixed(values: Values, tilt: Array, of: Array) -> Array:
    """Add to the tilt about each axis a part of an angle about the other."""
    return tilt + of[..., ::-1] * _pair(values, "x_from_y", "y_from_x")


#: What tilts a board besides its gears: of the tilt and of the knobs (..., 2) [rad].
TILTS: dict[str, Callable[[Values, Array, Array], Array]] = {
    "gear_matrix": _mixed,
    "cross_coupling": lambda values, tilt, _: _mixed(values, tilt, tilt),
    "tilt_bias": lambda values, tilt, _: tilt + _pair(values, "bias_x_rad", "bias_y_rad"),
    "lean": lambda values, tilt, _: tilt + _pair(values, "lean_x_rad", "lean_y_rad"),
}
