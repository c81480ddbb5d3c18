"""A model as JSON: everything that ``model.toml`` has, with units, for other programs."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from irt import arguments
from irt.catalogue import effect
from irt.engine import SUBSTEP_S
from irt.files import PathLike
from irt.fitting.problem import in_unit_of
from irt.model import Effect, Model, as_model
from irt.posterior import Component
from irt.rig import PARAMETERS

#: Version of what `to_json` writes. It grows where something is removed or changes its meaning.
VERSION = 1
#: Units of the five parameters.
_UNITS = dict(zip(PARAMETERS, ("", "", "", "1/240 s", ""), strict=True))


@arguments.entry
def to_json(model: Model | PathLike) -> str:
    """Return a model, or that of a file, as JSON; what has no number, such as an open end, is null.

    The fields are in ``docs/use.md``.

    Raises
    ------
    IrtError
        If it is not a model.
    """
    model = as_model(model)
    content = {
        "format": "labsim-model",
        "version": VERSION,
        "written_by": f"labsim-irt {version('labsim-irt')}",
        "board": asdict(model.board),
        "marble": asdict(model.marble),
        "maze": None if model.maze is None else asdict(model.maze),
        "recordings": {"start": model.start},
        "commands": asdict(model.commands),
        "tilt": asdict(model.tilt),
        "simulation": {"time_step": model.time_step, "substep_s": SUBSTEP_S},
        "parameters": {
            name: {**asdict(one), "unit": _unit(model, name), "range": list(model.ranges[name])}
            for name, one in model.parameters.items()
        },
        "effects": [_effect(model, one) for one in model.effects],
        "posterior": [_component(one) for one in model.posterior],
    }
    return f"{json.dumps(_finite(content), indent=2, allow_nan=False)}\n"


def _unit(model: Model, name: str) -> str:
    """Return the unit of a parameter; a gear leads from the rig's own commands."""
    if name.startswith("gear") and model.commands.unit != "rad":
        return f"rad/({model.commands.unit})"
    return _UNITS[name]


def _effect(model: Model, one: Effect) -> dict[str, Any]:
    """Return an effect with all its parameters, those that the model leaves out at their neutral value."""
    info = in_unit_of(model, effect(one.name))
    return {
        "name": info.name,
        "stage": info.stage,
        "equation": info.equation,
        "parameters": {
            each.name: {
                "value": one.parameters.get(each.name, each.neutral),
                "unit": each.unit,
                "neutral": each.neutral,
                "doc": each.doc,
            }
            for each in info.parameters
        },
    }


def _component(one: Component) -> dict[str, Any]:
    return {
        "probability": one.probability,
        "effects": list(one.effects),
        "parameters": {name: asdict(spread) for name, spread in one.parameters.items()},
    }


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {name: _finite(value) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
