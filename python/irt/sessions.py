"""Several sessions of one rig: folders of recordings that share everything but the day."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from irt import arguments
from irt.errors import IrtError
from irt.files import PathLike
from irt.rig import Rig, as_rig, default_ranges


@arguments.entry
def pool(rigs: Sequence[Rig | PathLike]) -> Rig:
    """Return one rig with the recordings of several sessions, named ``session/recording``.

    Parameters
    ----------
    rigs : sequence of Rig or path
        At least two, whose board, marble, commands and ranges are the same.

    Raises
    ------
    IrtError
        If they are fewer, two have one name, or what is known of the rig differs.
    """
    if isinstance(rigs, str | bytes | Rig) or not isinstance(rigs, Sequence) or len(rigs) < 2:
        raise IrtError(f"rigs: expected at least two sessions of one rig, got {arguments.shown(rigs)}")
    found = [as_rig(one) for one in rigs]
    names = [_name(one) for one in found]
    for index, name in enumerate(names):
        if name in names[:index]:
            raise IrtError(f"rigs: two sessions have the name {name}; rename one of the folders")
    # Ranges that nobody gave follow the commands: those of the sessions together hold for all of them.
    together = default_ranges([run for one in found for run in one.recordings])
    found = [replace(one, ranges=_ranges(one, together)) for one in found]
    first = found[0]
    for other, name in zip(found[1:], names[1:], strict=True):
        _check_same(first, names[0], other, name)
    recordings = tuple(
        replace(recording, name=f"{name}/{recording.name}")
        for name, one in zip(names, found, strict=True)
        for recording in one.recordings
    )
    return replace(first, path=Path("+".join(names)), recordings=recordings)


def session_of(recording: str) -> str:
    """Return the session of a pooled recording by its name; empty for one of no session."""
    return recording.rpartition("/")[0]


def _ranges(rig: Rig, together: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Return the ranges of a session, those that are its defaults as they are of all sessions together."""
    own = default_ranges(rig.recordings)
    return {name: together[name] if ends == own[name] else ends for name, ends in rig.ranges.items()}


def _name(rig: Rig) -> str:
    return rig.path.resolve().name


def _check_same(first: Rig, name: str, other: Rig, other_name: str) -> None:
    for part in [one.name for one in fields(Rig) if one.name not in ("path", "recordings")]:
        entries, others = (_entries(getattr(rig, part)) for rig in (first, other))
        for key, value in entries.items():
            if others[key] != value:
                what = f"{part}, {key}" if key else part
                raise IrtError(
                    f"{other_name}: {what} is {others[key]}, and in {name} {value}; sessions of one rig need "
                    "the same rig.toml"
                )


def _entries(value: Any) -> dict[str, Any]:
    """Return what a part of a rig says, by its keys."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return dict(value) if isinstance(value, dict) else {"": value}
