"""Detection of wrong units: tilts of many degrees, positions off the board."""

from __future__ import annotations

import numpy as np

from irt.errors import IrtError
from irt.importing.log import Log
from irt.recording import TILT
from irt.rig import Board

#: Largest tilt of a labyrinth [rad] (23 degrees), and in degrees.
STEEPEST, _STEEPEST_DEGREES = 0.4, 25.0
#: Tolerance, as a factor, of a gain that is 57.3 times too small, which indicates degrees.
_DEGREES, _CONVINCING = 180.0 / np.pi, 2.0
#: Distance outside the board [board edges], and share of positions there, that noise does not explain.
_OUTSIDE, _OUTSIDE_SHARE = 0.05, 0.1


def check_tilt_size(log: Log) -> None:
    """Raise `IrtError` if the tilt is larger than a board's can be in radians."""
    if log.tilt is None or not np.isfinite(log.tilt).any():
        return
    centre = [np.median(one[np.isfinite(one)]) if np.isfinite(one).any() else np.nan for one in log.tilt.T]
    reach = float(np.nanquantile(np.abs(log.tilt - centre), 0.95))
    if reach <= STEEPEST:
        return
    why = f"the tilt reaches {reach:.3g}, which would be {np.rad2deg(reach):.0f} degrees"
    if reach <= _STEEPEST_DEGREES:
        raise _degrees(log, why)
    words = _conversion(log, "({})/1000")
    raise IrtError(f"{log.path}: {why}: not in radians; convert it, from milliradians with {words}")


def check_tilt_gain(log: Log, ratio: float) -> None:
    """Raise `IrtError` if the marble's acceleration indicates a tilt in degrees.

    Parameters
    ----------
    log : Log
        The log, for the message.
    ratio : float
        Detected gain, in units of 5/7 g per radian.
    """
    if 1.0 / _CONVINCING < ratio * _DEGREES < _CONVINCING:
        raise _degrees(log, f"the marble accelerates by {ratio:.3g} of 5/7 g for each unit of tilt")


def check_places(log: Log, board: Board) -> None:
    """Raise `IrtError` if the marble is often off the board, by another unit or another origin."""
    places = log.marble[np.isfinite(log.marble).all(axis=1)]
    if not len(places):
        return
    half = np.array([0.5, 0.5 * board.edge_y_m / board.edge_x_m]) + _OUTSIDE
    outside = float((np.abs(places) > half).any(axis=1).mean())
    if outside > _OUTSIDE_SHARE:
        low, high = np.quantile(places, [0.01, 0.99], axis=0)
        raise IrtError(
            f"{log.path}: {outside:.0%} of the positions lie outside the board of {board.edge_x_m} x "
            f"{board.edge_y_m} m: {log.marble_names[0]} runs from {low[0]:.3g} to {high[0]:.3g}, "
            f"{log.marble_names[1]} from {low[1]:.3g} to {high[1]:.3g}; positions are in long edges from the "
            "board's centre: divide by the edge, subtract 0.5 if the origin is a corner, or set the "
            "board's sizes in rig.toml"
        )


def marble_is_swapped(logs: list[Log], board: Board) -> bool:
    """Return whether the positions along y, and not those along x, exceed the short edge."""
    places = np.concatenate([log.marble for log in logs])
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return False
    reach = np.ptp(np.quantile(places, [0.002, 0.998], axis=0), axis=0)
    short = board.edge_y_m / board.edge_x_m
    return bool(short < reach[1] <= 1.0 + _OUTSIDE and reach[0] <= short)


def _degrees(log: Log, why: str) -> IrtError:
    words = _conversion(log, "rad({})")
    return IrtError(f"{log.path}: {why}: it seems to be in degrees; convert it with {words}")


def _conversion(log: Log, form: str) -> str:
    pairs = zip(TILT, log.tilt_names, strict=True)
    return " ".join(f'--map "{target}={form.format(text)}"' for target, text in pairs if text != "-")
