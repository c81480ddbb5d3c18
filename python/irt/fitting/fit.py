"""The result type of all fitting methods: IRT, least squares and the baselines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from irt import display

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from irt.model import Model, Parameter

#: Called with (done, total, text) by functions that may take longer than two seconds.
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class Iteration:
    """One step of a fit.

    Attributes
    ----------
    parameters : (5,) array
        In the order of `irt.rig.PARAMETERS`, each in its own unit.
    mae : float
        Mean absolute error of the prediction from these parameters, in board edges.
    """

    parameters: NDArray[np.float64]
    mae: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """The path of a fit from one start point.

    Attributes
    ----------
    history : tuple of Iteration
        `history[0]` is the start point, before any step. Never empty.
    """

    history: tuple[Iteration, ...]

    @property
    def final(self) -> Iteration:
        """The last iteration."""
        return self.history[-1]

    @property
    def best(self) -> Iteration:
        """The iteration with the smallest error, which need not be the last."""
        return min(self.history, key=lambda iteration: iteration.mae)


@dataclass(frozen=True, eq=False)
class FitResult:
    """The result of a fit by any method.

    Attributes
    ----------
    method : str
        "least-squares", "irt", ...
    model : Model
        The tuned model; its parameters carry 95 % intervals.
    noise : float
        Standard deviation of the residuals per coordinate [board edges], estimated robustly: that of the
        tracker where the model explains the recordings, and more where physics is missing.
    estimates : tuple of Estimate
        One for each start point, the best first; the model comes from the first.
    rollouts : int
        Number of simulated recordings (or windows of recordings), over all starts.
    unidentifiable : tuple of str
        Sentences on parameter combinations that are not identifiable from these recordings; empty if all are.
    notes : tuple of str
        Sentences on other findings, such as a parameter outside its range or a time scale taken from stamps.
    seed : int
        Seed of the start points; the same seed gives the same bits for any number of threads.
    seconds : float
        Wall time.
    residuals : tuple of (n, 2) arrays
        Predicted minus observed [board edges] over each segment of the rig (`irt.residual.segments`), NaN
        in rows without a marble; empty for methods that do not estimate start states.
    effects : dict
        Parameters of the model's effects with 95 % intervals, by effect and name.
    warnings : tuple of str
        Warnings of a check of the recordings (`irt.check`); empty if the fit made no check.
    """

    method: str
    model: Model
    noise: float
    estimates: tuple[Estimate, ...]
    rollouts: int
    unidentifiable: tuple[str, ...]
    notes: tuple[str, ...]
    seed: int
    seconds: float
    residuals: tuple[NDArray[np.float64], ...] = ()
    effects: dict[str, dict[str, Parameter]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def history(self) -> tuple[Iteration, ...]:
        """Iterations from the best start point."""
        return self.estimates[0].history

    @property
    def mae(self) -> float:
        """Smallest mean absolute error over the iterations from the best start point, in board edges."""
        return self.estimates[0].best.mae

    def plot(self) -> Figure:
        """Draw the error over the iterations, from every start point; return a matplotlib figure."""
        from irt import pictures  # noqa: PLC0415

        lines = [
            pictures.Line(
                "best start" if won else "",
                np.array([100.0 * iteration.mae for iteration in estimate.history]),
                pictures.AFTER if won else "#c3c8ce",
            )
            for won, estimate in reversed([(i == 0, one) for i, one in enumerate(self.estimates)])
        ]
        return pictures.curves(lines, "iteration", "mean error  [% of edge]")

    def _repr_html_(self) -> str:
        return display.page(
            f"Fit by {self.method}",
            display.items(f"Warning: {one}" for one in self.warnings),
            display.paragraph(
                f"Mean error {display.percent(self.mae)} of the edge, standard deviation of its residuals "
                f"{display.percent(self.noise)}; {self.rollouts:,} rollouts in {self.seconds:.1f} s."
            ),
            self.model._repr_html_(),
            display.items((*self.unidentifiable, *self.notes)),
        )
