"""Specification of a rig: all its properties, drawn from a seed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from . import drives, noise
from .controller import Controller
from .effects import EFFECTS
from .engine import Base, Engine
from .in_mujoco import MUJOCO
from .in_pybullet import PYBULLET
from .out_of_catalogue import BEYOND
from .physics import EDGE_X_M, EDGE_Y_M, RADIUS_M, Physics
from .played import Commands, Played, play

TRAIN, TEST = 8, 4
KINDS = ("none", "outliers", "single", "pair", "triple", "unlisted")
#: A rig is redrawn unless the hidden physics changes the path by this many times the noise.
SHOWS = 3.0
#: Runs that are simulated for this check, unless the first ones are below this part of the threshold.
PROBES, HOPELESS = (0, 3, 6, 9), 0.25
#: Draws until noise and parameters are redrawn too, and number of such redraws until magnitudes come from the
#: largest fifth of their range and noise from the smallest.
DRAWS, GROWS = 2, 9

#: The drive of a controller that sees the marble, and the share of rigs that have it.
CONTROLLED, CONTROLLED_SHARE = "controller", 1.0 / 3.0

ENGINES: dict[str, Engine] = {"pybullet": PYBULLET, "mujoco": MUJOCO}

_KNOWN = {one.name: one for one in (*EFFECTS, *BEYOND)}
_ORDER = list(_KNOWN)


@dataclass(frozen=True)
class Spec:
    """A rig; the same spec gives the same recordings, byte for byte.

    Attributes
    ----------
    name : str
        Neutral name of the rig.
    seed : int
        Seed of drives, starts, noise and random physics.
    gear_x, gear_y, rolling_friction, time_scale, observation_scale : float
        The five parameters, in the units of the recordings' format.
    effects : tuple of dict
        Hidden effects of the catalogue: name and parameters.
    out_of_catalogue : dict, optional
        Hidden physics outside the catalogue: name and parameters.
    outliers : float
        Share of rows with an outlier of the tracker.
    noise, sigma : str, float
        Kind of tracker noise, and its standard deviation [board edges].
    drive : str
        A kind of excitation, "mixed" for a kind by run, or "controller".
    starts : str
        "centre" or "anywhere", always at rest.
    through_camera : bool
        Whether the recording is read from rendered pictures.
    engine : {"pybullet", "mujoco"}
        What moves the marble.
    """

    name: str
    seed: int
    gear_x: float
    gear_y: float
    rolling_friction: float
    time_scale: float
    observation_scale: float
    effects: tuple[Mapping[str, Any], ...] = ()
    out_of_catalogue: Mapping[str, Any] | None = None
    outliers: float = 0.0
    noise: str = "white"
    sigma: float = 0.0
    drive: str = "mixed"
    starts: str = "anywhere"
    through_camera: bool = False
    engine: str = "pybullet"

    @property
    def base(self) -> Base:
        """The five parameters."""
        return Base(self.gear_x, self.gear_y, self.rolling_friction, self.time_scale, self.observation_scale)

    @property
    def hidden(self) -> tuple[Physics, ...]:
        """The hidden physics, in the order in which it acts."""
        return physics_of(
            self.effects if self.out_of_catalogue is None else (*self.effects, self.out_of_catalogue)
        )

    def random(self, run: int, what: int) -> np.random.Generator:
        """Return a run's generator of its drive (0), random physics (1), noise, outliers, controller (4)."""
        return np.random.default_rng([self.seed, run, what])

    @property
    def moved_by(self) -> Engine:
        """What moves the marble."""
        return ENGINES[self.engine]

    def excitation(self, run: int) -> tuple[Commands, tuple[float, float]]:
        """Return a run's commands as of `play`, and its start position [m]."""
        random, gears = self.random(run, 0), (self.gear_x, self.gear_y)
        kinds = list(drives.DRIVES)
        kind = kinds[int(random.integers(len(kinds)))] if self.drive == "mixed" else self.drive
        commands: Commands
        if kind == CONTROLLED:
            commands = Controller(gears, self.base.row_s, self.sigma, self.random(run, 4)), drives.ROWS
        else:
            commands = drives.drive(kind, random, gears, self.base.row_s)
        # With starts anywhere one run in four still begins in the centre, and the reverse.
        other = {"centre": "anywhere", "anywhere": "centre"}[self.starts]
        return commands, drives.start(other if run % 4 == 3 else self.starts, random)

    def play(self, run: int) -> Played:
        """Simulate a run."""
        commands, start_m = self.excitation(run)
        return play(self.base, commands, start_m, self.hidden, self.random(run, 1), engine=self.moved_by)

    def missed(self, run: int, played: Played, without: Sequence[str] = ()) -> float:
        """Return the distance of a run from the same run without some of its physics [board edges].

        The other run starts at the first tracked position, as any simulation does. Without names, all hidden
        physics is left out.
        """
        left = tuple(one for one in self.hidden if without and one.name not in without)
        _, start_m = self.excitation(run)
        if not left:
            room = np.array([EDGE_X_M, EDGE_Y_M]) / 2.0 - RADIUS_M
            seen = played.seen[0] * EDGE_X_M / self.observation_scale
            x, y = np.clip(seen, -room, room)
            start_m = float(x), float(y)
        plain = play(self.base, played.commands, start_m, left, self.random(run, 1), engine=self.moved_by)
        return float(np.abs(played.seen - plain.seen).mean())

    def to_json(self) -> dict[str, Any]:
        """Return the spec as JSON content."""
        return {**asdict(self), "effects": [dict(one) for one in self.effects]}


def physics_of(effects: Sequence[Mapping[str, Any]]) -> tuple[Physics, ...]:
    """Return physics from names and parameters, in the order in which it acts.

    Raises
    ------
    ValueError
        If a name or a parameter is not known.
    """
    for one in effects:
        if one.get("name") not in _KNOWN:
            raise ValueError(f"{one.get('name')!r} is no physics of this world: one of {', '.join(_ORDER)}")
    return tuple(
        _with(_KNOWN[one["name"]], one) for one in sorted(effects, key=lambda one: _ORDER.index(one["name"]))
    )


def _with(kind: type[Physics], values: Mapping[str, Any]) -> Physics:
    try:
        return kind(**{key: value for key, value in values.items() if key != "name"})
    except TypeError as error:
        raise ValueError(f"{kind.name}: {error}") from error


def draw(
    random: np.random.Generator,
    kind: str,
    name: str = "rig",
    physics: Sequence[str] = (),
    *,
    through_camera: bool = False,
    engine: str = "pybullet",
) -> Spec:
    """Draw a rig whose hidden physics changes the path noticeably.

    Parameters
    ----------
    random : Generator
        The same state gives the same rig.
    kind : str
        "none", "outliers", "single", "pair", "triple", "unlisted".
    name : str
        Name of the rig.
    physics : sequence of str
        Names of the physics to hide; drawn as well if empty.
    through_camera : bool
        Whether the recording is read from rendered pictures.
    engine : {"pybullet", "mujoco"}
        What moves the marble.

    Raises
    ------
    ValueError
        If a kind or a name is not known, or names do not fit the kind.
    """
    if engine not in ENGINES:
        raise ValueError(f"an engine is one of {', '.join(ENGINES)}, not {engine!r}")
    names = _names(random, kind, physics)
    for least in itertools.chain(np.linspace(0.0, 0.8, GROWS), itertools.repeat(0.8)):
        spec = _plain(random, name, 1.0 - float(least))
        spec = replace(spec, through_camera=through_camera, engine=engine)
        if kind == "outliers":
            return replace(spec, outliers=float(np.exp(random.uniform(np.log(0.005), np.log(0.05)))))
        for _ in range(DRAWS):
            strengths = random.uniform(least, 1.0, len(names)).tolist()
            drawn = [_KNOWN[one].draw(random, size) for one, size in zip(names, strengths, strict=True)]
            hidden = tuple(one.parameters() for one in drawn)
            spec = (
                replace(spec, out_of_catalogue=hidden[0])
                if kind == "unlisted"
                else replace(spec, effects=hidden)
            )
            if all(shows(spec, one) for one in names):
                return spec
    raise AssertionError("draws do not end")


def shows(spec: Spec, name: str) -> bool:
    """Return whether that physics changes the path noticeably, given the other hidden physics."""
    least = SHOWS * spec.sigma
    missed: list[float] = []
    for run in PROBES:
        missed.append(spec.missed(run, spec.play(run), [name]))
        if float(np.mean(missed)) < HOPELESS * least:
            return False
    return float(np.mean(missed)) > least


def _names(random: np.random.Generator, kind: str, physics: Sequence[str]) -> list[str]:
    if kind not in KINDS:
        raise ValueError(f"a kind of rig is one of {', '.join(KINDS)}, not {kind!r}")
    count = {"single": 1, "pair": 2, "triple": 3, "unlisted": 1}.get(kind, 0)
    possible = [one.name for one in (BEYOND if kind == "unlisted" else EFFECTS)]
    unknown = [one for one in physics if one not in possible]
    if unknown or (physics and len(set(physics)) != count):
        raise ValueError(f"{kind}: {count} of {', '.join(possible)}, not {', '.join(physics)}")
    return list(physics) or [str(one) for one in random.choice(possible, count, replace=False)]


def _plain(random: np.random.Generator, name: str, most: float = 1.0) -> Spec:
    gear_x, gear_y = random.uniform(0.04, 0.1, 2)
    return Spec(
        name=name,
        seed=int(random.integers(2**62)),
        gear_x=float(gear_x),
        gear_y=float(gear_y),
        rolling_friction=float(random.uniform(2e-4, 9e-4)),
        time_scale=float(random.integers(14, 26)),
        observation_scale=float(random.uniform(0.94, 1.06)),
        noise=noise.kind(random),
        sigma=noise.size(random, most),
        drive=_drive(random),
        starts="anywhere" if random.random() < 0.6 else "centre",
    )


def _drive(random: np.random.Generator) -> str:
    if random.random() < CONTROLLED_SHARE:
        return CONTROLLED
    return "mixed" if random.random() < 0.7 else str(random.choice(list(drives.DRIVES)))
