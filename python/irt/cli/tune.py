"""`irt tune`: fit the five parameters to recordings."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irt.cli.inputs import (
    TIME_UNKNOWN,
    parameter_line,
    print_warnings,
    results_folder,
    row_seconds,
    rows_for_fit,
    whole,
)
from irt.methods import BELONGS, METHODS

if TYPE_CHECKING:
    from irt.fitting.fit import FitResult
    from irt.model import Effect, Model
    from irt.residual import Errors, Evaluation, TiltErrors
    from irt.rig import Rig

NAME = "tune"
HELP = "fit the simulator's five parameters to recordings"

#: Options of some methods only; see `irt.methods.BELONGS`.
_OF_SOME = ("starts", "iterations", "rollouts", "network")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt tune`."""
    parser.add_argument("rig", metavar="RIG", type=Path, help="a folder of recordings (*.csv)")
    parser.add_argument(
        "--method", choices=METHODS, default=METHODS[0], help=f"see below (default: {METHODS[0]})"
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="folder for the results (default: irt-tune-NAME for a rig NAME)",
    )
    parser.add_argument(
        "--starts",
        metavar="N",
        type=whole(1),
        help="start points (default: 8 for least-squares, 1 for irt+, 5 for the others)",
    )
    parser.add_argument(
        "--iterations", metavar="N", type=whole(1), help="iterations of irt from each start (default: 20)"
    )
    parser.add_argument(
        "--rollouts",
        metavar="N",
        type=whole(1),
        help="proposals that irt+, cma-es or es simulate from each start (default: 60, 300, 1005)",
    )
    parser.add_argument(
        "--effect",
        metavar="NAME",
        action="append",
        default=[],
        help="for least-squares: add an effect of the catalogue and fit its parameters too; "
        "NAME.PARAMETER fits an optional parameter; may be repeated",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="random seed (default: 0)")
    parser.add_argument(
        "--network",
        metavar="FILE",
        type=Path,
        help="network of irt+, irt or direct, from `irt pretrain` (default: the bundled network for the "
        "paper's drive; for other drives one is trained and cached)",
    )
    parser.add_argument(
        "--engine", choices=("rolling", "rapier"), default="rolling", help="the simulator (default: rolling)"
    )
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="simulator threads (default: one per core)"
    )
    parser.epilog = (
        "methods:\n"
        "  least-squares  nonlinear least squares through the simulator: most reliable, 10,000s of rollouts\n"
        "  irt+           a network proposes parameters, Gauss-Newton refines them: about ten rollouts\n"
        "  irt            iterative residual tuning, as in the paper\n"
        "  cma-es, es, direct  the paper's baselines\n\n"
        "examples:\n"
        "  irt tune my-rig --method irt+ --out tuned\n"
        "  irt tune my-rig --effect delay --effect lag --effect tilt_bias"
    )


def run(args: argparse.Namespace) -> None:
    """Tune, write the model, the numbers and the report, and print a table."""
    from irt.cli.progress import progress_bar
    from irt.files import write_atomic
    from irt.model import save_model
    from irt.residual import evaluate
    from irt.rig import load_rig

    options = _options(args)
    rig, notes = rows_for_fit(load_rig(args.rig))
    # These load scipy and matplotlib: a file that cannot be read is named before.
    from irt.fitting.chain import without_held_marbles
    from irt.report.tuning_report import untuned, write_tuning_report
    from irt.tuning import tune

    print_warnings(rig, args.threads)
    training = _announce_training(rig, args) if args.network is None else None
    folder = args.out or Path(f"irt-tune-{args.rig.resolve().name}")
    folder = results_folder(folder, ("model.toml", "fit.json", "report.html"))
    try:
        with progress_bar() as progress:
            result = tune(rig, args.method, progress=progress, **options)
    except KeyboardInterrupt:
        if training is not None and training.exists():
            print("irt: the same command resumes the training", file=sys.stderr)
        raise
    warnings = (*notes, *result.warnings)
    rig = without_held_marbles(rig)
    after = evaluate(result.model, rig.recordings)
    row_s = row_seconds(rig, result.model)
    before = _evaluate_as(after, untuned(rig), rig, row_s)
    save_model(folder / "model.toml", result.model)
    numbers = json.dumps(
        {**_numbers(args, result, before, after), "warnings": warnings}, indent=2, allow_nan=False
    )
    write_atomic(folder / "fit.json", f"{numbers}\n")
    page = write_tuning_report(
        folder,
        rig,
        [result],
        title=f"{args.rig.resolve().name}, tuned",
        settings={"command": _command(args), "seed": f"{args.seed}", "time": f"{result.seconds:.1f} s"},
        warnings=warnings,
    )
    for line in _table(result, before, after, row_s):
        print(line)
    print(f"\nwrote {folder / 'model.toml'}, {folder / 'fit.json'} and {page}")


def _evaluate_as(other: Evaluation, model: Model, rig: Rig, row_s: float | None) -> Evaluation:
    """Evaluate a model in windows of as many rows as `other`, whose model has rows of `row_s` [s]."""
    from irt.residual import evaluate

    own = row_seconds(rig, model)
    if not own or not row_s:
        return evaluate(model, rig.recordings, other.window_s)
    return evaluate(model, rig.recordings, other.window_s * own / row_s)


def _options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the method that are set."""
    from irt.tuning import check_options

    options = {name: getattr(args, name) for name in _OF_SOME if getattr(args, name) is not None}
    if args.effect:
        options["effects"] = _effects(args.effect)
    check_options(args.method, list(options), prefix="--")
    return {**options, "seed": args.seed, "engine": args.engine, "threads": args.threads}


def _effects(names: Sequence[str]) -> list[Effect]:
    """Return the effects of the names; named optional parameters start at their neutral values."""
    from irt.catalogue import effect
    from irt.errors import unknown_name
    from irt.model import Effect

    asked: dict[str, dict[str, float]] = {}
    for one in names:
        name, _, parameter = one.partition(".")
        optional = {known.name: known.neutral for known in effect(name).parameters if known.optional}
        opened = asked.setdefault(name, {})
        if parameter and parameter not in optional:
            raise unknown_name(f"optional parameter of {name}", parameter, optional)
        if parameter:
            opened[parameter] = optional[parameter]
    return [Effect(name, parameters) for name, parameters in asked.items()]


def _announce_training(rig: Rig, args: argparse.Namespace) -> Path | None:
    """Print a note if a network must be trained for the rig, and return its checkpoint's path."""
    if args.method not in BELONGS["network"]:
        return None
    from irt.tuning.cache import need, require_training, training_data
    from irt.tuning.tensors import checkpoint_path

    path = need(rig, args.engine).path(args.method)
    if path.exists():
        return None
    require_training(args.method)
    print(
        f"There is no network for this rig's drive yet: training one on {training_data(args.method)} "
        f"(minutes). It is kept in {path}.",
        flush=True,
    )
    return checkpoint_path(path)


def _numbers(
    args: argparse.Namespace, result: FitResult, before: Evaluation, after: Evaluation
) -> dict[str, Any]:
    """Return the contents of fit.json."""
    return {
        "command": _command(args),
        "method": result.method,
        "seed": result.seed,
        "parameters": {
            name: {
                "value": parameter.value,
                "low": parameter.low,
                "high": parameter.high,
                "range": list(result.model.ranges[name]),
            }
            for name, parameter in result.model.parameters.items()
        },
        "effects": {
            name: {
                key: {"value": one.value, "low": one.low, "high": one.high} for key, one in of_effect.items()
            }
            for name, of_effect in result.effects.items()
        },
        "time_base": "unknown: no stamps" if after.window_length_rows is not None else "stamps",
        "noise": _finite(result.noise),
        "before": before.as_dict(),
        "after": after.as_dict(),
        "unidentifiable": list(result.unidentifiable),
        "notes": list(result.notes),
        "rollouts": result.rollouts,
        "seconds": result.seconds,
        "starts": [
            [{"parameters": step.parameters.tolist(), "mae": _finite(step.mae)} for step in estimate.history]
            for estimate in result.estimates
        ],
    }


def _finite(value: float) -> float | None:
    """Return a number, or None where it is not finite: JSON has no NaN."""
    return value if math.isfinite(value) else None


def _table(result: FitResult, before: Evaluation, after: Evaluation, row_s: float | None) -> Iterator[str]:
    """Yield the lines of the printed table; `row_s` as in `parameter_line`."""
    from irt.catalogue import effect
    from irt.fitting.problem import in_unit_of
    from irt.report.words import with_interval

    yield "parameter           value  (95 % interval)"
    for name, parameter in result.model.parameters.items():
        unit = " updates of 1/240 s per timestep" if name == "time_scale" else ""
        yield f"{name:<18}  {with_interval(parameter)}{unit}"
    for name, of_effect in result.effects.items():
        yield name
        for known in in_unit_of(result.model, effect(name)).parameters:
            if known.name in of_effect:
                label, value = parameter_line(known.name, of_effect[known.name], known.unit, row_s)
                yield f"  {label:<16}  {value}"
    if row_s is not None:
        yield f"\n{TIME_UNKNOWN}"
    yield "\nmean error in % of the board's long edge, untuned -> tuned"
    if before.free_run is not None and after.free_run is not None:
        yield f"free run            {_change(before.free_run, after.free_run)}"
    if before.windowed is not None and after.windowed is not None:
        yield f"{after.windows:<18}  {_change(before.windowed, after.windowed)}"
    if before.played is not None and after.played is not None:
        yield f"the same, under the measured tilt  {_change(before.played, after.played)}"
    if after.tilt is not None:
        yield f"mean error of the tilt predicted from commands  {_tilt_error(after.tilt)}"
    for title, sentences in (
        ("not identifiable from these recordings", result.unidentifiable),
        ("notes", result.notes),
    ):
        if sentences:
            yield f"\n{title}"
            yield from (f"- {sentence}" for sentence in sentences)


def _change(before: Errors, after: Errors) -> str:
    return f"{100 * before.mae:.2f} -> {100 * after.mae:.2f}"


def _tilt_error(errors: TiltErrors) -> str:
    by_axis = (("x", errors.mae_x_rad), ("y", errors.mae_y_rad))
    return ", ".join(f"{1000 * error:.2f} mrad about {axis}" for axis, error in by_axis if error is not None)


def _command(args: argparse.Namespace) -> str:
    """Return the command that reproduces this run."""
    words = ["irt", "tune", args.rig, "--method", args.method, "--seed", args.seed, "--engine", args.engine]
    for name in args.effect:
        words += ["--effect", name]
    for name in _OF_SOME:
        if getattr(args, name) is not None:
            words += [f"--{name}", getattr(args, name)]
    return shlex.join(str(word) for word in words)
