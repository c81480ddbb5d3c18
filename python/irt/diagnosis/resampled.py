"""Intervals by recordings resampled: how estimates change when each recording is left out in turn.

The curvature of the likelihood knows only noise as the engine takes it to be: white, of one size, around a
model that is right. Noise that remembers, noise with wild rows and a rim that throws the marble back a little
otherwise all make recordings differ from each other by more than that. The jackknife over recordings (Efron
and Stein, 1981, "The jackknife estimate of variance") sees it whatever its cause.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from irt.diagnosis.heldout import HeldOut
from irt.fitting.information import CONFIDENCE, Information

#: Recordings from which on leaving one out says something.
FEWEST = 3


def with_scatter(told: Information, held_out: HeldOut) -> Information:
    """Return what recordings tell, no sharper along any direction than their own disagreement allows.

    Parameters
    ----------
    told : Information
        Of a hypothesis.
    held_out : HeldOut
        The same hypothesis, fitted without each recording in turn.
    """
    count = len(held_out.fits)
    if count < FEWEST:
        return told
    values = np.array([one.values for one in held_out.fits])
    along = (values - values.mean(axis=0)) / told.widths @ told.directions.T
    deviation = np.sqrt((count - 1) / count * np.sum(along**2, axis=0))
    scatter = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2.0)) * deviation
    wider = np.maximum(told.half_width, scatter)
    return replace(told, half_width=np.where(told.flat, told.half_width, wider))
