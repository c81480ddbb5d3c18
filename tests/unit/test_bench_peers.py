"""What the benches hand to engines and fits, and when they refuse to time one."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts
from irt.rig import PARAMETERS, RANGES
from peers import throughput
from peers.fit_task import LOW, NOISE, TRUTH, Arrival, Trace, from_unit, make_task, to_unit
from peers.labsim_engine import Labsim
from peers.workload import drive, gentle, gravity_in_board, spread, substeps, time_scales


class Shifted(Labsim):
    """An engine whose marble goes another way."""

    def __init__(self, shift):
        super().__init__("rolling", 1)
        self.rollouts, self.shift = 3, shift

    def simulate(self, parameters, commands):
        return super().simulate(parameters, commands) + self.shift


@pytest.fixture(scope="module", params=["off the rim", "with rim impacts"])
def task(request):
    return make_task(request.param, 0)


def test_draw_fills_the_papers_ranges_evenly_and_goes_on_where_it_stopped():
    parameters = spread(4000)
    for values, name in zip(parameters.T, PARAMETERS, strict=True):
        counts, _ = np.histogram(values, 10, RANGES[name])
        assert counts.sum() == 4000
        assert np.abs(counts - 400).max() < 8
    np.testing.assert_allclose(spread(10, 90), spread(100)[90:])


def test_substeps_are_those_of_the_papers_rounding():
    parameters = np.array([[0.0, 0.0, 0.0, scale, 1.0] for scale in (0.4, 0.5, 2.5, 16.0)])
    assert time_scales(parameters).tolist() == [0, 1, 3, 16]
    assert substeps(parameters) == 99 * 20


def test_gravity_keeps_its_length_and_pulls_towards_the_low_side():
    gravity = gravity_in_board(np.array([0.5, 0.5, 0.0, 1.0, 1.0]), np.array([[0.0, 0.1], [0.1, 0.0]]))
    np.testing.assert_allclose(np.linalg.norm(gravity, axis=1), 9.81)
    (marble,) = rollouts([[0.5, 0.5, 0.0, 10.0, 1.0]], [[0.0, 0.1]] * 2)
    assert np.sign(gravity[0, 0]) == np.sign(marble[-1, 0])
    (marble,) = rollouts([[0.5, 0.5, 0.0, 10.0, 1.0]], [[0.1, 0.0]] * 2)
    assert np.sign(gravity[1, 1]) == np.sign(marble[-1, 1])


def test_engines_of_this_project_take_the_same_way_and_are_timed_in_turns():
    engines = [Labsim("rapier", 1), Shifted(0.0)]
    engines[0].rollouts = 2
    found = throughput.measure(engines, 3, lambda text: None)
    assert [len(one.seconds) for one in found] == [3, 3]
    assert found[0].substeps == substeps(spread(2))
    assert 0 < found[0].path_mean < throughput.TOLERANCE["rapier"]


@pytest.mark.parametrize("shift", [0.001, np.nan])
def test_an_engine_whose_marble_goes_another_way_is_not_timed(shift):
    with pytest.raises(throughput.OtherPathError, match="rolling: its marble is"):
        throughput.measure([Labsim("rolling", 1), Shifted(shift)], 1, lambda text: None)


def test_every_peer_missing_is_said(monkeypatch):
    monkeypatch.setattr(throughput, "OTHERS", {"Unheard": "unheard_of_engine"})
    absent = {}
    names = {engine.name for engine in throughput.contenders(absent)}
    assert names == {"rapier", "rolling"}
    assert "unheard_of_engine" in absent["Unheard"]


STREAMS = """
from pathlib import Path
from peers.growth import stream
for count in (20_000, 60_000):
    stream(count)
    print(*(line.split()[1] for line in Path("/proc/self/status").open() if line.startswith("VmHWM")))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read the Linux way")
def test_streaming_takes_no_more_memory_for_more_rollouts():
    """40 MiB would be positions of 26,000 rollouts kept.

    In a process of its own: how a test worker's memory is filled by then is nobody's business here.
    """
    printed = subprocess.run(
        [sys.executable, "-c", STREAMS],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    before, after = (int(line) / 1024 for line in printed.stdout.split())
    assert after - before < 40


def test_gentle_rollouts_move():
    paths = rollouts(gentle(16), drive())
    assert (np.abs(paths).max(axis=(1, 2)) > 0.05).all()


def test_best_fit_leaves_the_noise(task):
    assert task.floor == pytest.approx(NOISE, rel=0.05)
    assert task.error(task.predict(TRUTH[None]))[0] == pytest.approx(task.floor, rel=0.01)


def test_trace_notes_when_a_fit_comes_close_and_ends_it_on_arrival(task):
    trace, at_rest = Trace(task), np.where(np.arange(5) == 3, 1.0, LOW)
    trace.note(task.predict(at_rest[None]))
    assert (trace.close, trace.arrived) == (None, None)
    trace.reach(1.05 * task.floor)
    assert trace.close is not None
    assert trace.close[1] == 8
    assert trace.arrived is None
    with pytest.raises(Arrival):
        trace.note(task.predict(np.stack([at_rest, TRUTH])))
    assert trace.arrived[1] == 24
    assert trace.arrived[0] >= trace.close[0]


def test_shares_of_the_ranges_and_back():
    np.testing.assert_allclose(from_unit(to_unit(TRUTH)), TRUTH)
    np.testing.assert_allclose(to_unit(np.array([RANGES[name] for name in PARAMETERS]).T), [[0] * 5, [1] * 5])
