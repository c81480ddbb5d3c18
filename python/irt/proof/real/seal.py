"""The tilt under seal: a copy of the rig without it for the diagnosis, and hashes that show the order.

``blind/`` is the rig as the diagnosis reads it. ``seal.json`` is written before the diagnosis and holds the
SHA-256 of each recording with its tilt and of each file of the copy; ``answer.json`` is written after it,
before anything is compared with the tilt, and holds the SHA-256 of the seal and of all models of the answer.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.files import make_folder, read_json, write_atomic
from irt.measured_tilt import has_both_tilts
from irt.proof.seal import canonical, digest, digests
from irt.recording import Recording
from irt.rig import Rig, load_rig
from irt.segments import SETTLING_S
from irt.tilt_errors import is_comparable

#: The file of a rig that is copied as it is; a section ``[tilt]`` says only what the sensor reads.
_RIG = "rig.toml"


@dataclass(frozen=True)
class Folders:
    """The paths of a proof on a real rig.

    Attributes
    ----------
    out : Path
        Its folder.
    """

    out: Path

    @property
    def blind(self) -> Path:
        """The rig without the tilt: all that the diagnosis reads."""
        return self.out / "blind"

    @property
    def seal(self) -> Path:
        """The hashes from before the diagnosis."""
        return self.out / "seal.json"

    @property
    def diagnosis(self) -> Path:
        """The results of the diagnosis, with its own report."""
        return self.out / "diagnosis"

    @property
    def models(self) -> Path:
        """The models of the answer that are compared with the tilt."""
        return self.out / "answer"

    @property
    def answer(self) -> Path:
        """The hashes from after the diagnosis."""
        return self.out / "answer.json"

    @property
    def results(self) -> Path:
        """The comparison, as numbers."""
        return self.out / "proof.json"


def measured(rig: Rig) -> Rig:
    """Return a rig whose recordings all have stamps and a tilt measured about both axes.

    Raises
    ------
    IrtError
        Otherwise, with one line that says which recording lacks what.
    """
    lacking = [one.name for one in rig.recordings if not has_both_tilts(one)]
    if len(lacking) == len(rig.recordings):
        raise IrtError(
            f"{rig.path}: no tilt measured about both axes (columns tilt_x_rad, tilt_y_rad), which is the "
            "label of this proof; record it, or prove on simulated rigs with 'irt prove'"
        )
    if lacking:
        raise IrtError(
            f"{rig.path}: {', '.join(lacking)}: the tilt is not measured about both axes, as it is in the "
            "other recordings; leave these files out, or add the columns tilt_x_rad and tilt_y_rad"
        )
    unstamped = [one.name for one in rig.recordings if one.stamps is None]
    if unstamped:
        raise IrtError(
            f"{rig.path}: {', '.join(unstamped)}: no stamps; add a column t_s, without which a delay has no "
            "seconds"
        )
    short = [one.name for one in rig.recordings if not is_comparable(one)]
    if short:
        raise IrtError(
            f"{rig.path}: {', '.join(short)}: no tilt about both axes after the first {SETTLING_S:g} s, in "
            "which commands before the recording still act; leave these files out"
        )
    rig.of_marbles()
    return rig


def without_tilt(recording: Recording) -> Recording:
    """Return what the diagnosis sees of a recording: commands, stamps and marble."""
    return replace(recording, tilt=None)


def seal(folders: Folders, rig: Rig, code: str) -> Rig:
    """Write the copy without the tilt and the seal, unless they exist, and return the rig of the copy.

    Parameters
    ----------
    folders : Folders
        Where to write.
    rig : Rig
        The rig with its tilt, from a folder.
    code : str
        Version and digest of the package.

    Raises
    ------
    IrtError
        If the folder holds the proof of another rig.
    """
    make_folder(folders.out)
    hashes = {path.name: digest(path.read_bytes()) for path in _files(rig)}
    if folders.seal.exists():
        if read_json(folders.seal)["recordings"] != hashes:
            raise IrtError(
                f"{folders.out}: holds the proof of another rig or other recordings; choose another --out"
            )
    else:
        shutil.rmtree(folders.blind, ignore_errors=True)
        make_folder(folders.blind)
        for name, data in _blind_files(rig).items():
            write_atomic(folders.blind / name, data)
        content = {"rig": f"{rig.path}", "recordings": hashes, "blind": digests(folders.blind), "code": code}
        write_atomic(folders.seal, canonical(content))
    return load_rig(folders.blind)


def close(folders: Folders) -> None:
    """Write the hashes of the answer, after which the tilt may be read."""
    content = {"seal": digest(folders.seal.read_bytes()), "models": digests(folders.models)}
    write_atomic(folders.answer, canonical(content))


def is_real(out: Path) -> bool:
    """Return whether a folder holds a proof on a real rig."""
    return Folders(out).seal.exists()


def verify(out: Path) -> str:
    """Check a proof on a real rig, and return a sentence about what was checked.

    Checks the seal, the copy without the tilt and the answer, and, where the rig is still in its place, that
    the copy holds the commands and the marble of its recordings, and nothing else.

    Raises
    ------
    IrtError
        If a file was altered or is missing.
    """
    folders = Folders(out)
    sealed: dict[str, Any] = read_json(folders.seal)
    answer = read_json(folders.answer)
    if answer["seal"] != digest(folders.seal.read_bytes()):
        raise IrtError(f"{folders.seal}: not the seal of this answer: it was altered afterwards")
    if answer["models"] != digests(folders.models):
        raise IrtError(
            f"{folders.models}: not the models of {folders.answer.name}: they were altered afterwards"
        )
    if sealed["blind"] != digests(folders.blind):
        raise IrtError(f"{folders.blind}: not the recordings of the seal: they were altered")
    count = len(sealed["recordings"]) - (_RIG in sealed["recordings"])
    said = f"{count} recordings: seal, copy without tilt and answer are unchanged"
    place = Path(sealed["rig"])
    if not place.is_dir():
        return f"{said}; the rig is not at {place}, so the copy was not compared with it"
    rig = load_rig(place)
    if sealed["recordings"] != {path.name: digest(path.read_bytes()) for path in _files(rig)}:
        raise IrtError(f"{place}: not the recordings of the seal: they were altered")
    if sealed["blind"] != {name: digest(data) for name, data in _blind_files(rig).items()}:
        raise IrtError(f"{folders.blind}: not the recordings of {place} without their tilt")
    return f"{said}, and the copy is the rig without its tilt"


def _files(rig: Rig) -> list[Path]:
    """Return the files of a rig: its recordings, and ``rig.toml`` where there is one."""
    toml = rig.path / _RIG
    return [*([toml] if toml.exists() else []), *(one.path for one in rig.recordings)]


def _blind_files(rig: Rig) -> dict[str, bytes]:
    """Return the files of the copy: recordings of marbles without their tilt, and ``rig.toml``."""
    toml = rig.path / _RIG
    files = {_RIG: toml.read_bytes()} if toml.exists() else {}
    for one in rig.recordings:
        if one.has_marble:
            files[one.path.name] = without_tilt(one).to_csv().encode()
    return files
