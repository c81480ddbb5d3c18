"""Physics that no effect of the catalogue describes: found, learned as a formula, and put into the model.

The term of a library that explains most of what is left is fitted inside the simulator with everything else,
what is left then is looked at anew, and so on. Terms stay while recordings held out confirm them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from irt.catalogue import effect
from irt.diagnose.case import Case, Fitted
from irt.diagnose.diagnosis import UNLISTED
from irt.diagnose.evidence import TRUSTED, Evidence, excess, is_explained
from irt.diagnose.heldout import hold_out, is_supported
from irt.diagnose.impacts import shows
from irt.diagnose.library import VECTORS, WAVES, Term, in_slots, likely_terms, motion_seen, of_slot
from irt.diagnose.search import Search
from irt.rig import PARAMETERS

#: A further term must take away this share of what was left beyond noise.
LEAST = 0.1
#: So many effects together may stand for one that has no name, even if they leave noise.
MANY = 3
#: Effects that are believed give way only to what leaves so much of what they do.
HALF = 0.5

#: What a formula calls that which the parameters of a wave are multiplied by.
_SYMBOLS = dict(
    zip(itertools.chain(*VECTORS.values()), ("x", "y", "v_x", "v_y", "tilt_x", "tilt_y", "t"), strict=True)
)

#: A case that holds what a fit did not move, the terms, and the fit.
Learned = tuple[Case, tuple[Term, ...], Fitted]


def learn(case: Case, base: Fitted) -> Iterator[Learned]:
    """Fit the likeliest term of the library inside the simulator, then with it the likeliest of what is left.

    Yields
    ------
    Learned
        With one term more each time.
    """
    terms: tuple[Term, ...] = ()
    held, learned, seen = case, base, motion_seen(case, base)
    while likely := likely_terms(held, seen, learned, terms):
        tried = [_added(case, learned, (*terms, one)) for one in likely]
        held, terms, begun = _best(case, tried)
        # From where the terms before it led, and from the base model: slopes may lead astray.
        points = [[*one.values[: len(PARAMETERS)], *_values(learned, terms)] for one in (learned, base)]
        fitted = held.fit([UNLISTED], points=np.array(points[: len(terms)]), rounds=1)
        held, terms, learned = _best(case, [(held, terms, fitted), (held, terms, begun)])
        yield held, terms, learned
        if seen is not None:
            seen.take(terms[-1])


def _added(case: Case, learned: Fitted, terms: tuple[Term, ...]) -> Learned:
    """Refine what was learned with one term more, from where that term explains most."""
    values = _values(learned, terms)
    free = {name for term in in_slots(terms) for name in term.free}
    names = [one.name for one in effect(UNLISTED).parameters]
    still = {name: value for name, value in zip(names, values, strict=True) if name not in free}
    held = case.holding(UNLISTED, still)
    return held, terms, held.refine([UNLISTED], np.array([[*learned.values[: len(PARAMETERS)], *values]]))[0]


def _values(learned: Fitted, terms: Sequence[Term]) -> list[float]:
    """Return the values of the engine's effect: what was learned, and the last term as it explains most."""
    neutral = {one.name: one.neutral for one in effect(UNLISTED).parameters}
    return list((neutral | learned.value_of(UNLISTED) | in_slots(terms)[-1].values).values())


def _best(case: Case, tried: Sequence[Learned]) -> Learned:
    """Return the likeliest, at the scale that the best of them leaves."""
    scale = max(case.noise, min(fitted.noise for *_, fitted in tried))
    return min(tried, key=lambda one: one[2].loss(scale))


def confirmed(search: Search, best: Fitted) -> Learned | None:
    """Return what was learned, if it beats the catalogue's best hypothesis and recordings held out agree.

    Terms stay as long as they are better than those before them; what is likelier, but not on recordings held
    out, may be so with the next one.
    """
    case, base = search.case, search.base
    kept: Learned | None = None
    before, held_before, doubted = base, search.held_out(base), False
    for fixed, terms, fitted in learn(case, base):
        search.report(f"a push that depends on {terms[-1].variable}")
        evidence = Evidence.of(case, [*search.fits.values(), fitted])
        between = replace(search.between_impacts, held=fixed.held)
        least = excess(case, fitted) < (1.0 - LEAST) * excess(case, before)
        if not least or not evidence.is_better(fitted, before) or not shows(between, fitted, base):
            break
        held = hold_out(fixed, fitted)
        if is_supported(held, held_before, evidence.scale):
            kept, before, held_before, doubted = (fixed, terms, fitted), fitted, held, False
        elif doubted:
            break
        else:
            doubted = True
        if is_explained(case, fitted, base):
            break
    if kept is None:
        return None
    search.remember(before, held_before)
    return kept if _is_preferred(search, before, best) else None


def _is_preferred(search: Search, learned: Fitted, best: Fitted) -> bool:
    """Whether what was learned beats the catalogue's best hypothesis, and recordings held out agree.

    Effects that leave much of the mismatch are not believed, a wrong name is worse than none; but what was
    learned and explains less than they do is believed even less.
    """
    if not best.effects:
        return True
    evidence, left = search.evidence(), excess(search.case, best)
    if evidence.margin(learned, best) <= 0.0:
        return False
    if len(best.effects) >= MANY or left > TRUSTED * excess(search.case, search.base):
        return True
    if excess(search.case, learned) > HALF * left:
        return False
    return is_supported(search.held_out(learned), search.held_out(best), evidence.scale)


def formula(values: dict[str, float]) -> str:
    """Return the learned push as a formula, in m/s^2."""
    parts = []
    for slot, push in _waves(values):
        arguments = [
            f"{values[name]:.4g} {symbol}"
            for name, symbol in ((of_slot(name, slot), symbol) for name, symbol in _SYMBOLS.items())
            if values[name] != 0.0
        ]
        inside = " + ".join([*arguments, f"{values[f'phase_{slot}_rad']:.3g}"]).replace("+ -", "- ")
        parts.append(f"({push[0]:.3g}, {push[1]:.3g}) cos({inside})")
    if values["drag_strength"]:
        parts.append(f"{-values['drag_strength']:.3g} (v / 0.1 m/s)^{values['drag_power']:.2g} along v")
    if values["side_strength"]:
        parts.append(f"{values['side_strength']:.3g} (v / 0.1 m/s)^{values['side_power']:.2g} across v")
    return "a = " + " + ".join(parts)


def variables(values: dict[str, float]) -> list[str]:
    """Return on what the learned push depends: position, velocity, tilt, time, speed."""
    slots = [slot for slot, _ in _waves(values)]
    found = [
        "tilt" if variable == "command" else variable
        for variable, names in VECTORS.items()
        if any(values[of_slot(name, slot)] != 0.0 for slot in slots for name in names)
    ]
    return [*found, *(["speed"] if values["drag_strength"] or values["side_strength"] else [])]


def _waves(values: dict[str, float]) -> Iterator[tuple[int, list[float]]]:
    """Yield the slot and the push [m/s^2] of each wave that pushes."""
    for slot in range(1, WAVES + 1):
        push = [values[f"push_{slot}_{axis}_m_per_s2"] for axis in "xy"]
        if push != [0.0, 0.0]:
            yield slot, push
