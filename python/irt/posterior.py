"""How probable which values of a model are: sets of effects, and a distribution of the values of each."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irt import catalogue
from irt.errors import IrtError, located, unknown_name
from irt.files import TomlTable
from irt.rig import PARAMETERS
from irt.values import Effect, Parameter

Array = NDArray[np.float64]

#: The one entry of ``[board]`` that a diagnosis estimates along with the parameters.
SPINNING = "board.spinning_friction"
#: Independent proposals of one batch, and batches before a random walk; sweeps of that over all z.
_BATCH, _BATCHES, _SWEEPS = 64, 64, 16
#: By how much the probabilities of a file may miss 1 together.
_ROUNDED = 1e-3


@dataclass(frozen=True)
class Spread:
    """The distribution of one parameter, as a function of standard normal numbers z that it shares.

    A draw is ``(value + linear . z) * exp(power . z)``. Where recordings pin a combination of parameters
    down, it moves linearly. Where they do not, parameters change in proportion to powers of one factor, as
    the symmetries of the motion have it: gears times L with the time scale over the square root of L.

    Attributes
    ----------
    value : float
        At z = 0, in the parameter's own unit.
    low, high : float
        Draws with a value outside are discarded.
    linear, power : tuple of float
        Both as long as there are z; empty for a parameter that is held.
    """

    value: float
    low: float = -math.inf
    high: float = math.inf
    linear: tuple[float, ...] = ()
    power: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.value, *self.linear, *self.power))):
            raise IrtError("expected finite numbers")
        if not self.low <= self.value <= self.high:
            raise IrtError(f"the value {self.value:g} lies outside its bounds, {self.low:g} to {self.high:g}")
        if len(self.linear) != len(self.power):
            raise IrtError(
                f"linear has {len(self.linear)} numbers, power {len(self.power)}: expected as many"
            )


@dataclass(frozen=True)
class Component:
    """A set of effects that may be the true one, and the distribution of its values.

    Attributes
    ----------
    probability : float
        Of the set; those of a posterior add up to 1.
    effects : tuple of str
        What is added to the base simulation.
    parameters : dict of Spread
        By name: the five, ``effect.parameter``, and ``board.spinning_friction``. Those left out are as the
        model has them.

    Raises
    ------
    IrtError
        For an unknown name, or lists of different lengths.
    """

    probability: float
    effects: tuple[str, ...]
    parameters: dict[str, Spread]
    _stacked: tuple[Array, Array, Array, Array] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.probability <= 1.0 + _ROUNDED:
            raise IrtError(f"probability: expected a number above 0, at most 1, found {self.probability:g}")
        for name in self.parameters:
            _check_name(name, self.effects)
        lengths = {len(one.linear) for one in self.parameters.values() if one.linear}
        if len(lengths) > 1:
            raise IrtError(f"lists of {' and '.join(map(str, sorted(lengths)))} numbers: expected one length")
        count = lengths.pop() if lengths else 0
        spreads = list(self.parameters.values())
        stacked = (
            np.array([one.value for one in spreads]),
            np.array([[one.low, one.high] for one in spreads]).reshape(len(spreads), 2),
            np.array([one.linear or (0.0,) * count for one in spreads]).reshape(len(spreads), count),
            np.array([one.power or (0.0,) * count for one in spreads]).reshape(len(spreads), count),
        )
        object.__setattr__(self, "_stacked", stacked)

    @property
    def size(self) -> int:
        """How many z there are."""
        return int(self._stacked[2].shape[1])

    @property
    def is_point(self) -> bool:
        """Whether all draws are the same."""
        _, _, linear, power = self._stacked
        return not (linear.any() or power.any())

    def draw(self, random: np.random.Generator) -> dict[str, float]:
        """Draw values of all its parameters by name.

        Raises
        ------
        IrtError
            If next to no draw lies within the bounds.
        """
        for _ in range(_BATCHES):
            found, inside = self._at(random.standard_normal((_BATCH, self.size)))
            if inside.any():
                return dict(zip(self.parameters, found[int(np.argmax(inside))].tolist(), strict=True))
        return dict(zip(self.parameters, self.walked(random).tolist(), strict=True))

    def _at(self, z: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the values of all parameters at (n, k) z, and whether they lie within all bounds."""
        value, bounds, linear, power = self._stacked
        # A draw that overflows lies within no bounds.
        with np.errstate(over="ignore", invalid="ignore"):
            found = (value + z @ linear.T) * np.exp(z @ power.T)
        inside = (bounds[:, 0] <= found) & (found <= bounds[:, 1])
        return found, np.asarray(inside.all(axis=1))

    def walked(self, random: np.random.Generator) -> Array:
        """Return values within the bounds by a random walk from z = 0, which lies within them.

        Where many parameters are near a bound, hardly any independent draw is within all of them. Each step
        replaces z along one direction by a new standard normal number, and stays if that leads out: a
        Metropolis step, whose distribution is the normal one within the bounds. Directions are the axes, on
        which bounds hold a few parameters, and random ones, along which they move together.
        """
        count = self.size
        z, here = np.zeros(count), None
        for step in range(2 * _SWEEPS * count):
            along = np.zeros(count)
            if step % 2:
                along[(step // 2) % count] = 1.0
            else:
                along = random.standard_normal(count)
                along /= np.linalg.norm(along)
            there = z + (random.standard_normal() - along @ z) * along
            found, inside = self._at(there[None])
            if inside[0]:
                z, here = there, found[0]
        if here is None:
            named = " + ".join(self.effects) or "the five parameters"
            raise IrtError(
                f"posterior of {named}: no draw lies within the bounds of all parameters; fit again"
            )
        return np.asarray(here)


def draws(
    components: Sequence[Component], count: int, seed: int
) -> Iterator[tuple[Component, dict[str, float]]]:
    """Yield sets of effects by their probability, each with values of its parameters.

    Draw i is the same for every count.

    Raises
    ------
    IrtError
        If there is nothing to draw from.
    """
    if not components:
        raise IrtError(
            "the model has no posterior to sample from ([[posterior]] in model.toml): fit again with "
            "irt tune or irt diagnose, which write one"
        )
    check_posterior(components)
    chances = np.cumsum([one.probability for one in components])
    for index in range(count):
        random = np.random.default_rng([seed, index])
        chosen = components[
            int(np.searchsorted(chances[:-1], random.uniform(0.0, chances[-1]), side="right"))
        ]
        yield chosen, chosen.draw(random)


def check_posterior(components: Sequence[Component]) -> None:
    """Raise unless the probabilities add up to 1 and there is more than one point to draw.

    Raises
    ------
    IrtError
        Otherwise.
    """
    if not components:
        return
    total = sum(one.probability for one in components)
    if abs(total - 1.0) > _ROUNDED:
        raise IrtError(f"posterior: the probabilities add up to {total:g}, expected 1")
    if len(components) == 1 and components[0].is_point:
        raise IrtError(
            "posterior: it holds one point, of which every draw would be the same model; remove "
            "[[posterior]], or fit again"
        )


def read_posterior(table: TomlTable) -> tuple[Component, ...]:
    """Return the sections ``[[posterior]]`` of a model.

    Raises
    ------
    IrtError
        If one is not as it must be; the message names section and key.
    """
    found = []
    for entry in table.sections("posterior"):
        entry.only("key", ("probability", "effects", "parameters"))
        effects = entry.content.get("effects", [])
        if not isinstance(effects, list) or not all(isinstance(name, str) for name in effects):
            raise entry.error("effects", f"expected a list of names, found {effects}")
        section = entry.section("parameters")
        parameters = {name: _read_spread(section, name) for name in section.content}
        with located(entry.where):
            for name in effects:
                catalogue.effect(name)
            found.append(Component(entry.number("probability"), tuple(effects), parameters))
    with located(table.where):
        check_posterior(found)
    return tuple(found)


def _read_spread(section: TomlTable, name: str) -> Spread:
    if not isinstance(section.content[name], dict):
        return Spread(section.number(name))
    table = section.inline(name, "")
    table.only("key", ("value", "low", "high", "linear", "power"))
    lists = {key: table.series(key) for key in ("linear", "power") if key in table}
    count = max(map(len, lists.values()), default=0)
    with located(table.where):
        return Spread(
            table.number("value"),
            **table.numbers("low", "high", infinite=True),
            linear=lists.get("linear", (0.0,) * count),
            power=lists.get("power", (0.0,) * count),
        )


def posterior_lines(components: Sequence[Component]) -> Iterator[str]:
    """Yield the lines of the sections ``[[posterior]]``; floats read back as the same numbers."""
    for one in components:
        yield f"\n[[posterior]]\nprobability = {float(one.probability)!r}"
        yield f"effects = {json.dumps(list(one.effects))}\n[posterior.parameters]"
        for name, spread in one.parameters.items():
            key = name if "." not in name else json.dumps(name)
            if spread == Spread(spread.value):
                yield f"{key} = {float(spread.value)!r}"
                continue
            parts = [f"{end} = {float(getattr(spread, end))!r}" for end in ("value", "low", "high")]
            shown = {"linear": spread.linear, "power": spread.power if any(spread.power) else ()}
            parts += [
                f"{kind} = [{', '.join(repr(float(number)) for number in numbers)}]"
                for kind, numbers in shown.items()
                if numbers
            ]
            yield f"{key} = {{ {', '.join(parts)} }}"


def rounded(numbers: Array) -> tuple[float, ...]:
    """Return numbers to the six digits that a file holds."""
    return tuple(float(f"{number:g}") for number in numbers)


def _check_name(name: str, effects: Sequence[str]) -> None:
    if name in PARAMETERS or name == SPINNING:
        return
    of_effect, _, parameter = name.partition(".")
    if of_effect not in effects:
        raise unknown_name("parameter", name, (*PARAMETERS, SPINNING, *effects))
    known = [one.name for one in catalogue.effect(of_effect).parameters]
    if parameter not in known:
        raise unknown_name(f"parameter of {of_effect}", parameter, known)


def drawn_parameters(parameters: Mapping[str, Parameter], found: Mapping[str, float]) -> dict[str, Parameter]:
    """Return the five parameters of a draw, without intervals."""
    return {name: Parameter(found.get(name, one.value)) for name, one in parameters.items()}


def drawn_effects(
    effects: Sequence[Effect], drawn: Component, found: Mapping[str, float]
) -> tuple[Effect, ...]:
    """Return the effects of a draw; what the posterior does not name is as the model has it."""
    own = {one.name: one.parameters for one in effects}

    def of(name: str) -> dict[str, float]:
        begin = f"{name}."
        return {key.removeprefix(begin): one for key, one in found.items() if key.startswith(begin)}

    return tuple(Effect(name, {**own.get(name, {}), **of(name)}) for name in drawn.effects)
