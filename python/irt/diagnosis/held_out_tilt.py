"""The measured tilt, which no fit of a diagnosis sees, as a check of its answer."""

from __future__ import annotations

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.result import Diagnosis
from irt.model import Model
from irt.rig import Rig
from irt.tilt_errors import errors, is_comparable, predicted


def sentence(found: Diagnosis, rig: Rig) -> str | None:
    """Return how well the answer and the five parameters predict the measured tilt; None without one.

    Parameters
    ----------
    found : Diagnosis
        The diagnosis, which knows nothing of the tilt.
    rig : Rig
        The rig with its measured tilt.
    """
    runs = [one for one in rig.recordings if is_comparable(one)]
    if not runs:
        return None

    def off(model: Model) -> np.ndarray:
        return 1000.0 * np.array([axis.zero for axis in errors([predicted(model, run) for run in runs])])

    after, before = off(found.model), off(found.base)
    text = (
        "The measured tilt took no part in the diagnosis. From the commands, the answer predicts it to "
        f"{_pair(after)} (root mean square, apart from the sensor's zero)"
    )
    if not found.effects:
        return f"{text}."
    text += f"; the five parameters to {_pair(before)}"
    for other in found.indistinguishable:
        if _names(other) != _names(found.model):
            text += f"; with {_difference(other, found.model)} to {_pair(off(other))}"
    if (after**2).sum() > (before**2).sum():
        return f"{text}. So it contradicts what the answer says of the actuators."
    noise = rig.tilt.noise_rad
    if noise is not None and (after > 1000.0 * (1.0 + config.EXCEEDS) * noise).any():
        return f"{text}. The sensor's noise is {1000.0 * noise:.2g} mrad: the actuators do more than that."
    return f"{text}."


def _difference(model: Model, answer: Model) -> str:
    """Return which effects a model has in place of those of the answer."""
    own, others = _names(model), _names(answer)
    more, less = " and ".join(sorted(own - others)), " and ".join(sorted(others - own))
    return f"{more} in place of {less}" if more and less else more or f"no {less}"


def _names(model: Model) -> set[str]:
    return {one.name for one in model.effects}


def _pair(values: np.ndarray) -> str:
    """Return errors about x and y [mrad] in words."""
    return f"{values[0]:.2g} mrad about x and {values[1]:.2g} mrad about y"
