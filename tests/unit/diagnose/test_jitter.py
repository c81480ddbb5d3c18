"""Delays that differ, and what only looks like them."""

from dataclasses import replace

import numpy as np

from irt.diagnose.case import Case
from irt.diagnose.jitter import kicks, spread
from irt.diagnose.latent import Leftover
from irt.diagnose.search import Search


def searched(case):
    search = Search(case, lambda _: None)
    search.keep(case.fit())
    return search


def price(search):
    return search.evidence().price(2, 1)


def test_delays_that_differ_are_sized(plant):
    case = plant([{"name": "delay_jitter", "sd_s": 0.1}], runs=8, rows=120)
    search = searched(case)
    mean = search.with_effect("delay")
    told = kicks(case, mean, price(search))
    assert told is not None
    size = spread(case, mean, told)
    assert 0.04 < size.value < 0.25
    assert size.low < size.value < size.high


def test_a_picture_that_turns_with_the_tilt_is_the_cameras(plant):
    case = plant(runs=6, rows=120)
    turned = []
    for one in case.rig.recordings:
        place = (one.marble[:, 0] + 1j * one.marble[:, 1]) * np.exp(0.9j * one.knobs[:, 0])
        turned.append(replace(one, marble=np.stack([place.real, place.imag], axis=1)))
    case = Case.of(replace(case.rig, recordings=tuple(turned)))
    search = searched(case)
    mean = search.with_effect("delay")
    likeliest = Leftover(case, mean, longest=60).sources(0)[0]
    assert (likeliest.variable, likeliest.stage) == ("command", "camera")
    assert kicks(case, mean, price(search)) is None
