"""Selection of a rig's network: shipped with the package, cached, or trained on demand."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from irt.engine import Engine
from irt.errors import IrtError
from irt.extras import require
from irt.files import PathLike, make_folder
from irt.fitting.fit import Progress
from irt.rig import Rig
from irt.segments import Segment, segments
from irt.tuning.drive import Drive, is_paper_drive
from irt.tuning.recipes import Recipe, Streamed
from irt.tuning.stepnet import StepFile, load_steps
from irt.tuning.tensors import checkpoint_path
from irt.tuning.tunenet import NetworkFile, load_network

_DATA = Path(__file__).resolve().parents[1] / "data"
#: Trained by the commands in their metadata, for the paper's drive.
SHIPPED = _DATA / "tunenet-paper.safetensors"
SHIPPED_STEPS = _DATA / "steps-paper.safetensors"
#: Recipe of a network of IRT+ that is trained on demand: minutes of training, sufficient for Gauss-Newton.
SAMPLES = 400_000

#: Methods that need a network.
Networked = Literal["irt", "irt+", "direct"]


@dataclass(frozen=True, eq=False)
class Need:
    """The network that a rig needs.

    Attributes
    ----------
    segments : list of Segment
        The predicted segments of the rig.
    rig_drive : Drive
        The drive of all runs of the rig.
    network_drive : Drive
        The drive of the network: the paper's single run, used for each run of the rig, or all runs at once.
    """

    segments: list[Segment]
    rig_drive: Drive
    network_drive: Drive

    @property
    def joint(self) -> bool:
        """Whether the network sees all runs at once."""
        return self.network_drive is self.rig_drive

    def path(self, method: Networked = "irt") -> Path:
        """Return the path of a method's network, which may not exist yet."""
        shipped = {"irt": SHIPPED, "irt+": SHIPPED_STEPS}.get(method)
        if shipped and shipped.exists() and self.network_drive.digest == Drive.paper().digest:
            return shipped
        chosen = _streamed() if method == "irt+" else _recipe(method)
        recipe = json.dumps(asdict(chosen), sort_keys=True)
        key = hashlib.sha256(f"{self.network_drive.digest} {recipe}".encode()).hexdigest()
        return cache_folder() / f"{_STEMS[method]}-{key[:16]}.safetensors"


def need(rig: Rig, engine: Engine = "rolling") -> Need:
    """Return the network that a rig needs with an engine.

    Recordings under the paper's drive use the paper's network. For any other rig the drive consists of all of
    its recordings, and one joint network sees them all.
    """
    stretches = segments(rig)
    drive = Drive.of_segments(rig, stretches, engine)
    for literal in (False, True):
        if is_paper_drive(rig, literal=literal):
            return Need(stretches, drive, Drive.paper(engine=engine, literal=literal))
    return Need(stretches, drive, drive)


def obtain(
    needed: Need,
    path: PathLike | None = None,
    *,
    task: Literal["difference", "parameters"] = "difference",
    threads: int | None = None,
    progress: Progress | None = None,
) -> NetworkFile:
    """Return the required network; trained and cached if it does not exist.

    Parameters
    ----------
    needed : Need
        From `need`.
    path : path, optional
        A network file to use instead.
    task : {"difference", "parameters"}
        The paper's method, or direct prediction.
    threads : int, optional
        Threads of the simulations.
    progress : callable, optional
        Called with (done, total, text).

    Raises
    ------
    IrtError
        If the given file is broken or was trained for another drive or task, the cache cannot be written, or
        a network has to be trained and PyTorch is not installed.
    """
    method: Networked = "irt" if task == "difference" else "direct"

    def load(path: PathLike) -> NetworkFile:
        file = _for_drive(path, load_network(path), needed)
        if (found := file.metadata.get("task", "difference")) != task:
            raise IrtError(
                f"{path}: trained to estimate {found}, not {task}; "
                f"train one with 'irt pretrain --method {method}'"
            )
        return file

    def train(**options: Any) -> NetworkFile:
        from irt.tuning.pretrain import pretrain  # noqa: PLC0415  # loads torch

        return pretrain(needed.network_drive, recipe=_recipe(method), **options)

    return _obtained(needed, method, path, load, train, threads=threads, progress=progress)


def obtain_steps(
    needed: Need,
    path: PathLike | None = None,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> StepFile:
    """Return the required network of IRT+, like `obtain` for the paper's method."""

    def load(path: PathLike) -> StepFile:
        return _for_drive(path, load_steps(path), needed)

    def train(**options: Any) -> StepFile:
        from irt.tuning.streaming import train_steps  # noqa: PLC0415  # loads torch

        return train_steps(needed.network_drive, recipe=_streamed(), **options)

    return _obtained(needed, "irt+", path, load, train, threads=threads, progress=progress)


def described(needed: Need, method: Networked, path: PathLike | None, trained: str) -> str:
    """Return a sentence about the network: given, shipped, or trained for the rig."""
    if path is not None:
        return f"The network is {path}: {trained}."
    if needed.path(method).parent == _DATA:
        return f"The network is the shipped one for the paper's drive: {trained}."
    return f"The network was trained for this rig's drive and is stored in {needed.path(method)}: {trained}."


def require_training(method: Networked) -> None:
    """Check that a network can be trained on this machine.

    Raises
    ------
    IrtError
        If PyTorch is not installed.
    """
    require("torch", f"--method {method} trains a network for this rig's drive, which")


def training_data(method: Networked) -> str:
    """Describe the training data of a network that is trained on demand."""
    if method == "irt+":
        return f"{SAMPLES} pairs, simulated as it goes"
    return f"{_recipe(method).pairs} simulated pairs"


def cache_folder() -> Path:
    """Return the folder of trained networks: ``IRT_CACHE``, or in the platform's folder of caches."""
    if chosen := os.environ.get("IRT_CACHE"):
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "irt"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "irt" / "Cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "irt"


_STEMS: dict[Networked, str] = {"irt": "tunenet", "irt+": "steps", "direct": "direct"}
_File = TypeVar("_File", NetworkFile, StepFile)


def _streamed() -> Streamed:
    return Streamed(samples=SAMPLES)


def _recipe(method: Networked) -> Recipe:
    return Recipe(task="parameters") if method == "direct" else Recipe()


def _obtained(
    needed: Need,
    method: Networked,
    named: PathLike | None,
    load: Callable[[PathLike], _File],
    train: Callable[..., _File],
    *,
    threads: int | None,
    progress: Progress | None,
) -> _File:
    if named is not None:
        return load(named)
    path = needed.path(method)
    if path.exists():
        if path.parent == _DATA:
            return load(path)
        with suppress(IrtError):
            return load(path)
    require_training(method)
    try:
        make_folder(path.parent)
    except IrtError as error:
        raise IrtError(f"{error}; or set IRT_CACHE to a folder for trained networks") from error
    train = partial(train, path=path, command="irt tune", threads=threads, progress=progress)
    if (checkpoint := checkpoint_path(path)).exists():
        # A file of another release, or a broken one, is retrained: this is only a cache.
        with suppress(IrtError):
            return train(resume=True)
        checkpoint.unlink(missing_ok=True)
    return train()


def _for_drive(path: PathLike, file: _File, needed: Need) -> _File:
    if file.metadata.get("drive") != needed.network_drive.digest:
        raise IrtError(
            f"{path}: trained for another drive (commands, start, board, ranges or engine); "
            "train one for this rig with 'irt pretrain --rig', or leave --network out"
        )
    return file
