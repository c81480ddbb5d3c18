"""Tuning: one front for every method, and iterative residual tuning with all that belongs to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from irt.errors import unknown_name
from irt.rig import Rig, load_rig

if TYPE_CHECKING:
    from irt.files import PathLike
    from irt.fitting.fit import FitResult

#: In the order in which help lists them; the first is the default.
METHODS = ("irt", "least-squares")


def tune(rig: Rig | PathLike, method: str = "irt", **options: Any) -> FitResult:
    """Fit the five parameters to the recordings of a rig.

    Parameters
    ----------
    rig : Rig or path
        A rig, or its folder.
    method : {"irt", "least-squares"}
        How.
    **options
        Of the method, see `irt.tuning.residual_tuning.irt` and `irt.fitting.least_squares.least_squares`. All
        take ``starts``, ``seed``, ``engine``, ``threads`` and ``progress``.

    Returns
    -------
    FitResult
        The tuned model, with intervals, and how it was found.

    Raises
    ------
    IrtError
        If the method is unknown, the rig or an option is not as it must be, or a file cannot be written.
    """
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    if method == "irt":
        from irt.tuning.residual_tuning import irt  # noqa: PLC0415  # torch loads only where it is used

        return irt(rig, **options)
    if method == "least-squares":
        from irt.fitting.least_squares import least_squares  # noqa: PLC0415  # as does scipy

        return least_squares(rig, **options)
    raise unknown_name("method", method, METHODS)
