"""Units that cannot be are refused with the conversion; those that can be pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irt.errors import IrtError
from irt.importing.log import Log
from irt.importing.units import check_places, check_tilt_gain, check_tilt_size, marble_is_swapped
from irt.rig import Board


def log() -> Log:
    times = np.arange(2000) / 50.0
    return Log(
        name="log",
        path=Path("log.csv"),
        stamps=times,
        marble=np.column_stack([0.47 * np.sin(times), 0.38 * np.cos(1.3 * times)]),
        tilt=0.1 * np.column_stack([np.sin(2.0 * times), np.cos(times)]) + [0.04, 0.0],
        command_stamps=times,
        commands=np.zeros((2000, 2)),
        episodes=np.zeros(2000),
        tilt_names=("beta", "-alpha"),
    )


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (
            180.0 / np.pi,
            r'in degrees; convert it with --map "tilt_x_rad=rad\(beta\)" --map "tilt_y_rad=rad\(-alpha\)"',
        ),
        (1000.0, r'not in radians; convert it, from milliradians with --map "tilt_x_rad=\(beta\)/1000"'),
    ],
)
def test_a_steep_tilt(factor: float, said: str) -> None:
    check_tilt_size(log())
    check_tilt_size(replace(log(), tilt=None))
    with pytest.raises(IrtError, match=said):
        check_tilt_size(replace(log(), tilt=factor * log().tilt))


def test_a_gain_by_degrees() -> None:
    for ratio in (1.0, 0.6, 0.276, float("nan")):
        check_tilt_gain(log(), ratio)
    with pytest.raises(
        IrtError, match=r"accelerates by 0\.0175 of 5/7 g for each unit of tilt: .* in degrees"
    ):
        check_tilt_gain(log(), np.pi / 180.0)


def test_places_off_the_board() -> None:
    check_places(log(), Board())
    for marble in (276.0 * log().marble, log().marble + np.array([0.5, 0.42])):
        with pytest.raises(IrtError, match="of the positions lie outside the board of"):
            check_places(replace(log(), marble=marble), Board())


def test_a_marble_whose_axes_are_exchanged() -> None:
    assert not marble_is_swapped([log()], Board())
    flipped = replace(log(), marble=1.05 * log().marble[:, ::-1])
    assert marble_is_swapped([flipped], Board())
    # A marble that stayed near the middle fits the board either way.
    assert not marble_is_swapped([replace(log(), marble=0.5 * flipped.marble)], Board())
    assert not marble_is_swapped([replace(log(), marble=np.full((2000, 2), np.nan))], Board())
