"""Tuning: one front for every method, and iterative residual tuning with all that belongs to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from irt.errors import unknown_name
from irt.rig import Rig, load_rig

if TYPE_CHECKING:
    from irt.files import PathLike
    from irt.fitting.fit import FitResult

#: In the order in which help lists them; the first is the default.
METHODS = ("least-squares", "irt+", "irt", "cma-es", "es", "direct")


def tune(rig: Rig | PathLike, method: str = METHODS[0], **options: Any) -> FitResult:
    """Fit the five parameters to the recordings of a rig.

    Parameters
    ----------
    rig : Rig or path
        A rig, or its folder.
    method : {"least-squares", "irt+", "irt", "cma-es", "es", "direct"}
        How: the last four are the paper's method and those that it compares with.
    **options
        Of the method, see `irt.fitting.least_squares.least_squares`, `irt.tuning.residual_tuning.irt` and
        `irt.tuning.budgeted.budgeted`. All take ``seed``, ``engine``, ``threads`` and ``progress``.

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
    # torch, scipy and pycma load only where they are used.
    if method == "least-squares":
        from irt.fitting.least_squares import least_squares  # noqa: PLC0415

        return least_squares(rig, **options)
    rig = rig.of_marbles()
    if method == "irt":
        from irt.tuning.residual_tuning import irt  # noqa: PLC0415

        return irt(rig, **options)
    if method not in METHODS:
        raise unknown_name("method", method, METHODS)
    from irt.tuning.budgeted import budgeted  # noqa: PLC0415

    return budgeted(rig, method, **options)
