"""The networks of the compared methods, each trained once and stored beside the results.

For a damped marble the networks for one without damping are used, as in `irt tune` (`is_paper_drive`).
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from irt.extras import require
from irt.fitting.fit import Progress
from irt.paper.setting import Setting, within
from irt.tuning import cache
from irt.tuning.pairs import simulate_pairs
from irt.tuning.pretrain import pretrain, reproducible
from irt.tuning.recipes import Recipe, Streamed
from irt.tuning.stepnet import StepFile, load_steps
from irt.tuning.streaming import train_steps
from irt.tuning.tensors import checkpoint_path
from irt.tuning.tunenet import NetworkFile, load_network

if TYPE_CHECKING:
    from sbi.neural_nets.estimators import ConditionalDensityEstimator

Array = NDArray[np.float64]

#: The paper's training (section 5.2 and 5.3): fixed pairs, a constant learning rate, no noise.
PAPERS_WAY: dict[str, Any] = {"dealing": "once", "schedule": "constant", "noise": (0.0, 0.0)}
#: Number of training pairs, as in the paper.
NPE_PAIRS = Recipe().pairs
#: Maximum epochs of neural posterior estimation; it stops early by a held-out tenth.
NPE_EPOCHS = 60
#: Widths of its embedding network for observations.
_EMBEDDING = (256, 64)


def papers(
    setting: Setting, task: Literal["difference", "parameters"], progress: Progress | None = None
) -> NetworkFile:
    """Return the paper's network, or that of direct prediction, trained as in the paper."""
    path = setting.trained.folder("networks") / f"{'irt' if task == 'difference' else 'direct'}.safetensors"
    recipe = Recipe(**PAPERS_WAY, task=task, seed=setting.seed)
    if path.exists():
        file = load_network(path)
        if (
            file.metadata["drive"] == setting.trained.drive.digest
            and file.metadata["seed"] == f"{setting.seed}"
        ):
            return file
    return pretrain(
        setting.trained.drive,
        path,
        recipe,
        resume=checkpoint_path(path).exists(),
        command="irt reproduce",
        device="cpu",
        threads=setting.threads,
        progress=within(progress, f"the paper's network, {task}"),
    )


def shipped(setting: Setting) -> NetworkFile | None:
    """Return the network of `irt tune --method irt`, if it is for this drive."""
    file = load_network(cache.SHIPPED)
    return file if file.metadata["drive"] == setting.trained.drive.digest else None


def steps(setting: Setting, progress: Progress | None = None) -> StepFile:
    """Return the network of IRT+: the shipped one, or one trained for another drive."""
    if cache.SHIPPED_STEPS.exists():
        file = load_steps(cache.SHIPPED_STEPS)
        if file.metadata["drive"] == setting.trained.drive.digest:
            return file
    path = setting.trained.folder("networks") / f"steps-{setting.seed}.safetensors"
    if path.exists():
        return load_steps(path)
    return train_steps(
        setting.trained.drive,
        path,
        Streamed(samples=cache.SAMPLES, seed=setting.seed),
        resume=checkpoint_path(path).exists(),
        command="irt reproduce",
        device="cpu",
        threads=setting.threads,
        progress=within(progress, "the network of irt+"),
    )


def posterior(setting: Setting, progress: Progress | None = None) -> ConditionalDensityEstimator:
    """Return a neural posterior (sbi) trained on as many simulations as the paper's network.

    Raises
    ------
    IrtError
        If sbi is not installed.
    """
    require("sbi", "neural posterior estimation")
    from sbi.inference import NPE  # noqa: PLC0415
    from sbi.neural_nets import posterior_nn  # noqa: PLC0415
    from sbi.utils import BoxUniform  # noqa: PLC0415

    path = setting.trained.folder("networks") / f"npe-{setting.seed}.pt"
    if path.exists():
        # sbi stores estimators as pickles; the file was written by this program.
        kept: ConditionalDensityEstimator = torch.load(path, weights_only=False)
        return kept
    if progress:
        # sbi reports no progress.
        progress(0, NPE_EPOCHS, "training a neural posterior, some minutes")
    pairs = simulate_pairs(setting.trained.drive, NPE_PAIRS, setting.seed, threads=setting.threads)
    with reproducible(), torch.random.fork_rng(devices=[]), quiet():
        torch.manual_seed(setting.seed)
        first, second = _EMBEDDING
        embedding = torch.nn.Sequential(
            torch.nn.Linear(pairs.inputs.shape[1], first),
            torch.nn.ReLU(),
            torch.nn.Linear(first, second),
            torch.nn.ReLU(),
        )
        inference = NPE(
            BoxUniform(torch.zeros(5), torch.ones(5)),
            density_estimator=posterior_nn("nsf", embedding_net=embedding, z_score_x="structured"),
            tracker=_Silent(),
            show_progress_bars=False,
        )
        inference.append_simulations(pairs.scaled, pairs.inputs)
        estimator = inference.train(max_num_epochs=NPE_EPOCHS).eval()
    part = path.with_suffix(".part")
    torch.save(estimator, part)
    part.replace(path)
    return estimator


class _Silent:
    """A tracker of sbi that writes nothing of its training."""

    log_dir = None

    def log_metric(self, name: str, value: float, step: int | None = None) -> None:
        """Do nothing."""

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        """Do nothing."""

    def log_params(self, params: dict[str, Any]) -> None:
        """Do nothing."""

    def add_figure(self, name: str, figure: Any, step: int | None = None) -> None:
        """Do nothing."""

    def flush(self) -> None:
        """Do nothing."""


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress sbi's warning about constant data: the first row is the same in every path."""
    level = logging.getLogger().level
    logging.getLogger().setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.getLogger().setLevel(level)
