"""Check for commands that set the rate of the tilt: a motor's speed or current, which no angle follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from irt.checking.responses import CERTAIN, SURE, delays_to_try, likelier_by, marble_signals
from irt.checking.result import Finding
from irt.checking.runs import row_step
from irt.conventions import Signals, fit_level, resampled
from irt.rig import Rig

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Duration over which tilt and acceleration change [s], and without stamps [rows]: a few time constants of a
#: motor, and far less than a drift takes.
_WINDOW_S, _WINDOW_ROWS = 0.4, 12
#: Lags of actuators that follow angles [s], and without stamps [rows]; the catalogue's longest is 1 s.
_LAGS_S, _LAGS_ROWS = (0.1, 0.3, 1.0), (3, 9, 30)
#: Duration over which the marble's acceleration is taken [s], and without stamps [rows]: less than these.
_SMOOTH_S, _SMOOTH_ROWS = 0.3, 9
#: Order of the polynomial whose second derivative it is, and its least number of rows.
_ORDER, _LEAST = 3, 5


def rate_findings(
    rig: Rig, cleaned: Sequence[tuple[Array, Array | None]], rim: Sequence[Mask]
) -> list[Finding]:
    """Return a finding if the commands' integral certainly explains what they themselves do not.

    That is how the measured tilt changes, or without one the marble's acceleration, which follows the tilt.
    Integrals, and commands after several lags, are fitted to the same changes, each after any delay. The
    integral has to explain more than half of them, and to be a million times likelier than the others.

    Parameters
    ----------
    rig : Rig
        The recordings.
    cleaned : sequence of (array, array or None)
        Positions and tilt of each, without what is no measurement.
    rim : sequence of (n, 2) array
        Whether the marble touches the rim.
    """
    step = row_step(rig)
    rows = _WINDOW_ROWS if step is None else max(1, round(_WINDOW_S / step))
    is_measured = any(run.has_tilt for run in rig.recordings)
    signals = _tilts(rig, cleaned, step) if is_measured else _accelerations(rig, cleaned, rim, step)
    lags = [0.0, *(_LAGS_ROWS if step is None else np.array(_LAGS_S) / step)]
    laws: list[list[Signals]] = [[] for _ in range(1 + len(lags))]
    for knobs, seen in signals:
        if len(knobs) > rows:
            change = seen[rows:] - seen[:-rows]
            inputs = [np.cumsum(knobs, axis=0), *(_lagged(knobs, float(lag)) for lag in lags)]
            for signal, runs in zip(inputs, laws, strict=True):
                runs.append(Signals(signal[rows:] - signal[:-rows], change))
    if not laws[0]:
        return []
    fits = [fit_level(runs, delays_to_try(step)) for runs in laws]
    known = [one for one in fits if one is not None]
    if len(known) < len(fits):
        return []
    shares = [float(one.shares.max()) for one in known]
    explained = (shares[0], max(shares[1:]))
    if explained[0] < SURE or likelier_by(*explained, known[0].blocks) < CERTAIN:
        return []
    names = " and ".join(rig.recordings[0].columns)
    what = "the measured tilt" if is_measured else "the marble's acceleration"
    return [
        Finding(
            "error",
            f"the integrals of {names} explain {100 * explained[0]:.0f} % of how {what} changes, an angle "
            f"that follows them {100 * max(explained[1], 0.0):.0f} %: they set the tilt's rate, as a motor's "
            "speed or current does",
            "commands",
            "`irt import` the log: it writes the measured tilt as the command"
            if is_measured
            else "record the board's tilt as well, or command angles",
        )
    ]


def _lagged(knobs: Array, lag: float) -> Array:
    """Return commands (n, 2) after a first-order lag [rows]."""
    # As scipy.signal.lfilter, whose import takes half a second.
    if lag == 0.0:
        return knobs
    decay = float(np.exp(-1.0 / lag))
    bands = np.outer([1.0, -decay], np.ones(len(knobs)))
    return np.asarray(solve_banded((1, 0), bands, (1.0 - decay) * (knobs - knobs[0])) + knobs[0])


def _tilts(
    rig: Rig, cleaned: Sequence[tuple[Array, Array | None]], step: float | None
) -> Iterator[tuple[Array, Array]]:
    for run, (_, tilt) in zip(rig.recordings, cleaned, strict=True):
        if tilt is not None and run.has_tilt:
            times = None if step is None else run.stamps
            knobs, angles = resampled(times, run.knobs, tilt, held=(True, False))
            yield knobs, angles


def _accelerations(
    rig: Rig, cleaned: Sequence[tuple[Array, Array | None]], rim: Sequence[Mask], step: float | None
) -> Iterator[tuple[Array, Array]]:
    """Yield commands and accelerations [edges a row^2] by local polynomials; NaN at the rim and in gaps."""
    width = _SMOOTH_ROWS if step is None else max(_LEAST, round(_SMOOTH_S / step) // 2 * 2 + 1)
    powers = np.vander(np.arange(width) - width // 2, _ORDER + 1, increasing=True).astype(float)
    # Of the least squares polynomial (Savitzky and Golay), twice its quadratic coefficient.
    second = 2.0 * np.linalg.pinv(powers)[2]
    for run, one in zip(rig.recordings, marble_signals(rig, cleaned, rim), strict=True):
        if not run.has_marble or len(one.outputs) < width:
            continue
        found = np.full(one.outputs.shape, np.nan)
        for axis in (0, 1):
            places = one.outputs[:, axis]
            usable = np.isfinite(places) if one.used is None else np.isfinite(places) & one.used[:, axis]
            # A polynomial is of rows all of which are usable.
            whole = np.convolve(usable, np.ones(width), mode="same") > width - 0.5
            smooth = np.convolve(np.nan_to_num(places), second[::-1], mode="same")
            found[whole, axis] = smooth[whole]
        yield one.inputs, found
