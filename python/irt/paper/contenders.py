"""The compared methods: each returns its proposals over rollouts for every target."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from irt.extras import is_installed
from irt.fitting.fit import Progress
from irt.paper import networks
from irt.paper.setting import ROLLOUTS, Setting
from irt.tuning.direct import suggested
from irt.tuning.drive import Drive
from irt.tuning.evolution import STRATEGIES
from irt.tuning.iterate import Tuner
from irt.tuning.library import PATHS, Library
from irt.tuning.plus import Plus
from irt.tuning.search import Path, Search, Seen, compare, left_over, run
from irt.tuning.stepnet import middle
from irt.tuning.tunenet import NetworkFile

Array = NDArray[np.float64]

#: Iterations of IRT; then its steps have shrunk by 0.85^60 and proposals no longer change.
IRT_ITERATIONS = 60
#: Simulations in the training of a network of the paper's size, including the held-out ones.
_PAPERS_SIMULATIONS = 22_000


@dataclass(frozen=True, eq=False)
class Held:
    """Proposals of a method after 0, 1, ... rollouts, for n targets.

    Attributes
    ----------
    parameters : (n, rollouts + 1, 5) array
        In their own units.
    mae : (n, rollouts + 1) array
        Mean absolute state error of each [board edges].
    """

    parameters: Array
    mae: Array


@dataclass(frozen=True, eq=False)
class Trials:
    """Targets and start points.

    Attributes
    ----------
    observed : (n, rows, 2) array
        Observation of each target [board edges].
    start : (n, 5) array
        Random proposals, scaled to [0, 1].
    """

    observed: Array
    start: Array


Contender = Callable[[Setting, Trials, Progress | None], Held]


@dataclass(frozen=True)
class Method:
    """A compared method.

    Attributes
    ----------
    title : str
        Title in tables and figures.
    tune : callable
        Runs the method.
    pretraining : callable
        Returns the number of rollouts in its network's training.
    """

    title: str
    tune: Contender
    pretraining: Callable[[Setting], int] = lambda _: 0


def _irt(file: NetworkFile, setting: Setting, trials: Trials, *, both_orders: bool) -> Held:
    drive = setting.drive
    tuner = Tuner(drive, file.network, joint=True, both_orders=both_orders)
    trace = tuner.iterate(trials.start, [trials.observed], IRT_ITERATIONS, threads=setting.threads)
    kept = np.minimum(np.arange(ROLLOUTS + 1), IRT_ITERATIONS)
    return Held(drive.parameters(trace.scaled.swapaxes(0, 1)[:, kept]), trace.mae.T[:, kept])


def irt_as_in_the_paper(setting: Setting, trials: Trials, progress: Progress | None) -> Held:
    """Tune by the paper's network, trained in the paper's way; the newest proposal counts, as in Fig. 5."""
    file = networks.papers(setting, "difference", progress)
    return _irt(file, setting, trials, both_orders=False)


def irt_as_shipped(setting: Setting, trials: Trials, progress: Progress | None) -> Held:
    """Tune by the network of ``--method irt``; the newest proposal counts."""
    file = networks.shipped(setting)
    if file is None:
        file = networks.papers(setting, "difference", progress)
    return _irt(file, setting, trials, both_orders=True)


def _shipped_simulations(setting: Setting) -> int:
    """Return the rollouts in the training of the network of ``--method irt``, including held-out ones."""
    file = networks.shipped(setting)
    if file is None:
        return _PAPERS_SIMULATIONS
    pairs = int(file.metadata["pairs"])
    return 2 * (pairs + pairs // 10)


def _plus_simulations(setting: Setting) -> int:
    """Return the rollouts in the training of the network of IRT+, and those of its library."""
    return int(networks.steps(setting).metadata["rollouts"]) + PATHS


def irt_plus(setting: Setting, trials: Trials, progress: Progress | None) -> Held:
    """Tune by IRT+; the best proposal so far counts."""
    drive, file = setting.drive, networks.steps(setting, progress)
    library = Library(drive, setting.threads)
    searches = [
        Plus(drive, file, True, compare(drive, middle(drive), [observed], setting.threads), library).search(
            np.random.default_rng([setting.seed, i])
        )
        for i, observed in enumerate(trials.observed)
    ]
    begin = np.repeat(middle(drive), len(searches), axis=0)
    return _driven(setting, trials, searches, begin, progress)


def direct(setting: Setting, trials: Trials, progress: Progress | None) -> Held:
    """Predict directly, without any rollout."""
    drive, file = setting.drive, networks.papers(setting, "parameters", progress)
    scaled = np.clip(suggested(file.network, drive.inputs([trials.observed])), 0.0, 1.0)
    return _constant(setting, trials, drive.parameters(scaled))


def strategy(name: str) -> Contender:
    """Return a tuner by an evolution strategy from the random proposals; the best proposal so far counts."""

    def tune(setting: Setting, trials: Trials, progress: Progress | None) -> Held:
        drive = setting.drive
        searches = [STRATEGIES[name](drive, start, i) for i, start in enumerate(trials.start)]
        return _driven(setting, trials, searches, drive.parameters(trials.start), progress)

    return tune


def neural_posterior(setting: Setting, trials: Trials, progress: Progress | None) -> Held:
    """Draw from a neural posterior, first its mean; the best proposal so far counts."""
    import torch  # noqa: PLC0415  # no other method needs it

    drive, estimator = setting.drive, networks.posterior(setting, progress)
    with torch.random.fork_rng(devices=[]), torch.no_grad(), networks.quiet():
        torch.manual_seed(setting.seed)
        condition = torch.tensor(drive.inputs([trials.observed]), dtype=torch.float32)
        drawn = estimator.sample((ROLLOUTS,), condition=condition).double().numpy().swapaxes(0, 1)
    drawn[:, 0] = drawn.mean(axis=1)
    proposals = drive.parameters(np.clip(drawn, 0.0, 1.0))
    searches = [_listed(each) for each in proposals]
    return _driven(setting, trials, searches, proposals[:, 0], progress)


def multi_start(setting: Setting, trials: Trials, progress: Progress | None) -> Held:
    """Minimise by scipy's least squares from the random proposal, and from others once it has converged."""
    drive, paths = setting.drive, []
    for i, observed in enumerate(trials.observed):
        random = np.random.default_rng([setting.seed, i, 1])
        paths.append(_least_squares(drive, observed, trials.start[i], random))
        if progress:
            progress(i + 1, len(trials.observed), "least squares")
    return _held(setting, trials, paths, drive.parameters(trials.start))


class _SpentError(Exception):
    """The rollouts are used up."""


def _least_squares(drive: Drive, observed: Array, start: Array, random: np.random.Generator) -> Path:
    """Return the proposals of trust-region least squares over its rollouts.

    The time step is continuous, because a rounded one has no slope.
    """
    proposals: list[Array] = []
    errors: list[float] = []

    def residual(scaled: Array) -> Array:
        if len(errors) == ROLLOUTS:
            raise _SpentError
        parameters = drive.parameters(scaled[None])
        # Batches of one rollout gain nothing from more threads.
        missing = [observed - each for each in drive.simulate(parameters, 1, time_step="continuous")]
        left: Array = left_over(drive, missing, [observed])[0]
        proposals.append(parameters[0])
        errors.append(float(np.abs(left).mean()))
        return left

    try:
        for attempt in count():
            begin = start if attempt == 0 else random.random(len(start))
            least_squares(
                residual, np.clip(begin, 0.01, 0.99), bounds=(0.0, 1.0), diff_step=1e-4, x_scale=1.0
            )
    except _SpentError:
        pass
    return Path(np.array(proposals), np.array(errors))


def _listed(proposals: Array) -> Search:
    yield proposals


def _constant(setting: Setting, trials: Trials, parameters: Array) -> Held:
    mae = _errors(setting, trials, parameters)
    return Held(
        np.repeat(parameters[:, None], ROLLOUTS + 1, axis=1), np.repeat(mae[:, None], ROLLOUTS + 1, axis=1)
    )


def _driven(
    setting: Setting,
    trials: Trials,
    searches: Sequence[Search],
    start: Array,
    progress: Progress | None,
) -> Held:
    targets = [[observed] for observed in trials.observed]
    paths = run(setting.drive, targets, searches, ROLLOUTS, threads=setting.threads, progress=progress)
    return _held(setting, trials, paths, start)


def _held(setting: Setting, trials: Trials, paths: Sequence[Path], start: Array) -> Held:
    """Return the proposal after each rollout; before the first one it is the start."""
    best = [path.best.padded(ROLLOUTS) for path in paths]
    begin = _errors(setting, trials, start)
    return Held(
        np.stack([np.vstack([s, path.parameters]) for s, path in zip(start, best, strict=True)]),
        np.stack([np.append(e, path.mae) for e, path in zip(begin, best, strict=True)]),
    )


def _errors(setting: Setting, trials: Trials, parameters: Array) -> Array:
    """Return the state errors (n,) of one proposal for each target."""
    seen: Seen = compare(setting.drive, parameters, [trials.observed], setting.threads)
    return seen.mae


def available() -> tuple[str, ...]:
    """Return the methods whose packages are installed: all but for sbi, an optional extra."""
    return tuple(name for name in METHODS if name != "npe" or is_installed("sbi"))


#: All methods in the order of tables, those of the paper first.
METHODS: dict[str, Method] = {
    "irt-paper": Method("IRT, as in the paper", irt_as_in_the_paper, lambda _: _PAPERS_SIMULATIONS),
    "direct": Method("direct prediction", direct, lambda _: _PAPERS_SIMULATIONS),
    "cma-es": Method("CMA-ES", strategy("cma-es")),
    "es": Method("(5+100) ES", strategy("es")),
    "npe": Method("neural posterior (sbi)", neural_posterior, lambda _: _PAPERS_SIMULATIONS),
    "irt": Method("IRT, as shipped", irt_as_shipped, _shipped_simulations),
    "least-squares": Method("least squares (scipy)", multi_start),
    "irt+": Method("IRT+", irt_plus, _plus_simulations),
}
