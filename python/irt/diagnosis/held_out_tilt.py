"""How well the answer predicts the measured tilt, beside the five parameters and the answer's ties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis import config
from irt.model import TILT_SENSOR, Effect, Model
from irt.recording import Recording
from irt.tilt_errors import Predicted, errors, is_comparable, predicted

Array = NDArray[np.float64]

#: How errors of the tilt are stated.
_MEASURE = "root mean square, apart from zero and gain of the sensor"


@dataclass(frozen=True, eq=False)
class TiltPredictions:
    """The measured tilt of recordings as models predict it from the commands alone.

    Attributes
    ----------
    recordings : sequence of Recording
        The recordings with their measured tilt.
    answer, base : sequence of Model
        For each recording the answer and the five parameters, fitted to the other recordings.
    tied : sequence of Model
        Models that explain the recordings as well as the answer, fitted to all recordings.
    is_held_out : bool
        Whether the recordings were held out; a single one cannot be.
    noise_rad : float or None
        Standard deviation of the sensor [rad], if it is known.
    """

    recordings: Sequence[Recording]
    answer: Sequence[Model]
    base: Sequence[Model]
    tied: Sequence[Model]
    is_held_out: bool
    noise_rad: float | None

    def sentence(self) -> str | None:
        """Return how well the models predict the measured tilt; None without one."""
        if not any(is_comparable(one) for one in self.recordings):
            return None
        after, before = self._off(self.answer), self._off(self.base)
        of = " of held-out recordings" if self.is_held_out else ""
        text = (
            f"From the commands alone, the answer predicts the measured tilt{of} to {_pair(after)} "
            f"({_MEASURE})"
        )
        (own,) = {_names(one) for one in self.answer}
        if not own:
            return f"{text}."
        text += f"; the five parameters to {_pair(before)}"
        for other in self.tied:
            if _names(other) != own:
                off = self._off([other] * len(self.recordings))
                text += f"; with {_difference(_names(other), own)} to {_pair(off)}"
        if np.hypot(*after) > (1.0 + config.EXCEEDS) * np.hypot(*before):
            return f"{text}. So it contradicts what the answer says of the actuators."
        if self.noise_rad is not None and (after > 1000.0 * (1.0 + config.EXCEEDS) * self.noise_rad).any():
            noise = f"{1000.0 * self.noise_rad:.2g} mrad"
            return f"{text}. The sensor's noise is {noise}: the actuators do more than that."
        return f"{text}."

    def _off(self, models: Sequence[Model]) -> Array:
        """Return the errors of a model for each recording about x and y, (2,) [mrad]."""
        pairs = zip(models, self.recordings, strict=True)
        return _off([predicted(model, run) for model, run in pairs if is_comparable(run)])


def of_sweeps(model: Model, sweeps: Sequence[Recording]) -> str:
    """Return how well a model predicts the tilt of recordings without a marble, to which it was fitted."""
    off = _off([predicted(model, run) for run in sweeps])
    names, has = ", ".join(one.name for one in sweeps), "has" if len(sweeps) == 1 else "have"
    return (
        f"{names} {has} no marble. The measured tilt was fitted, never held out; the answer predicts it to "
        f"{_pair(off)} ({_MEASURE})."
    )


def with_sensor(model: Model, recordings: Sequence[Recording]) -> Model:
    """Return a model with the zero of the tilt sensor, if the recordings have a tilt to compare."""
    found = [predicted(model, run) for run in recordings if is_comparable(run)]
    if not found:
        return model
    off = np.concatenate([one.measured - one.tilt for one in found])
    zero = {f"zero_{axis}_rad": float(np.nanmean(off[:, index])) for index, axis in enumerate("xy")}
    return replace(model, effects=(*model.effects, Effect(TILT_SENSOR, zero)))


def _difference(own: frozenset[str], others: frozenset[str]) -> str:
    """Return which effects a model has in place of those of the answer."""
    more, less = " and ".join(sorted(own - others)), " and ".join(sorted(others - own))
    return f"{more} in place of {less}" if more and less else more or f"no {less}"


def _names(model: Model) -> frozenset[str]:
    return frozenset(one.name for one in model.effects)


def _off(runs: Sequence[Predicted]) -> Array:
    """Return the errors of predictions about x and y, (2,) [mrad]."""
    return 1000.0 * np.array([axis.gain for axis in errors(runs)])


def _pair(values: Array) -> str:
    """Return errors about x and y [mrad] in words."""
    return f"{values[0]:.2g} mrad about x and {values[1]:.2g} mrad about y"
