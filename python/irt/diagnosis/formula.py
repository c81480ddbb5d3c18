"""The formula of a learned correction, and the variables that it depends on."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence

from irt.diagnosis.basis import BOUNDED, ROUND, SHAPES
from irt.diagnosis.terms import AT_RIM, BRAKE, GEARS, GROWTHS, PROFILES, PUSH, TURNS, VECTORS, of_slot

#: Vector components and profiles below this share of the largest are omitted from a formula.
LITTLE = 1e-2

#: Symbols of the variables by parameter name, and functions of the profiles by shape.
_SYMBOLS = dict(
    zip(
        itertools.chain(*VECTORS.values()),
        ("x", "y", "v_x", "v_y", "cos heading", "sin heading", "tilt_x", "tilt_y", "t", "L"),
        strict=True,
    )
)
_FUNCTIONS = (
    "cos({})",
    "tanh({})",
    "exp(-({})^2/2)",
    "ridge({})",
    "exp(-(({})^2 + ({})^2)/2)",
    "({})",
    "({})^2",
    "({}) ({})",
)


def formula(values: dict[str, float]) -> str:
    """Return the learned correction as a formula in SI units, without negligible parts."""
    values = cleared(values)
    parts, drags, slots = [], [], _profiles(values)
    for slot in slots:
        push, brake, gears = _push(values, slot), values[f"brake_{slot}_m_per_s2"], _gears(values, slot)
        profile = _profile(values, slot)
        if any(push):
            parts.append(f"{_vector(push)} {profile}")
        if any(gears):
            # A turn about y pushes along x, a turn about x against y.
            parts.append(f"5/7 g {_vector((gears[1], -gears[0]), ('tilt_y ', 'tilt_x '))} {profile}")
        if brake:
            drags.append(f"{brake:.3g} {profile}")
    if values["drag_strength"]:
        drags.insert(0, f"{values['drag_strength']:.3g}")
    if drags:
        drag = " + ".join(drags).replace("+ -", "- ")
        parts.append(f"-({drag}){_of_speed(values['drag_power'])} along v")
    if values["side_strength"]:
        parts.append(f"{values['side_strength']:.3g}{_of_speed(values['side_power'])} across v")
    if values["mode_gain"]:
        rate, damping = values["mode_rate_rad_per_s"], values["mode_damping"]
        parts.append(
            f"5/7 g {values['mode_gain']:.3g} (u - tilt), u'' = {rate**2:.4g} (tilt - u) "
            f"- {2.0 * damping * rate:.3g} u'"
        )
    if values["yield_lag_s"]:
        parts.append(_yielding(values))
    shapes = {round(values[f"shape_{slot}"]) for slot in slots}
    what = ", ridge(s) = -s exp((1 - s^2)/2)" if SHAPES.index("ridge") in shapes else ""
    pushes = [("a = " + " + ".join(parts)).replace("+ -", "- ") + what] if parts else []
    return "; ".join([*pushes, *_at_rim(values), *_picture(values)])


def _yielding(values: dict[str, float]) -> str:
    """Return the push by a drive that follows late and yields; a share of zero is omitted."""
    drives = []
    for axis in "xy":
        share, slowness = values[f"yield_{axis}"], values[f"yield_{axis}_s_per_rad"]
        kept = f" (1 - {share:.3g} (1 - exp(-({slowness:.3g} w_{axis}')^2/2)))" if share and slowness else ""
        drives.append(f"w_{axis}{kept}".replace("- -", "+ "))
    # A turn about y pushes along x, a turn about x against y.
    x, y = drives
    return f"5/7 g (({y} - tilt_y) e_x - ({x} - tilt_x) e_y), w' = (tilt - w) / {values['yield_lag_s']:.3g}"


def _at_rim(values: dict[str, float]) -> Iterator[str]:
    """Yield the forces on a marble that touches the rim; a negative one is none."""
    hold, brake, drag = (max(0.0, values[name]) for name in AT_RIM)
    slows = [f"{brake:.3g}"] if brake else []
    slows += [f"{drag:.3g} v"] if drag else []
    parts = [f"{hold:.3g} against leaving it"] if hold else []
    parts += [f"-({' + '.join(slows)}) along v"] if slows else []
    if parts:
        yield f"at the rim: a = {' and '.join(parts)}"


def _picture(values: dict[str, float]) -> Iterator[str]:
    """Yield the angle and the growth of the picture as functions of the tilt; zeros are omitted."""
    for what, names in (("angle of the picture", TURNS), ("growth of the picture", GROWTHS)):
        rates = [(values[name], symbol) for name, symbol in zip(names, ("tilt_x", "tilt_y"), strict=True)]
        if any(value for value, _ in rates):
            yield f"{what} = {_sum(rates, 0.0)}"


def _vector(components: Sequence[float], factors: Sequence[str] = ("", "")) -> str:
    """Return a vector along the board's axes e_x and e_y as text; zeros are omitted."""
    parts = [
        f"{value:.3g} {factor}e_{axis}"
        for value, factor, axis in zip(components, factors, "xy", strict=True)
        if value != 0.0
    ]
    return parts[0] if len(parts) == 1 else f"({' + '.join(parts)})".replace("+ -", "- ")


def _of_speed(power: float) -> str:
    """Return a power of the speed as a factor; nothing for the power 0."""
    shown = f"{power:z.2g}"
    return "" if shown == "0" else f" (v / 0.1 m/s)^{shown}"


def cleared(values: dict[str, float]) -> dict[str, float]:
    """Return values with negligible parts set to zero.

    These are vector components that are negligible relative to the other axis, and bounded profiles (waves,
    steps, bells, ridges, spots) that are negligible relative to others. Polynomials are unbounded and kept.
    """
    kept, slots = dict(values), range(1, PROFILES + 1)
    for slot in slots:
        for names in (PUSH, GEARS, *VECTORS.values()):
            _clear(kept, [[of_slot(name, slot)] for name in names])
    _clear(kept, [[name] for name in (*TURNS, *GROWTHS)])
    bounded = [slot for slot in slots if SHAPES[round(values[f"shape_{slot}"])] in BOUNDED]
    for names in (PUSH, GEARS, (BRAKE,)):
        _clear(kept, [[of_slot(name, slot) for name in names] for slot in bounded])
    return kept


def _clear(values: dict[str, float], groups: Sequence[Sequence[str]]) -> None:
    """Set groups to zero that are negligible relative to the largest group."""
    sizes = [max(abs(values[name]) for name in group) for group in groups]
    for group, size in zip(groups, sizes, strict=True):
        if size < LITTLE * max(sizes):
            values.update(dict.fromkeys(group, 0.0))


def variables(values: dict[str, float]) -> list[str]:
    """Return the names of the variables that the learned push depends on."""
    values = cleared(values)
    slots = _profiles(values)
    gears = [_gears(values, slot) for slot in slots]
    plain = {"command": "tilt", "way": "path length"}
    found = [
        plain.get(variable, variable)
        for variable, names in VECTORS.items()
        if any(values[of_slot(name, slot)] != 0.0 for slot in slots for name in names)
        or (variable == "command" and (values["mode_gain"] or values["yield_lag_s"] or any(map(any, gears))))
    ]
    drags = [values["drag_strength"], *(values[f"brake_{slot}_m_per_s2"] for slot in slots)]
    found += ["rate of the tilt"] if values["yield_lag_s"] else []
    return [*found, *(["speed"] if any(drags) or values["side_strength"] else [])]


def turns(values: Mapping[str, float]) -> bool:
    """Whether the picture turns or grows with the tilt."""
    return any(values[name] != 0.0 for name in (*TURNS, *GROWTHS))


def holds_or_brakes(values: Mapping[str, float]) -> bool:
    """Whether the rim holds or brakes a marble that touches it."""
    return any(values[name] > 0.0 for name in AT_RIM)


def _profile(values: dict[str, float], slot: int) -> str:
    """Return a profile as text, as a function of its variables."""
    shape = round(values[f"shape_{slot}"])
    symbols = [(values[of_slot(name, slot)], symbol) for name, symbol in _SYMBOLS.items()]
    phases = [_sum(symbols, values[f"phase_{slot}_rad"])]
    if SHAPES[shape] in ROUND:
        across = []
        for variable in ("position", "command"):
            x, y = (of_slot(name, slot) for name in VECTORS[variable])
            of_x, of_y = (_SYMBOLS[name] for name in VECTORS[variable])
            across += [(-values[y], of_x), (values[x], of_y)]
        phases.append(_sum(across, values[f"across_{slot}_rad"]))
    return _FUNCTIONS[shape].format(*phases)


def _sum(symbols: Sequence[tuple[float, str]], phase: float) -> str:
    """Return a linear combination of symbols plus a phase as text; zeros are omitted."""
    parts = [f"{value:.4g} {symbol}" for value, symbol in symbols if value != 0.0]
    if phase != 0.0 or not parts:
        parts.append(f"{phase:.3g}")
    return " + ".join(parts).replace("+ -", "- ")


def _push(values: dict[str, float], slot: int) -> list[float]:
    return [values[f"push_{slot}_{axis}_m_per_s2"] for axis in "xy"]


def _gears(values: dict[str, float], slot: int) -> list[float]:
    return [values[f"gear_{slot}_{axis}"] for axis in "xy"]


def _profiles(values: dict[str, float]) -> list[int]:
    """Return the slots of profiles with a push, a drag or a change of the gears."""
    return [
        slot
        for slot in range(1, PROFILES + 1)
        if any((*_push(values, slot), *_gears(values, slot), values[f"brake_{slot}_m_per_s2"]))
    ]
