"""Which network a rig needs, and where it is: shipped with the package or in the user's cache."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from irt.errors import IrtError
from irt.files import PathLike, make_folder
from irt.fitting.fit import Progress
from irt.rig import Rig
from irt.rollouts import Engine
from irt.segments import Segment, segments
from irt.tuning.drive import Drive, is_paper_drive
from irt.tuning.pretrain import Recipe, checkpoint_path, pretrain
from irt.tuning.tunenet import NetworkFile, load_network

#: Trained by the command in its metadata.
SHIPPED = Path(__file__).resolve().parents[1] / "data" / "tunenet-paper.safetensors"


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

    @property
    def path(self) -> Path:
        """Where the network is, or will be once it is trained."""
        if SHIPPED.exists() and self.network_drive.digest == Drive.paper().digest:
            return SHIPPED
        recipe = json.dumps(asdict(Recipe()), sort_keys=True)
        key = hashlib.sha256(f"{self.network_drive.digest} {recipe}".encode()).hexdigest()
        return cache_folder() / f"tunenet-{key[:16]}.safetensors"


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
    threads : int, optional
        Of the simulations.
    progress : callable, optional
        Called with (done, total, text).

    Raises
    ------
    IrtError
        If the file named is broken or was trained for another drive, or the cache cannot be written.
    """
    if path is not None:
        return _load_for(path, needed.network_drive)
    path = needed.path
    if path.exists():
        if path == SHIPPED:
            return _load_for(path, needed.network_drive)
        with suppress(IrtError):
            return _load_for(path, needed.network_drive)
    try:
        make_folder(path.parent)
    except IrtError as error:
        raise IrtError(f"{error}; or set IRT_CACHE to a folder for trained networks") from error
    train = partial(
        pretrain, needed.network_drive, path, command="irt tune", threads=threads, progress=progress
    )
    if (checkpoint := checkpoint_path(path)).exists():
        # One of another release, or broken, is no loss: it is only a cache.
        with suppress(IrtError):
            return train(resume=True)
        checkpoint.unlink(missing_ok=True)
    return train()


def cache_folder() -> Path:
    """Return the folder of trained networks: ``IRT_CACHE``, or where the platform keeps caches."""
    if chosen := os.environ.get("IRT_CACHE"):
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "irt"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "irt" / "Cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "irt"


def _load_for(path: PathLike, drive: Drive) -> NetworkFile:
    file = load_network(path)
    if file.metadata.get("drive") != drive.digest:
        raise IrtError(
            f"{path}: trained for another drive (commands, start, board, ranges or engine); "
            "train one for this rig with 'irt pretrain --rig', or leave --network out"
        )
    return file
