"""Tuning: `tune` for all methods, and the implementation of iterative residual tuning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from irt import arguments
from irt.catalogue import effect
from irt.engine import Engine
from irt.errors import IrtError
from irt.methods import BELONGS, METHODS
from irt.model import Effect
from irt.rig import Rig, as_rig

if TYPE_CHECKING:
    from irt.files import PathLike
    from irt.fitting.fit import FitResult, Progress


@arguments.entry
def tune(
    rig: Rig | PathLike,
    method: str = METHODS[0],
    *,
    starts: int | None = None,
    iterations: int | None = None,
    rollouts: int | None = None,
    network: PathLike | None = None,
    effects: Sequence[Effect | str] = (),
    seed: int = 0,
    engine: Engine = "rolling",
    threads: int | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Fit the five parameters to the recordings of a rig.

    Parameters
    ----------
    rig : Rig or path
        A rig, or its folder.
    method : {"least-squares", "irt+", "irt", "cma-es", "es", "direct"}
        The method; the last four are the paper's method and its baselines.
    starts : int, optional
        Number of start points; default 8 for least squares, 1 for "irt+", 5 for the others. Not for "direct".
    iterations : int, optional
        For "irt": steps from each start; default 20.
    rollouts : int, optional
        For "irt+", "cma-es" and "es": simulated proposals from each start; default 60, 300, 1005.
    network : path, optional
        For "irt+", "irt" and "direct": a trained network to use instead of the shipped or cached one.
    effects : sequence of Effect or str, optional
        For least squares: effects to add to the simulation and fit, or their names.
    seed : int
        Seed of the start points.
    engine : {"rolling", "rapier"}
        The simulator.
    threads : int, optional
        Threads of the engine; by default one for each core.
    progress : callable, optional
        Called with (done, total, text).

    Returns
    -------
    FitResult
        The tuned model with intervals, facts about the fit, and warnings of a check of the recordings.

    Raises
    ------
    IrtError
        If the method is unknown, the rig or an option is invalid, the recordings can identify nothing or are
        certainly wrong (see `irt.check`), or a file cannot be written.
    """
    arguments.word("method", method, METHODS)
    added = _effects(effects)
    numbers = {"starts": starts, "iterations": iterations, "rollouts": rollouts}
    given = {name: arguments.whole(name, one, 1) for name, one in numbers.items() if one is not None}
    if network is not None:
        arguments.path("network", network)
    check_options(method, [*given, *["network"][: network is not None], *["effects"][: bool(added)]])
    arguments.whole("seed", seed)
    arguments.text("engine", engine)
    arguments.threads(threads)
    arguments.progress(progress)
    common: dict[str, Any] = {
        **given,
        "seed": seed,
        "engine": engine,
        "threads": threads,
        "progress": progress,
    }
    # The check, torch, scipy and pycma are imported only where they are used.
    from irt.checking.run import required  # noqa: PLC0415

    rig = as_rig(rig).on_bare_board()
    warnings = required(rig, threads=threads)
    if method == "least-squares":
        common["effects"] = added
    elif network is not None:
        common["network"] = network
    return replace(_tuned(rig, method, common), warnings=warnings)


def _tuned(rig: Rig, method: str, options: Mapping[str, Any]) -> FitResult:
    """Fit by the method with its options."""
    if method == "least-squares":
        from irt.fitting.least_squares import least_squares  # noqa: PLC0415

        return least_squares(rig, **options)
    if method == "irt":
        from irt.tuning.residual_tuning import irt  # noqa: PLC0415

        return irt(rig.of_marbles(), **options)
    from irt.tuning.budgeted import budgeted  # noqa: PLC0415

    return budgeted(rig.of_marbles(), method, **options)


def check_options(method: str, given: Sequence[str], *, prefix: str = "") -> None:
    """Raise unless each given option belongs to the method.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    given : sequence of str
        Names of options; common options of all methods are accepted.
    prefix : str
        The prefix of option names, such as ``--``.

    Raises
    ------
    IrtError
        If an option does not belong to it.
    """
    for name in given:
        if name in BELONGS and method not in BELONGS[name]:
            option = (
                f"{prefix}{name}".removesuffix("s") if prefix and name == "effects" else f"{prefix}{name}"
            )
            whose = f"{prefix}method {' or '.join(BELONGS[name])}"
            raise IrtError(f"{option} belongs to {whose}; leave it out")


def _effects(effects: Sequence[Effect | str]) -> tuple[Effect, ...]:
    """Return effects; those given by name have all parameters free."""
    if isinstance(effects, str | bytes | Mapping) or not isinstance(effects, Sequence):
        raise IrtError(f"effects: expected a sequence of irt.Effect or names, got {arguments.shown(effects)}")
    named = [Effect(one, {}) if isinstance(one, str) else one for one in effects]
    found = arguments.listed("effects", named, Effect)
    for one in found:
        effect(one.name)
    return found
