"""Physics that no effect of the catalogue describes: found, learned as a formula, and put into the model.

The term of a library that explains most of what is left is fitted inside the simulator with everything else,
what is left then is looked at anew, and so on. Terms stay while recordings held out confirm them.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from irt.catalogue import effect
from irt.diagnosis import config
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.evidence import Evidence, excess, is_explained, is_most_left, is_trusted
from irt.diagnosis.heldout import hold_out, is_supported
from irt.diagnosis.impacts import shows
from irt.diagnosis.library import BRAKE, GEARS, PROFILES, PUSH, VECTORS, Term, in_slots, of_slot
from irt.diagnosis.profiles import BOUNDED, ROUND, SHAPES
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import PUSH as PUSH_SIZE
from irt.diagnosis.score import Scores, price
from irt.diagnosis.search import Search
from irt.diagnosis.several import Several
from irt.diagnosis.view import View, likely_terms, motion_seen
from irt.rig import PARAMETERS

#: A further term must take away this share of what was left beyond noise.
LEAST = 0.1
#: So many effects together may stand for one that has no name, even if they leave noise.
MANY = 3
#: What repeats needs neither chance nor three effects if one term explains so much of the motion.
REPEATABLE = 0.85
#: Where every effect alone leaves more than this share, so many terms of one family come before two effects.
STRANGE, TERMS = 0.75, 2
#: A formula leaves out what is less than this share of the largest: components of vectors, and profiles.
LITTLE = 1e-2
#: Effects that are believed give way only to what leaves so much of what they do.
HALF = 0.5

#: What a formula calls that which the parameters of a profile are multiplied by, and a profile of s.
_SYMBOLS = dict(
    zip(
        itertools.chain(*VECTORS.values()),
        ("x", "y", "v_x", "v_y", "cos heading", "sin heading", "tilt_x", "tilt_y", "t", "way"),
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

#: A case that holds what a fit did not move, the terms, and the fit.
Learned = tuple[Case, tuple[Term, ...], Fitted]


def learn(case: Case, base: Fitted, seen: View | None) -> Iterator[Learned]:
    """Fit the likeliest term of the library inside the simulator, then with it the likeliest of what is left.

    What is learned is taken from `seen`, the motion as it was observed (`irt.diagnosis.view.motion_seen`).

    Yields
    ------
    Learned
        With one term more each time.
    """
    terms: tuple[Term, ...] = ()
    held, learned = case, base
    while likely := likely_terms(held, seen, learned, terms):
        tried = [_added(case, learned, (*terms, one)) for one in likely]
        found = _best(case, tried)
        if not terms and is_most_left(case, found[-1], base):
            # Where two terms act whole runs hardly tell what one does alone; the motion itself does.
            found = tried[0]
        held, terms, begun = found
        # From where the terms before it led, and from the base model: slopes may lead astray.
        points = [[*one.values[: len(PARAMETERS)], *_values(learned, terms)] for one in (learned, base)]
        fitted = held.fit([UNLISTED], points=np.array(points[: len(terms)]), rounds=1)
        held, terms, learned = _best(case, [(held, terms, fitted), (held, terms, begun)])
        yield held, terms, learned
        if seen is not None:
            seen.take(terms[-1])


def _added(case: Case, learned: Fitted, terms: tuple[Term, ...]) -> Learned:
    """Refine what was learned with one term more, from where that term explains most."""
    return _refined(case, learned, terms, _values(learned, terms))


def _without(learned: Learned, index: int) -> Learned:
    """Refine what was learned without one of its terms."""
    case, terms, fitted = learned
    known, values = fitted.value_of(UNLISTED), _neutral()
    kept = [
        (term, now)
        for place, (term, now) in enumerate(zip(terms, in_slots(terms), strict=True))
        if place != index
    ]
    rest = tuple(term for term, _ in kept)
    for (_, now), then in zip(kept, in_slots(rest), strict=True):
        values |= {name: known[before] for name, before in zip(then.values, now.values, strict=True)}
    return _refined(case, fitted, rest, list(values.values()))


def _refined(case: Case, learned: Fitted, terms: tuple[Term, ...], values: list[float]) -> Learned:
    """Refine terms from these values of the engine's effect; what is of none of them stays as it is."""
    free = {name for term in in_slots(terms) for name in term.free}
    still = {name: value for name, value in zip(_neutral(), values, strict=True) if name not in free}
    held = case.holding(UNLISTED, still)
    return held, terms, held.refine([UNLISTED], np.array([[*learned.values[: len(PARAMETERS)], *values]]))[0]


def _values(learned: Fitted, terms: Sequence[Term]) -> list[float]:
    """Return the values of the engine's effect: what was learned, and the last term as it explains most."""
    known, (*before, last) = learned.value_of(UNLISTED), in_slots(terms)
    shared = {name for term in before for name in term.free}
    added = {name: value for name, value in last.values.items() if name not in shared}
    return list((_neutral() | known | added).values())


def _neutral() -> dict[str, float]:
    """Return the values without effect of all parameters of the engine's effect."""
    return {one.name: one.neutral for one in effect(UNLISTED).parameters}


def _best(case: Case, tried: Sequence[Learned]) -> Learned:
    """Return the likeliest, at the scale that the best of them leaves."""
    scale = max(case.noise, min(fitted.noise for *_, fitted in tried))
    return min(tried, key=lambda one: one[2].loss(scale))


@dataclass(eq=False)
class Library:
    """What can be learned without a name of the recordings of a search; found when it is first asked for."""

    search: Search

    @property
    def is_repeatable(self) -> bool:
        """Whether one term explains nearly all of the motion beyond noise."""
        return self._motion[1]

    @property
    def is_strange(self) -> bool:
        """Whether no effect alone does much, and pushes of one family explain nearly all of the motion.

        One effect of two does much more. The laws of speed are in the catalogue as well.
        """
        case, base = self.search.case, self.search.base
        least = min(excess(case, one) for one in self.search.ranked(1))
        seen = motion_seen(case, base) if least > STRANGE * excess(case, base) else None
        if seen is None:
            return False
        terms: list[Term] = []
        left = 1.0
        for _ in range(TERMS):
            likely = seen.likely(terms, 1)
            if not likely or likely[0].law is not None or (terms and likely[0].family != terms[0].family):
                break
            left *= 1.0 - seen.explains(likely[0])
            seen.take(likely[0])
            terms += likely
        return left < 1.0 - REPEATABLE

    def beyond(self, best: Fitted) -> Learned | None:
        """Return what was learned, if it beats a hypothesis of the catalogue."""
        learned = self._confirmed
        return learned if learned is not None and _is_preferred(self.search, learned[2], best) else None

    @functools.cached_property
    def _confirmed(self) -> Learned | None:
        """What was learned, as far as recordings held out agree.

        Terms stay as long as they are better than those before them; what is not may be so with the next one:
        of a board that is wavy both ways, one way alone predicts nothing.
        """
        search = self.search
        case, base = search.case, search.base
        kept: Learned | None = None
        before, held_before, doubted = base, search.held_out(base), False
        for fixed, terms, fitted in learn(case, base, self._motion[0]):
            search.report(f"a push that depends on {terms[-1].variable}")
            evidence = Evidence.of(case, [*search.fits.values(), fitted])
            between = replace(search.between_impacts, held=fixed.held)
            least = excess(case, fitted) < (1.0 - LEAST) * excess(case, before)
            seems = least and evidence.is_better(fitted, before) and shows(between, fitted, base)
            held = hold_out(fixed, fitted) if seems else None
            if held is not None and is_supported(held, held_before, evidence.scale):
                kept, before, held_before, doubted = (fixed, terms, fitted), fitted, held, False
            elif doubted:
                break
            else:
                doubted = True
            if is_explained(case, fitted, base):
                break
        if kept is None:
            return None
        needed = self._needed(kept)
        if needed is not kept:
            kept, held_before = needed, hold_out(needed[0], needed[2])
        search.remember(kept[2], held_before)
        return kept

    def _needed(self, learned: Learned) -> Learned:
        """Take away what later terms make needless: one that came early may only have stood in for them."""
        fits = self.search.fits.values()
        for index in reversed(range(len(learned[1]) - 1)):
            without = _without(learned, index)
            evidence = Evidence.of(learned[0], [*fits, learned[2], without[2]])
            if not evidence.is_better(learned[2], without[2]):
                learned = without
        return learned

    @functools.cached_property
    def _motion(self) -> tuple[View | None, bool]:
        """The motion as it was observed, of which what is learned is taken; and what `is_repeatable` says."""
        seen = motion_seen(self.search.case, self.search.base)
        if seen is None:
            return None, False
        return seen, any(seen.explains(one) > REPEATABLE for one in seen.likely((), 1))


def _is_preferred(search: Search, learned: Fitted, best: Fitted) -> bool:
    """Whether what was learned beats the catalogue's best hypothesis, and recordings held out agree.

    Effects that leave much of the mismatch are not believed, a wrong name is worse than none; but what was
    learned and explains less than they do is believed even less.
    """
    if not best.effects:
        return True
    evidence, case = search.evidence(), search.case
    if evidence.margin(learned, best) <= 0.0:
        return False
    if len(best.effects) >= MANY:
        return True
    if not is_explained(case, best, search.base) and not is_trusted(case, best, search.base):
        return True
    if excess(case, learned) > HALF * excess(case, best):
        return False
    return is_supported(search.held_out(learned), search.held_out(best), evidence.scale)


def is_more_probable(case: Case, learned: Fitted, terms: int, found: Several) -> bool:
    """Whether a learned push is likelier than a set of effects, by the same score.

    Each term is a choice from the library, as each effect is one from the catalogue.
    """
    scores = Scores(case)
    problem = scores.problem([UNLISTED])
    known = found.scored.values | dict(zip(learned.names, learned.values.tolist(), strict=True))
    values = np.array([known[name] for name in problem.names])
    noises = np.tile(found.scored.noise, (len(config.PUSHES), 1))
    noises[:, PUSH_SIZE] = config.PUSHES
    tops = scores.ascend([UNLISTED], np.tile(values, (len(noises), 1)), noises, iterations=config.THOROUGH)
    best = max(one.top.log_evidence for one in tops) - price(terms)
    return best > found.scored.score + config.SURE


def formula(values: dict[str, float]) -> str:
    """Return the learned push as a formula, in m/s^2, without what its terms have next to none of."""
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
        parts.append(f"-({drag}) (v / 0.1 m/s)^{values['drag_power']:.2g} along v")
    if values["side_strength"]:
        parts.append(f"{values['side_strength']:.3g} (v / 0.1 m/s)^{values['side_power']:.2g} across v")
    if values["mode_gain"]:
        rate, damping = values["mode_rate_rad_per_s"], values["mode_damping"]
        parts.append(
            f"5/7 g {values['mode_gain']:.3g} (u - tilt), u'' = {rate**2:.4g} (tilt - u) "
            f"- {2.0 * damping * rate:.3g} u'"
        )
    shapes = {round(values[f"shape_{slot}"]) for slot in slots}
    what = ", ridge(s) = -s exp((1 - s^2)/2)" if SHAPES.index("ridge") in shapes else ""
    return ("a = " + " + ".join(parts)).replace("+ -", "- ") + what


def _vector(components: Sequence[float], factors: Sequence[str] = ("", "")) -> str:
    """Return a vector in the plane of the board, e_x and e_y along its axes, without components of zero."""
    parts = [
        f"{value:.3g} {factor}e_{axis}"
        for value, factor, axis in zip(components, factors, "xy", strict=True)
        if value != 0.0
    ]
    return parts[0] if len(parts) == 1 else f"({' + '.join(parts)})".replace("+ -", "- ")


def cleared(values: dict[str, float]) -> dict[str, float]:
    """Return values with zeros for components along one axis that are next to nothing beside the other's.

    And for waves, steps, bells, ridges and spots that are next to nothing beside others: unlike a polynomial
    each is at most what it is multiplied by.
    """
    kept, slots = dict(values), range(1, PROFILES + 1)
    for slot in slots:
        for names in (PUSH, GEARS, *VECTORS.values()):
            _clear(kept, [[of_slot(name, slot)] for name in names])
    bounded = [slot for slot in slots if SHAPES[round(values[f"shape_{slot}"])] in BOUNDED]
    for names in (PUSH, GEARS, (BRAKE,)):
        _clear(kept, [[of_slot(name, slot) for name in names] for slot in bounded])
    return kept


def _clear(values: dict[str, float], groups: Sequence[Sequence[str]]) -> None:
    """Set to zero what is next to nothing beside the largest group."""
    sizes = [max(abs(values[name]) for name in group) for group in groups]
    for group, size in zip(groups, sizes, strict=True):
        if size < LITTLE * max(sizes):
            values.update(dict.fromkeys(group, 0.0))


def variables(values: dict[str, float]) -> list[str]:
    """Return on what the learned push depends: position, velocity, heading, tilt, time, way, speed."""
    values = cleared(values)
    slots = _profiles(values)
    gears = [_gears(values, slot) for slot in slots]
    found = [
        "tilt" if variable == "command" else variable
        for variable, names in VECTORS.items()
        if any(values[of_slot(name, slot)] != 0.0 for slot in slots for name in names)
        or (variable == "command" and (values["mode_gain"] or any(map(any, gears))))
    ]
    drags = [values["drag_strength"], *(values[f"brake_{slot}_m_per_s2"] for slot in slots)]
    return [*found, *(["speed"] if any(drags) or values["side_strength"] else [])]


def _profile(values: dict[str, float], slot: int) -> str:
    """Return a profile as a function of what it depends on."""
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
    """Return multiples of what has a symbol, and a phase, as a sum without zeros."""
    parts = [f"{value:.4g} {symbol}" for value, symbol in symbols if value != 0.0]
    if phase != 0.0 or not parts:
        parts.append(f"{phase:.3g}")
    return " + ".join(parts).replace("+ -", "- ")


def _push(values: dict[str, float], slot: int) -> list[float]:
    return [values[f"push_{slot}_{axis}_m_per_s2"] for axis in "xy"]


def _gears(values: dict[str, float], slot: int) -> list[float]:
    return [values[f"gear_{slot}_{axis}"] for axis in "xy"]


def _profiles(values: dict[str, float]) -> list[int]:
    """Return the slots of the profiles that push, brake or change the gears."""
    return [
        slot
        for slot in range(1, PROFILES + 1)
        if any((*_push(values, slot), *_gears(values, slot), values[f"brake_{slot}_m_per_s2"]))
    ]
