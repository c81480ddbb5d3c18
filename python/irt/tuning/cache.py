"""Which network a rig needs, and where it is: shipped with the package or in the user's cache."""

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
#: Of a network of IRT+ that is trained when it is needed: minutes, and near enough for Gauss-Newton.
SAMPLES = 400_000

#: Methods that need a network.
Networked = Literal["irt", "irt+", "direct"]


@dataclass(frozen=True, eq=False)
class Need:
    """The network that a rig needs.

    Attributes
    ----------
    segments : list of Segment
        What is predicted of the rig.
    rig_drive : Drive
        What is simulated of the rig: every run.
    network_drive : Drive
        What the network is for: the paper's single run, which serves each of the rig's, or all runs at once.
    """

    segments: list[Segment]
    rig_drive: Drive
    network_drive: Drive

    @property
    def joint(self) -> bool:
        """Whether the network sees all runs at once."""
        return self.network_drive is self.rig_drive

    def path(self, method: Networked = "irt") -> Path:
        """Return where the network of a method is, or will be once it is trained."""
        shipped = {"irt": SHIPPED, "irt+": SHIPPED_STEPS}.get(method)
        if shipped and shipped.exists() and self.network_drive.digest == Drive.paper().digest:
            return shipped
        chosen = _streamed() if method == "irt+" else _recipe(method)
        recipe = json.dumps(asdict(chosen), sort_keys=True)
        key = hashlib.sha256(f"{self.network_drive.digest} {recipe}".encode()).hexdigest()
        return cache_folder() / f"{_STEMS[method]}-{key[:16]}.safetensors"


def need(rig: Rig, engine: Engine = "rolling") -> Need:
    """Return which network a rig needs under an engine.

    Recordings under the paper's drive share the paper's network. For any other rig the drive is the whole set
    of its recordings, and one joint network sees them all.
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
    """Return the network that is needed, trained now and kept in the cache if there is none yet.

    Parameters
    ----------
    needed : Need
        From `need`.
    path : path, optional
        A network file to use instead.
    task : {"difference", "parameters"}
        Of the paper's method, or of direct prediction.
    threads : int, optional
        Of the simulations.
    progress : callable, optional
        Called with (done, total, text).

    Raises
    ------
    IrtError
        If the file named is broken or was trained for another drive or task, the cache cannot be written, or
        a network has to be trained and PyTorch is not installed.
    """
    method: Networked = "irt" if task == "difference" else "direct"

    def load(path: PathLike) -> NetworkFile:
        file = _for_drive(path, load_network(path), needed)
        if (found := file.metadata.get("task", "difference")) != task:
            raise IrtError(
                f"{path}: trained to tell {found}, not {task}; "
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
    """Return the network of IRT+ that is needed, as `obtain` does for the paper's method."""

    def load(path: PathLike) -> StepFile:
        return _for_drive(path, load_steps(path), needed)

    def train(**options: Any) -> StepFile:
        from irt.tuning.streaming import train_steps  # noqa: PLC0415  # loads torch

        return train_steps(needed.network_drive, recipe=_streamed(), **options)

    return _obtained(needed, "irt+", path, load, train, threads=threads, progress=progress)


def described(needed: Need, method: Networked, path: PathLike | None, trained: str) -> str:
    """Say which network it was: the one named, the one shipped, or the rig's own."""
    if path is not None:
        return f"The network is {path}: {trained}."
    if needed.path(method).parent == _DATA:
        return f"The network is the one shipped for the paper's drive: {trained}."
    return f"The network was made for this rig's drive and is kept in {needed.path(method)}: {trained}."


def require_training(method: Networked) -> None:
    """Check that a network can be trained here.

    Raises
    ------
    IrtError
        If PyTorch is not installed.
    """
    require("torch", f"--method {method} trains a network for this rig's drive, which")


def training_data(method: Networked) -> str:
    """Say what a network that is trained when it is needed learns from."""
    if method == "irt+":
        return f"{SAMPLES} pairs, simulated as it goes"
    return f"{_recipe(method).pairs} simulated pairs"


def cache_folder() -> Path:
    """Return the folder of trained networks: ``IRT_CACHE``, or where the platform keeps caches."""
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
        # One of another release, or broken, is no loss: it is only a cache.
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
