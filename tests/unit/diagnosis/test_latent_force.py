"""The variable that the residuals of a fit depend on."""

import pytest

from irt.diagnosis.latent_force import LatentForce
from irt.diagnosis.result import UNLISTED


@pytest.mark.slow
def test_the_likeliest_source_of_a_wave_is_the_position(plant):
    wave = {"push_1_x_m_per_s2": 0.02, "wave_1_x_per_m": 100.0, "phase_1_rad": 0.5}
    sources = LatentForce(plant([{"name": UNLISTED, **wave}], runs=6).fit()).sources(0)
    repeatable = [one for one in sources if one.variable in {"position", "velocity", "command", "time"}]
    assert repeatable[0].variable == "position"
    assert repeatable[0].p_value == 0.01


@pytest.mark.slow
def test_noise_has_no_source(plant):
    sources = LatentForce(plant(runs=6).fit()).sources(0)
    assert all(one.p_value > 0.01 or one.gain == 0.0 for one in sources)
