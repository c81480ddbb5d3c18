"""Experiment 1 (paper, section 6.1): simulated targets with known parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.fitting.fit import Progress
from irt.fitting.least_squares import least_squares
from irt.paper import errors
from irt.paper.contenders import METHODS, Held, Trials, available
from irt.paper.setting import ROLLOUTS, Setting, digest, within
from irt.recording import Recording
from irt.rig import PARAMETERS, Rig

Array = NDArray[np.float64]

#: Numbers of rollouts in the table.
SHOWN = (1, 2, 5, 10, 30, 100, 300)
#: Number of first targets for the engine's least squares, which takes half a second each.
ENGINE_TARGETS = 100
_ENGINE = "least squares (irt tune)"
_TRIALS = 2023


@dataclass(frozen=True, eq=False)
class Experiment1:
    """Results of Experiment 1.

    Attributes
    ----------
    setting : Setting
        The settings.
    truth : (n, 5) array
        Parameters of the targets, in their own units.
    trials : Trials
        Their observations, and the random proposals.
    held : dict of Held
        Proposals of each method, by its key in `irt.paper.contenders.METHODS`.
    engine : Held
        Final proposals of the engine's least squares on the first e targets, without a limit on rollouts.
    engine_rollouts : (e,) array
        Its numbers of simulated rollouts.
    """

    setting: Setting
    truth: Array
    trials: Trials
    held: Mapping[str, Held]
    engine: Held
    engine_rollouts: Array

    @cached_property
    def at_rim(self) -> NDArray[np.bool_]:
        """Targets whose marble met the rim; only they identify observation_scale."""
        return errors.meets_rim(self.setting.drive, self.truth, self.trials.observed)

    def parameter_error(self, held: Held) -> Array:
        """Return the raw parameter errors (n, rollouts + 1)."""
        return errors.parameter_error(self.setting.drive, held.parameters, self.truth[:, None])

    def combination_error(self, held: Held) -> Array:
        """Return the errors in the identifiable combinations (n, rollouts + 1), of the first n targets."""
        truth = self.truth[: len(held.parameters), None]
        return errors.combination_error(self.setting.drive, held.parameters, truth)

    def diverged(self, held: Held) -> int:
        """Return the number of trials with a larger error at the end than at the start."""
        return int((held.mae[:, -1] > held.mae[:, 0]).sum())

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers of tables and figures as JSON content."""
        methods = {}
        for name, held in self.held.items():
            raw, combined = self.parameter_error(held), self.combination_error(held)
            methods[name] = {
                "title": METHODS[name].title,
                "pretraining_rollouts": METHODS[name].pretraining(self.setting),
                "diverged": self.diverged(held),
                "after": {
                    f"{n}": {
                        "state_mae": asdict(errors.Summary.of(held.mae[:, n])),
                        "parameter_error": asdict(errors.Summary.of(raw[:, n])),
                        "combination_error": asdict(errors.Summary.of(combined[:, n])),
                        "combination_error_at_rim": asdict(errors.Summary.of(combined[self.at_rim, n])),
                    }
                    for n in (0, *SHOWN[:3], 20, *SHOWN[3:])
                },
            }
        return {
            "targets": len(self.truth),
            "targets_at_rim": int(self.at_rim.sum()),
            "unit": "board edges; shares of the parameters' ranges",
            "methods": methods,
            "engine": {
                "rollouts": asdict(errors.Summary.of(self.engine_rollouts)),
                "state_mae": asdict(errors.Summary.of(self.engine.mae[:, -1])),
                "combination_error": asdict(errors.Summary.of(self.combination_error(self.engine)[:, -1])),
            },
        }


def experiment1(
    setting: Setting,
    methods: Sequence[str] | None = None,
    progress: Progress | None = None,
    *,
    engine_targets: int = ENGINE_TARGETS,
) -> Experiment1:
    """Tune to random targets by every method; results of an earlier call are reused.

    The engine's own least squares runs on the first ``engine_targets``.

    Raises
    ------
    IrtError
        If a file cannot be read or written, or a package of a method is missing.
    """
    drive = setting.drive
    random = np.random.default_rng([setting.seed, _TRIALS])
    drawn = random.random((2, setting.targets, len(PARAMETERS)))
    truth = drive.parameters(drawn[0])
    observed = drive.simulate(truth, setting.threads)[0]
    trials = Trials(observed, drawn[1])
    folder = setting.folder("experiment-1")
    of = digest(observed, trials.start)
    held = {}
    for name in available() if methods is None else methods:
        kept = setting.kept(
            folder / f"{name}.npz",
            lambda name=name: vars(METHODS[name].tune(setting, trials, within(progress, name))),  # type: ignore[misc]
            of=of,
            rollouts=ROLLOUTS,
        )
        held[name] = Held(**kept)
    first = observed[:engine_targets]
    engine = setting.kept(folder / "engine.npz", lambda: _engine(setting, first, progress), of=digest(first))
    rollouts = engine.pop("rollouts")
    return Experiment1(setting, truth, trials, held, Held(**engine), rollouts)


def _engine(setting: Setting, targets: Array, progress: Progress | None) -> dict[str, Array]:
    """Fit observations (n, rows, 2) by ``irt tune``'s default method, without a limit on rollouts."""
    drive, found = setting.drive, []
    for i, observed in enumerate(targets):
        name = f"target-{i}"
        recording = Recording(name, Path(f"{name}.csv"), drive.runs[0].knobs, observed)
        rig = Rig(Path(), drive.board, drive.marble, "rest", dict(drive.ranges), (recording,))
        result = least_squares(rig, seed=setting.seed + i, threads=setting.threads)
        found.append((result.model.values, result.mae, result.rollouts))
        if progress:
            progress(i + 1, len(targets), _ENGINE)
    parameters, mae, rollouts = (np.array(each, dtype=np.float64) for each in zip(*found, strict=True))
    return {"parameters": parameters[:, None], "mae": mae[:, None], "rollouts": rollouts}
